"""Densities in cylindrical waves against those of collocation.

Sums over them are tested in test_densities.py, other rules and images in reconstruction/.
"""

from operator import itemgetter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    FixedRank,
    NormBound,
    circular_arc,
    detector_curve,
    disk,
)
from jaxtat.densities import collocation_densities
from jaxtat.densities.cylindrical_waves import (
    CylindricalDensities,
    cylindrical_densities,
    group_of,
    polar_geometry,
    wave_orders,
    wave_table,
)
from jaxtat.special import full_circle_norm

FREQUENCIES = jnp.array([3.0, 5.0, 9.0])
NORMS = np.asarray(full_circle_norm(FREQUENCIES, 1.5))
ANGLES = jnp.array([0.0, 0.4, 1.1, 2.5])
PLACE = {"center": (0.3, -0.2), "angle": 0.8}
ARC, ODD = circular_arc(1.5, 0.1, 40, **PLACE), circular_arc(1.5, 0.1, 41, **PLACE)
DISK, HALF = disk(1.0, n_boundary=160, **PLACE), disk(1.0, 0.1, n_boundary=160, **PLACE)
ASIDE = disk(0.8, n_boundary=160, center=(0.45, -0.1))
JITTER = np.random.default_rng(1).uniform(-0.02, 0.02, (40, 2))
GEOMETRIES = {
    "disk": (ODD, DISK),
    "half disk": (ARC, HALF),
    "disk off the centre": (ARC, ASIDE),
    "measured": (detector_curve(ARC.points + JITTER), DISK),
}


def densities_of(curve, region, rule):
    """As in a plan, but in one group."""
    polar = polar_geometry(curve, region)
    n_max = int(wave_orders(polar, np.asarray(FREQUENCIES)).max())
    table = jax.tree.map(np.asarray, wave_table(polar, FREQUENCIES, n_max))
    parts = [slice(i, i + 1) for i in range(len(FREQUENCIES))]
    tables = [jax.device_put(jax.tree.map(itemgetter(part), table)) for part in parts]
    local = jnp.asarray(np.asarray(ANGLES) - np.asarray(polar.axis))
    found = [
        cylindrical_densities(polar, one, n_max, jnp.asarray(NORMS[part]), local, rule)
        for one, part in zip(tables, parts, strict=True)
    ]
    phases = phases_of(region.center - polar.center)
    group = group_of([step for step, _ in found])
    return CylindricalDensities((group,), local, phases, polar.mirror), [r for _, r in found]


@jax.jit
def phases_of(offset):
    along = jnp.stack([jnp.cos(ANGLES), jnp.sin(ANGLES)], axis=-1) @ offset
    return jnp.exp(1j * FREQUENCIES[:, None] * along)


@eqx.filter_jit
def all_frequencies(densities, curve):
    return jnp.stack([densities.of_frequency(i, curve.weights) for i in range(len(FREQUENCIES))])


@pytest.mark.parametrize("name", GEOMETRIES)
def test_norm_bound_agrees_with_collocation(name):
    curve, region = GEOMETRIES[name]
    densities, reports = densities_of(curve, region, NormBound(3.0))
    exact, report = collocation_densities(
        FREQUENCIES, jnp.asarray(NORMS), ANGLES, curve, region, NormBound(3.0)
    )
    found, exact = np.asarray(all_frequencies(densities, curve)), np.asarray(exact)
    # both cut what they keep at the same place; what remains is rounding (1e-14) and the waves left
    # out (1e-12), over the least singular value kept, some 1e-4 to 1e-6 of the largest
    for i in range(len(FREQUENCIES)):
        np.testing.assert_allclose(found[i], exact[i], atol=1e-6 * np.abs(exact[i]).max())
        one, other = reports[i], jax.tree.map(lambda leaf: np.asarray(leaf)[i], report)  # noqa: B023
        np.testing.assert_allclose(one.norm[0], other.norm, rtol=1e-6)
        np.testing.assert_allclose(one.j_max[0], other.j_max, atol=1e-4)
        np.testing.assert_allclose(one.residual[0], other.residual, atol=1e-7)


def test_rows_are_few():
    """Rules alike for all directions need no rows beside one per order and wave."""
    densities, _ = densities_of(*GEOMETRIES["disk"], FixedRank(24.4))
    group = densities.groups[0]
    assert group.extra.shape[-2] == group.extra_rows.shape[-2] == 0
    # plane waves of 9 radians need some twenty orders of them, not all that potentials need
    assert group.rows.shape[-2] < 40
