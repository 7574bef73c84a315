"""Step 1 in cylindrical waves, kept in a compact form: rows per order instead of per direction.

The singular value decomposition A = P diag(sigma) Q^T of one frequency gives

    fhat(xi) = (1/2π) Σ_j phi_j (p_j·u_xi / sigma_j) q_j·√w G,   u_xi = R b_xi.

What all directions keep of a component, min_xi phi_j, makes one row per order n of the circular
harmonics, c = eps Delta R^T P diag(phi / sigma) Q^T √w G; what single directions keep beyond it,
a few components around the norm bound, stays a row q_j with its factors. In a mirrored geometry
rows act on the even and odd parts of the data, which are half as long.
"""

from collections.abc import Iterator, Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ...base.checks import is_concrete
from ...base.precision import in_full
from ...regularization import SINGULAR, Regularization, per_frequency, singular_components
from ...regularization.filtered import filtered_solve
from ...special import angular
from ..stored import Densities, DensityReport, density_report, in_precision
from .polar import PolarGeometry, half_weights
from .table import (
    RegionFactor,
    WaveTable,
    alpha_unit,
    blocks,
    detector_matrix,
    detector_powers,
    pairs,
    region_factor,
)
from .waves import circular_harmonics_at, minus_i_powers

ROUNDING = 1e-11  # relative size of rows and components that are left out
_SIZES = 16  # orders and components are kept in multiples of this, as far as there are any


class Factors(eqx.Module):
    """left diag(kept) right, applied without being formed: another rule is another ``kept``."""

    left: Float[Array, "*f blocks r k"]
    kept: Float[Array, "*f blocks k"]
    right: Float[Array, "*f blocks k columns"]

    def __matmul__(self, columns: Array) -> Array:
        return self.left @ (self.kept[..., None] * (self.right @ columns))

    def formed(self) -> Float[Array, "*f blocks r columns"]:
        return self.left @ (self.kept[..., None] * self.right)

    @property
    def shape(self) -> tuple[int, ...]:
        return (*self.left.shape[:-1], self.right.shape[-1])

    @property
    def dtype(self) -> np.dtype:
        return self.left.dtype


class DensityGroup(eqx.Module):
    """Rows of frequencies that have the same number of orders; one precision for all.

    Attributes:
        rows: to the circular harmonics, (frequencies, blocks, r, columns).
        extra_rows: q_j of components that only some directions keep, or keep more of.
        extra: their factors (phi_j - min phi_j) p_j·u_xi / sigma_j.
    """

    rows: Float[Array, "*f blocks r columns"] | Factors
    extra_rows: Float[Array, "*f blocks extra columns"]
    extra: Complex[Array, "*f blocks extra directions"]

    @property
    def n_orders(self) -> int:
        return self.rows.shape[-3] * self.rows.shape[-2] // 2


def rows_alone(rows: Factors, n_directions: int) -> DensityGroup:
    """A group without components of single directions."""
    none = np.empty((*rows.shape[:2], 0, rows.shape[-1]), rows.dtype)
    extra = np.empty((*rows.shape[:2], 0, n_directions), np.result_type(none, np.complex64))
    return DensityGroup(rows, *jax.device_put((none, extra)))


class CylindricalDensities(Densities):
    """The densities of all plane waves, 2 N + 1 rows and a few per frequency.

    Attributes:
        groups: in the order of the frequencies.
        angles: of the directions, counted from the axis [rad].
        phases: exp(i xi·(centre of the region - centre of the waves)).
        mirror: whether rows act on even and odd parts.
    """

    groups: tuple[DensityGroup, ...]
    angles: Float[Array, " directions"]
    phases: Complex[Array, "frequencies directions"]
    mirror: bool = eqx.field(static=True)

    @in_full
    def polar_fourier(self, transformed: Array, weights: Array) -> Array:
        *batch, n_frequencies, _, _ = transformed.shape
        pieces = []
        for group, part in self._parts(transformed, weights):
            harmonics = pairs(jnp.moveaxis(group.rows @ part, -1, 0))
            fhat = circular_harmonics_at(harmonics, self.angles.astype(part.dtype))
            if group.extra.shape[-2]:
                extra = group.extra_rows @ part
                fhat += jnp.einsum("fbed,fbei->ifd", group.extra, extra) / (2 * jnp.pi)
            pieces.append(fhat)
        fhat = jnp.concatenate(pieces, axis=-2) * self.phases
        return fhat.reshape(*batch, n_frequencies, -1)

    def _parts(self, transformed: Array, weights: Array) -> Iterator[tuple[DensityGroup, Array]]:
        """Each group, and the folded data of its frequencies, images last."""
        # images last: matrix products with many columns
        images = jnp.moveaxis(transformed.reshape(-1, *transformed.shape[-3:]), 0, -1)
        folded, start = fold(images, weights, self.mirror), 0
        for group in self.groups:
            stop = start + group.rows.shape[0]
            yield group, folded[start:stop].astype(group.rows.dtype)
            start = stop

    def of_frequency(self, number: int, weights: Array) -> Array:
        bounds = np.cumsum([0, *(group.rows.shape[0] for group in self.groups)])
        which = int(np.searchsorted(bounds, number, side="right")) - 1
        group = jax.tree.map(lambda leaf: leaf[number - bounds[which]], self.groups[which])
        rows = group.rows.formed() if isinstance(group.rows, Factors) else group.rows
        n_max = pairs(rows[..., 0]).shape[-1] - 1
        waves = angular(n_max, self.angles) * minus_i_powers(n_max)[:, None]
        waves = waves.reshape(*rows.shape[:2], -1)
        folded = jnp.einsum("brc,brd->dbc", rows, waves)
        folded += jnp.einsum("bec,bed->dbc", group.extra_rows, group.extra)
        densities = unfold(jnp.moveaxis(folded, 0, -1), weights, self.mirror)
        return densities * self.phases[number][:, None, None] / weights

    def in_single_precision(self) -> "CylindricalDensities":
        groups = in_precision(self.groups, jnp.float32)
        return CylindricalDensities(groups, self.angles, self.phases, self.mirror)


def fold(
    transformed: Float[Array, "*f 2 detectors images"],
    weights: Float[Array, " detectors"],
    mirror: bool,
) -> Float[Array, "*f blocks columns images"]:
    """√w (G_J, G_Y) as blocks of columns (J|Y, detectors).

    In a mirrored geometry its even and odd part on one half of the detectors.
    """
    parts = transformed[..., None, :, :, :]
    if mirror:
        weights = half_weights(weights)
        here = transformed[..., : weights.shape[0], :]
        there = transformed[..., ::-1, :][..., : weights.shape[0], :]
        parts = jnp.stack([here + there, here - there], axis=-4) / 2
    scaled = parts * jnp.sqrt(weights)[:, None]
    return scaled.reshape(*scaled.shape[:-3], -1, scaled.shape[-1])


def unfold(
    columns: Complex[Array, "blocks columns directions"],
    weights: Float[Array, " detectors"],
    mirror: bool,
) -> Complex[Array, "directions 2 detectors"]:
    """w rho with w rho·G = columns·fold(G) for all G: the transpose of folding."""
    shape = jax.ShapeDtypeStruct((2, weights.shape[0], columns.shape[-1]), jnp.float64)
    transpose = jax.linear_transpose(lambda g: fold(g, weights, mirror), shape)
    (real,), (imaginary,) = transpose(columns.real), transpose(columns.imag)
    return jnp.moveaxis(jax.lax.complex(real, imaginary), -1, 0)


class Step(eqx.Module):
    """One frequency's contribution to a group, and the corrections of single directions."""

    rows: Float[Array, "*f blocks r columns"]
    right: Float[Array, "*f blocks k columns"]
    extra: Complex[Array, "*f blocks k directions"]


@eqx.filter_jit
def cylindrical_densities(
    geometry: PolarGeometry,
    table: WaveTable,
    n_max: int,
    unit_norms: Float[Array, "f *one_or_directions"],
    angles: Float[Array, " directions"],
    regularization: Regularization,
) -> tuple[Step, DensityReport]:
    """Components of the densities at frequencies that have the same number of orders.

    Args:
        geometry: curve and region.
        table: the waves of the frequencies.
        n_max: how many of their orders are used.
        unit_norms: N(lambda), the norm in which `NormBound` measures [1/length^(1/2)].
        angles: theta, counted from the axis [rad].
        regularization: which singular components are kept, at all frequencies or at each.
    """

    # The decomposition and the amplitudes are kept: made anew in reverse mode, by another program,
    # rounding may turn singular vectors or change their signs, and amplitudes that are rounding
    # over tiny sigma_j come out otherwise: rows, q_j and factors no longer belong together.
    @partial(jax.checkpoint, policy=jax.checkpoint_policies.save_only_these_names(SINGULAR))
    def at(arguments: tuple[WaveTable, Array, Regularization]) -> tuple[Step, DensityReport]:
        wave, unit_norm, rule = arguments[0].up_to(n_max), *arguments[1:]
        matrix, rhs, factor, unit = wave_system(geometry, wave, angles)
        rule = rule.in_units_of(unit, wave.frequencies)
        components = singular_components(matrix, rhs, rule, unit_norm)
        common = components.factors.min(axis=-1) * components.inverse
        outward = factor.transposed_matrix_times(components.left)
        scale = plane_scales(geometry, wave)
        beyond = components.factors - components.factors.min(axis=-1, keepdims=True)
        step = Step(
            rows=scale[..., None] * (outward @ (common[..., None] * components.right)),
            right=components.right,
            extra=beyond * components.amplitudes,
        )
        report = density_report(components, unit_norm)
        return step, report

    return jax.lax.map(at, (table, unit_norms, per_frequency(regularization, unit_norms.shape[0])))


def group_of(steps: Sequence[Step]) -> DensityGroup:
    """Steps of neighbouring frequencies as one group, without components below rounding.

    High orders are needed to resolve the potentials, but hardly occur in plane waves. A group keeps
    as many direction-dependent components as the frequency that has most of them.
    """
    if not is_concrete(steps):
        step = jax.tree.map(lambda *parts: jnp.concatenate(parts), *steps)
        return DensityGroup(step.rows, step.right, step.extra)
    # numpy: nothing is compiled for sizes that occur once
    rows, right, extra = (
        np.concatenate([np.asarray(part) for part in parts])
        for parts in zip(*((s.rows, s.right, s.extra) for s in steps), strict=True)
    )
    largest = np.linalg.norm(rows, axis=-1).max()
    each = rows.reshape(rows.shape[0], 2, -1, rows.shape[-1])  # cosines and sines, orders
    matters = (np.linalg.norm(each, axis=-1) > ROUNDING * largest).any(axis=(0, 1))
    if not matters.any():
        raise ValueError(
            "the rule keeps no singular value at any frequency: expected a larger K or rank, or a "
            "lower cutoff."
        )
    each = each[:, :, : _rounded(int(np.flatnonzero(matters).max()) + 1)]
    weight = np.abs(extra).max(axis=-1)
    n_extra = _rounded(int((weight > ROUNDING * largest).sum(axis=-1).max()))
    first = np.argsort(-weight, axis=-1)[..., :n_extra, None]
    return DensityGroup(
        rows=jax.device_put(each.reshape(*rows.shape[:2], -1, rows.shape[-1])),
        extra_rows=jax.device_put(np.take_along_axis(right, first, axis=-2)),
        extra=jax.device_put(np.take_along_axis(extra, first, axis=-2)),
    )


def _rounded(size: int) -> int:
    """A size rounded up to one of a few: plans for other numbers of a rule share programs."""
    return -(-size // _SIZES) * _SIZES


@eqx.filter_jit
def alpha_units(geometry: PolarGeometry, table: WaveTable) -> Float[Array, " f"]:
    """`alpha_unit` at each frequency, the unit of `Tikhonov` [length²]."""

    @jax.checkpoint
    def at(wave: WaveTable) -> Array:
        return alpha_unit(region_factor(geometry, wave).powers, detector_powers(geometry, wave))

    return jax.lax.map(at, table)


@eqx.filter_jit
def sampled_cylindrical_densities(
    geometry: PolarGeometry,
    table: WaveTable,
    n_max: int,
    unit_norms: Float[Array, "f *one_or_directions"],
    angles: Float[Array, " directions"],
    regularization: Regularization,
) -> tuple[Complex[Array, "f directions 2 detectors"], DensityReport]:
    """The same densities at the detectors, phases counted from the centre of the waves.

    More memory than `cylindrical_densities`, but differentiable with respect to the geometry.
    """

    @jax.checkpoint
    def at(arguments: tuple[WaveTable, Array, Regularization]) -> tuple[Array, DensityReport]:
        wave, unit_norm, rule = arguments[0].up_to(n_max), *arguments[1:]
        matrix, rhs, _, unit = wave_system(geometry, wave, angles)
        rule = rule.in_units_of(unit, wave.frequencies)
        solution = filtered_solve(matrix, rhs, rule, unit_norm)
        densities = unfold(solution.q, geometry.weights, geometry.mirror) / geometry.weights
        report = density_report(solution, unit_norm)
        return densities, report

    return jax.lax.map(at, (table, unit_norms, per_frequency(regularization, unit_norms.shape[0])))


def wave_system(
    geometry: PolarGeometry, wave: WaveTable, angles: Float[Array, " directions"]
) -> tuple[
    Float[Array, "blocks m columns"],
    Complex[Array, "blocks m directions"],
    RegionFactor,
    Float[Array, ""],
]:
    """A and u_xi of one frequency, theta counted from the axis, R, and the unit of alpha."""
    matrix, factor, unit = wave_matrix(geometry, wave)
    plane = _plane_waves(geometry, wave, angles)
    rhs = jax.lax.complex(factor.matrix_times(plane.real), factor.matrix_times(plane.imag))
    return matrix, rhs, factor, unit


def wave_matrix(
    geometry: PolarGeometry, wave: WaveTable
) -> tuple[Float[Array, "blocks m columns"], RegionFactor, Float[Array, ""]]:
    """A of one frequency, R, and the unit of alpha."""
    factor, waves = region_factor(geometry, wave), detector_columns(geometry, wave)
    unit = alpha_unit(factor.powers, jnp.sum(waves**2, axis=-1))
    return factor.matrix_times(waves), factor, unit


def plane_scales(geometry: PolarGeometry, wave: WaveTable) -> Float[Array, "blocks r"]:
    """eps_n Delta_n of cosines and sines."""
    return blocks(geometry, jnp.broadcast_to(wave.plane_scale, (2, *wave.plane_scale.shape)))


def detector_columns(geometry: PolarGeometry, wave: WaveTable) -> Float[Array, "blocks r columns"]:
    """M, columns as in `fold`."""
    half = geometry.one_side() if geometry.mirror else geometry
    waves = detector_matrix(half, wave) * jnp.sqrt(half.weights)
    waves = jnp.moveaxis(waves, 0, -2)  # (blocks, r, J|Y, half)
    return waves.reshape(*waves.shape[:2], -1)


def _plane_waves(
    geometry: PolarGeometry, wave: WaveTable, angles: Array
) -> Complex[Array, "blocks r directions"]:
    """b_xi."""
    n_max = wave.plane_scale.shape[-1] - 1
    waves = wave.plane_scale[:, None] * angular(n_max, angles) * minus_i_powers(n_max)[:, None]
    return jnp.moveaxis(blocks(geometry, jnp.moveaxis(waves, -1, 0)), 0, -1)
