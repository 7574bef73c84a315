"""Densities of any Tikhonov rule, as rows of `CylindricalDensities`, from one decomposition.

With the eigenvalues l of A A^T = U diag(l) U^T, or of A^T A = V diag(l) V^T where that is smaller,

    (A A^T + alpha)^-1 A = U diag(1 / (l + alpha)) U^T A = A V diag(1 / (l + alpha)) V^T:

another alpha is another diagonal between two matrices that are kept. `tikhonov` has the same of one
image's data, with no decomposition.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ...base.linear_algebra import product_of_blocks
from ...regularization import RelativeTikhonov, Tikhonov, per_frequency, spectrum
from ..single_layer import phases_from
from .densities import (
    CylindricalDensities,
    Factors,
    plane_scales,
    rows_alone,
    wave_matrix,
)
from .polar import PolarGeometry
from .table import WaveTable, wave_table

ROUNDING = 1e-15  # of eigenvalues, relative to the largest


class Decomposed(eqx.Module):
    """A of frequencies that have as many orders.

    Attributes:
        left: eps Delta R^T U, or eps Delta R^T A V.
        right: U^T A, or V^T, for data as `fold` has them.
        eigenvalues: l [length²].
        unit: of alpha [length²].
    """

    left: Float[Array, "*f blocks r k"]
    right: Float[Array, "*f blocks k columns"]
    eigenvalues: Float[Array, "*f blocks k"]
    unit: Float[Array, "*f"]


class DecomposedWaves(eqx.Module):
    """A of all frequencies of a geometry.

    Attributes:
        groups: in the order of the frequencies.
        frequencies: lambda [rad/length].
        angles: of the directions, counted from the axis [rad].
        phases: exp(i xi·(centre of the region - centre of the waves)).
        mirror: whether rows act on even and odd parts.
    """

    groups: tuple[Decomposed, ...]
    frequencies: Float[Array, " frequencies"]
    angles: Float[Array, " directions"]
    phases: Complex[Array, "frequencies directions"]
    mirror: bool = eqx.field(static=True)


def decomposed_waves(
    geometry: PolarGeometry,
    frequencies: Float[Array, " frequencies"],
    angles: Float[Array, " directions"],
    groups: tuple[tuple[int, int, int], ...],
    dtype: np.dtype,
) -> DecomposedWaves:
    """The decompositions, which do not depend on alpha.

    Args:
        geometry: curve and region.
        frequencies: lambda [rad/length].
        angles: theta [rad].
        groups: (first, last + 1, orders) of frequencies that are solved alike.
        dtype: in which the products with densities are wanted; found in double precision.
    """
    table = wave_table(geometry, frequencies, max(orders for *_, orders in groups))
    offset = geometry.region.center - geometry.center
    phases = phases_from(frequencies, angles, offset)
    decomposed = tuple(_decomposed(geometry, table, *group, dtype) for group in groups)
    phases = phases.astype(jnp.result_type(dtype, jnp.complex64))
    return DecomposedWaves(decomposed, frequencies, angles - geometry.axis, phases, geometry.mirror)


def tikhonov_densities(
    waves: DecomposedWaves, rule: Tikhonov | RelativeTikhonov
) -> CylindricalDensities:
    """The densities of all plane waves by a rule, a number or one for each frequency.

    Args:
        waves: of the geometry.
        rule: gives alpha.

    Raises:
        ValueError: for alpha below rounding.
    """
    unit = np.concatenate([np.asarray(group.unit) for group in waves.groups])
    alphas, start, groups = np.asarray(_alphas_of(rule, unit, waves.frequencies)), 0, []
    if (alphas < ROUNDING * unit).any():
        raise ValueError(
            f"alpha is {float((alphas / unit).min()):.3g} of the largest entry of a system, which "
            f"is less than rounding, {ROUNDING:.0e}: take a larger alpha; 1e-12 suits exact data."
        )
    for group in waves.groups:
        stop = start + len(group.left)
        kept = 1 / (np.asarray(group.eigenvalues) + alphas[start:stop, None, None])
        kept = jax.device_put(kept.astype(group.right.dtype))
        rows = Factors(group.left, kept, group.right)
        groups.append(rows_alone(rows, waves.angles.shape[0]))
        start = stop
    return CylindricalDensities(tuple(groups), waves.angles, waves.phases, waves.mirror)


@eqx.filter_jit
def _decomposed(
    geometry: PolarGeometry, table: WaveTable, start: int, stop: int, orders: int, dtype: np.dtype
) -> Decomposed:
    def at(wave: WaveTable) -> Decomposed:
        wave = wave.up_to(orders)
        matrix, factor, unit = wave_matrix(geometry, wave)
        transposed = jnp.swapaxes(matrix, -1, -2)
        wide = matrix.shape[-2] <= matrix.shape[-1]
        eigenvalues, vectors = spectrum(
            product_of_blocks(*((matrix, transposed) if wide else (transposed, matrix)))
        )
        back = jnp.swapaxes(vectors, -1, -2)
        left, right = (
            (vectors, product_of_blocks(back, matrix))
            if wide
            else (product_of_blocks(matrix, vectors), back)
        )
        left = plane_scales(geometry, wave)[..., None] * factor.transposed_matrix_times(left)
        return Decomposed(
            left.astype(dtype),
            right.astype(dtype),
            eigenvalues,
            unit,
        )

    return jax.lax.map(at, jax.tree.map(lambda leaf: leaf[start:stop], table))


@eqx.filter_jit
def _alphas_of(rule: Any, unit: Any, frequencies: Float[Array, " f"]) -> Float[Array, " f"]:
    """alpha of a rule at each frequency, by one program for all numbers [length²]."""
    rules = per_frequency(rule, unit.shape[0])
    return jax.vmap(lambda each, *here: each.in_units_of(*here).alpha)(rules, unit, frequencies)
