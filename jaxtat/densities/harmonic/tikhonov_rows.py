"""Densities of a Tikhonov rule as rows, by Cholesky decomposition: no singular values.

`HarmonicDensities` of (A A^T + alpha)^-1 A, which `tikhonov` applies to one image's data: for many
images, and found again at once for another alpha.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...regularization import RelativeTikhonov, Tikhonov, per_frequency
from .densities import DensityGroup, HarmonicDensities, detector_columns, plane_scales
from .polar import PolarGeometry
from .table import WaveTable, alpha_unit, circle_gram, cut_gram, region_factor, wave_table
from .tikhonov import cholesky_solve, normal_matrix, powers_at_detectors


class WavesOfGeometry(eqx.Module):
    """What does not depend on the rule: found once.

    Attributes:
        geometry: curve and region.
        table: all waves of all frequencies.
        gram: of detectors on a circle, see `circle_gram`.
        angles: of the directions, counted from the axis [rad].
        phases: exp(i xi·(centre of the region - centre of the waves)).
        groups: (first, last + 1, orders) of frequencies that are solved alike.
    """

    geometry: PolarGeometry
    table: WaveTable
    gram: Float[Array, "blocks r r"] | None
    angles: Float[Array, " directions"]
    phases: Array
    groups: tuple[tuple[int, int, int], ...] = eqx.field(static=True)


@eqx.filter_jit
def waves_of(
    geometry: PolarGeometry,
    frequencies: Float[Array, " frequencies"],
    angles: Float[Array, " directions"],
    groups: tuple[tuple[int, int, int], ...],
) -> WavesOfGeometry:
    """All waves of a geometry, at frequencies [rad/length] and directions [rad]."""
    n_max = max(orders for *_, orders in groups)
    table = wave_table(geometry, frequencies, n_max)
    gram = circle_gram(geometry, n_max) if geometry.on_circle else None
    offset = geometry.region.center - geometry.center
    along = jnp.cos(angles) * offset[0] + jnp.sin(angles) * offset[1]
    phases = jnp.exp(1j * frequencies[:, None] * along)
    return WavesOfGeometry(geometry, table, gram, angles - geometry.axis, phases, groups)


def tikhonov_densities(
    waves: WavesOfGeometry, rule: Tikhonov | RelativeTikhonov, dtype: np.dtype
) -> HarmonicDensities:
    """The densities of all plane waves by a rule, in the precision that is asked for."""
    complex_type = jnp.result_type(dtype, jnp.complex64)
    rules = per_frequency(rule, waves.phases.shape[0])
    groups = tuple(
        _group(waves, rules, start, stop, orders, jnp.dtype(dtype).name)
        for start, stop, orders in waves.groups
    )
    phases = waves.phases.astype(complex_type)
    return HarmonicDensities(groups, waves.angles, phases, waves.geometry.mirror)


@eqx.filter_jit
def _group(
    waves: WavesOfGeometry,
    rules: Tikhonov | RelativeTikhonov,
    start: int,
    stop: int,
    orders: int,
    dtype: str,
) -> DensityGroup:
    geometry = waves.geometry
    gram = None if waves.gram is None else cut_gram(geometry, waves.gram, orders)

    def at(given: tuple[WaveTable, Tikhonov | RelativeTikhonov]) -> Array:
        wave, rule = given[0].up_to(orders), given[1]
        factor = region_factor(geometry, wave)
        unit = alpha_unit(factor.powers, powers_at_detectors(geometry, wave, gram))
        alpha = rule.in_units_of(unit, wave.frequencies).alpha
        matrix = normal_matrix(geometry, wave, factor, gram)
        potentials = factor.matrix_times(detector_columns(geometry, wave))
        found = cholesky_solve(matrix + alpha * jnp.eye(matrix.shape[-1]), potentials)
        rows = plane_scales(geometry, wave)[..., None] * factor.transposed_matrix_times(found)
        return rows.astype(dtype)

    part = jax.tree.map(lambda leaf: leaf[start:stop], (waves.table, rules))
    rows = jax.lax.map(at, part)
    none = (*rows.shape[:2], 0)
    return DensityGroup(
        rows,
        jnp.zeros((*none, rows.shape[-1]), dtype),
        jnp.zeros((*none, waves.angles.shape[0]), jnp.result_type(dtype, jnp.complex64)),
    )
