"""Densities in cylindrical waves against those of collocation, and sums over them."""

from operator import itemgetter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    FixedRank,
    NormBound,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
    build_plan,
    circular_arc,
    detector_curve,
    disk,
    phantoms,
    reconstruct,
)
from jaxtat.densities import collocation_densities
from jaxtat.densities.harmonic import (
    HarmonicDensities,
    group_of,
    harmonic_densities,
    harmonic_orders,
    polar_geometry,
    wave_table,
)
from jaxtat.special import full_circle_norm

FREQUENCIES = jnp.array([3.0, 5.0, 9.0])
NORMS = full_circle_norm(FREQUENCIES, 1.5)
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
    n_max = int(harmonic_orders(polar, np.asarray(FREQUENCIES)).max())
    table = wave_table(polar, FREQUENCIES, n_max)
    local = ANGLES - polar.axis
    table = jax.tree.map(np.asarray, table)
    parts = [slice(i, i + 1) for i in range(len(FREQUENCIES))]
    tables = [jax.device_put(jax.tree.map(itemgetter(part), table)) for part in parts]
    found = [
        harmonic_densities(polar, one, n_max, NORMS[part], local, rule)
        for one, part in zip(tables, parts, strict=True)
    ]
    along = jnp.stack([jnp.cos(ANGLES), jnp.sin(ANGLES)], axis=-1) @ (region.center - polar.center)
    phases = jnp.exp(1j * FREQUENCIES[:, None] * along)
    group = group_of([step for step, _ in found])
    return HarmonicDensities((group,), local, phases, polar.mirror), [r for _, r in found]


@pytest.fixture(scope="module", params=GEOMETRIES)
def norm_bounded(request):
    curve, region = GEOMETRIES[request.param]
    return curve, region, *densities_of(curve, region, NormBound(3.0))


@eqx.filter_jit
def all_frequencies(densities, curve):
    return jnp.stack([densities.of_frequency(i, curve.weights) for i in range(len(FREQUENCIES))])


def agree(curve, region, rule, densities, reports):
    exact, report = collocation_densities(FREQUENCIES, NORMS, ANGLES, curve, region, rule)
    found = all_frequencies(densities, curve)
    # both cut what they keep at the same place; what remains is rounding (1e-14) and the waves left
    # out (1e-12), over the least singular value kept, some 1e-4 to 1e-6 of the largest
    for i in range(len(FREQUENCIES)):
        scale = float(jnp.abs(exact[i]).max())
        np.testing.assert_allclose(found[i], exact[i], atol=1e-6 * scale)
        np.testing.assert_allclose(reports[i].norm[0], report.norm[i], rtol=1e-6)
        np.testing.assert_allclose(reports[i].j_max[0], report.j_max[i], atol=1e-4)
        np.testing.assert_allclose(reports[i].residual[0], report.residual[i], atol=1e-7)


def test_norm_bound_agrees_with_collocation(norm_bounded):
    curve, region, densities, reports = norm_bounded
    agree(curve, region, NormBound(3.0), densities, reports)


@pytest.mark.parametrize(
    ("name", "rule"), [("disk", FixedRank(24.4)), ("measured", SingularValueCutoff(3e-4))]
)
def test_other_rules_agree_with_collocation(name, rule):
    curve, region = GEOMETRIES[name]
    agree(curve, region, rule, *densities_of(curve, region, rule))


def test_fourier_transform_is_the_sum_over_the_densities(norm_bounded):
    """fhat = (1/2π) Σ_k w_k (rho_J G_J + rho_Y G_Y), for a batch, in both precisions."""
    curve, _, densities, _ = norm_bounded
    n = curve.n_detectors
    transformed = jnp.asarray(np.random.default_rng(0).standard_normal((2, 3, 3, 2, n)))
    expected = np.einsum(
        "fdjk,abfjk,k->abfd", all_frequencies(densities, curve), transformed, curve.weights
    ) / (2 * np.pi)
    scale = np.abs(expected).max()
    found = densities.polar_fourier(transformed, curve.weights)
    np.testing.assert_allclose(found, expected, atol=1e-12 * scale)
    single = densities.in_single_precision()
    assert {leaf.dtype for leaf in (single.groups[0].rows, single.groups[0].extra_rows)} == {
        jnp.dtype("float32")
    }
    found = single.polar_fourier(transformed, curve.weights)
    np.testing.assert_allclose(found, expected, atol=1e-5 * scale)


def test_rows_are_few():
    """Rules alike for all directions need no rows beside one per order and wave."""
    densities, _ = densities_of(*GEOMETRIES["disk"], FixedRank(24.4))
    group = densities.groups[0]
    assert group.extra.shape[-2] == group.extra_rows.shape[-2] == 0
    # plane waves of 9 radians need some twenty orders of them, not all that potentials need
    assert group.rows.shape[-2] < 40


@pytest.mark.parametrize("rule", [Tikhonov(1e-6), TikhonovNormBound(2.0)])
def test_tikhonov_plan_is_the_direct_reconstruction(half_arc, rule):
    """Two ways to the same image: singular values of A, and systems with A A^T + alpha."""
    bell = phantoms.Bells([[-0.4, 0.1]], [0.5])
    g = bell.circular_integrals(half_arc.curve, half_arc.radii)
    found, expected = reconstruct(build_plan(half_arc, rule), g), reconstruct(half_arc, g, rule)
    np.testing.assert_allclose(found, expected, atol=1e-8)
