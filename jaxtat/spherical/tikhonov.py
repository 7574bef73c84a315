"""Steps 1 and 3 on rings: one small real system for each frequency and azimuthal order.

On rings of equispaced detectors the orders m do not mix. With P the Legendre functions at the
rings (degrees l >= m), W the rings' areas, a_l = s_l 4π Delta_l j_l(lambda R_g) and b_l, likewise
with y_l, the Tikhonov solution of `cylindrical_waves.tikhonov` is

    [(a a^T + b b^T) ∘ T_m + alpha] y = a ∘ P W G_J,m + b ∘ P W G_Y,m,   T_m = P W P^T,

c_lm = Delta_l s_l y_l; in a cut ball s is replaced by the triangle R of the waves' traces. T_m does
not depend on lambda. Real and imaginary parts of the data's series are two right-hand sides.
"""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Complex, Float, Int

from ..base.parallel import map_shards
from ..densities.cylindrical_waves.normal_equations import scaled_gram
from ..densities.cylindrical_waves.table import RegionFactor, triangle
from ..geometry import BallBody
from ..geometry.balls import Ball, Boundary
from ..geometry.caps import SphericalCap
from ..regularization import SolveReport, TikhonovRule, relative_residual, tikhonov_solution
from ..special import legendre_functions
from ..steps.radial_transforms import kernel_noise_power
from .alpha import absolute_alpha
from .polar_fourier import polar_cosines, synthesis
from .radial_transform import azimuthal_transform, spherical_kernels
from .sizes import SpaceSizes
from .waves import CapWaves, boundary_radial, boundary_traces, cap_waves, order_slice


class _Group(eqx.Module):
    """What all orders m of a group of frequencies share."""

    cosines: Float[Array, " rings"]
    areas: Float[Array, " rings"]
    boundary: Boundary | None
    waves: CapWaves
    scale: Float[Array, "f padded"]
    radial: Float[Array, "f 3 points padded"] | None
    alpha: Float[Array, " f"]
    data: Float[Array, "rings n_orders f 2 images 2"]


@eqx.filter_jit
def solve_rings(
    cap: SphericalCap,
    region: Ball,
    radii: Float[Array, " radii"],
    g: Float[Array, "*batch rings azimuths radii"],
    rule: TikhonovRule,
    sizes: SpaceSizes,
    medium: BallBody | None = None,
    mesh: Mesh | None = None,
) -> tuple[Complex[Array, "images frequencies 2 polar orders"], SolveReport]:
    """F of `polar_fourier.synthesis` for all orders and frequencies, and how it was solved.

    Args:
        cap, region: the geometry.
        radii, g: spherical integrals; all leading axes become one, here and not before, as data of
            a large volume are better not copied.
        rule: regularisation, one entry per frequency.
        sizes: of the setup.
        medium: a body about the centre of the cap.
        mesh: devices that share the groups of frequencies.
    """
    stack = g.reshape(-1, *g.shape[-3:])

    def by_group(leaf: Array) -> Array:
        return leaf.reshape(len(sizes.groups), sizes.in_group, *leaf.shape[1:])

    def of_group(
        common: tuple[Any, ...], given: tuple[Array, Array, TikhonovRule]
    ) -> tuple[Array, SolveReport]:
        cap, region, radii, stack, medium = common
        number, frequencies, rule = given
        where = cap, region, radii, stack
        shared, relative = _shared(*where, rule, sizes, frequencies, medium)
        spectrum, residual = _solve_group(shared, number, sizes)
        report = SolveReport(shared.alpha, relative, residual, jnp.isfinite(residual))
        return spectrum, report

    numbers, rules = jnp.arange(len(sizes.groups)), jax.tree.map(by_group, rule)
    spectrum, report = map_shards(
        lambda common, share: jax.lax.map(partial(of_group, common), share),
        (cap, region, radii, stack, medium),
        (numbers, by_group(sizes.frequencies), rules),
        mesh,
    )
    # from (groups, in_group, images, 2, polar, orders); of one image nothing is moved
    spectrum = jnp.moveaxis(spectrum, 2, 0)
    spectrum = spectrum.reshape(spectrum.shape[0], -1, *spectrum.shape[3:])
    return spectrum, jax.tree.map(lambda leaf: leaf.reshape(-1), report)


def _solve_group(
    shared: _Group, number: Int[Array, ""], sizes: SpaceSizes
) -> tuple[Complex[Array, "f images 2 polar orders"], Float[Array, " f"]]:
    """F and residuals of neighbouring frequencies, some orders at a time.

    One loop over all pieces of the orders, in which the program for the number of degrees is
    chosen: loops side by side may run at once, and take the memory of all.
    """
    distinct = sorted({size for row in sizes.degrees for size in row})
    chosen = jnp.asarray(np.searchsorted(distinct, sizes.degrees))[number]
    programs = [partial(_solve_orders, size, distinct[-1]) for size in distinct]
    polar = polar_cosines(sizes.n_directions)
    points = [shared.cosines, polar]
    if shared.boundary is not None:
        points.append(shared.boundary.cosine)
    ends = np.cumsum([len(part) for part in points])[:-1]

    @jax.checkpoint
    def of_piece(shared: _Group, cosines: Array, piece: Array) -> tuple[Array, Array]:
        orders = piece * sizes.piece + jnp.arange(sizes.piece)
        data = jax.lax.dynamic_slice_in_dim(shared.data, orders[0], sizes.piece, axis=1)
        highest = sizes.n_pieces * sizes.piece - 1
        # one degree more than the systems have is for derivatives at the boundary
        table = legendre_functions(orders, distinct[-1] + 1, cosines, highest)
        at_rings, at_polar, *at_boundary = jnp.split(table, ends, axis=-1)
        given = orders, jnp.moveaxis(data, 1, 0), at_rings, at_boundary
        coefficients, squares = jax.lax.switch(chosen[piece], programs, shared, given)
        spectrum = jax.lax.map(
            lambda item: synthesis(*item), (orders, coefficients, at_polar[:, :-1])
        )
        return spectrum, squares

    spectrum, squares = jax.lax.map(
        partial(of_piece, shared, jnp.concatenate(points)), jnp.arange(sizes.n_pieces)
    )
    # (residual|right-hand side, frequencies, images)
    residual = relative_residual(jnp.sum(squares, axis=(0, 1)))
    spectrum = spectrum.reshape(-1, *spectrum.shape[2:])[: sizes.n_orders]
    return jnp.moveaxis(spectrum, 0, -1), residual


def _shared(
    cap: SphericalCap,
    region: Ball,
    radii: Float[Array, " radii"],
    g: Float[Array, "images rings azimuths radii"],
    rule: TikhonovRule,
    sizes: SpaceSizes,
    frequencies: Float[Array, " f"],
    medium: BallBody | None = None,
) -> tuple[_Group, Float[Array, " f"]]:
    """Step 2 and the waves of some frequencies; and alpha over the largest diagonal entry."""
    kernels, areas = spherical_kernels(radii, frequencies, medium), cap.ring_areas
    n_padded = sizes.n_pieces * sizes.piece
    data, power = azimuthal_transform(g, kernels, cap.first_azimuths, sizes.n_orders, n_padded)
    factor = cap.element_factor(sizes.groups[-1] + 1, sizes.n_nodes)
    waves = cap_waves(frequencies, region.radius, cap.radius, sizes.groups[-1], factor, medium)
    n_detectors = cap.n_rings * cap.n_azimuths
    alpha, relative = absolute_alpha(
        rule,
        frequencies,
        jnp.sum(waves.at_detectors**2, axis=1) * waves.norms**2 * jnp.sum(areas) / (4 * jnp.pi),
        power @ areas / n_detectors,
        kernel_noise_power(kernels, areas / cap.n_azimuths),
        2 * n_detectors,
    )

    def padded(values: Array) -> Array:
        return jnp.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, n_padded)])

    boundary = radial = None
    if sizes.boundary is not None:
        boundary = region.boundary(sizes.boundary)
        radial = boundary_radial(boundary, frequencies, waves.steps)
        radial = padded(jnp.swapaxes(radial, -1, -2))
    return _Group(
        cosines=cap.cosines,
        areas=areas,
        boundary=boundary,
        waves=CapWaves(frequencies, waves.steps, padded(waves.at_detectors), padded(waves.norms)),
        scale=padded(waves.scale),
        radial=radial,
        alpha=alpha,
        data=data,
    ), relative


def _solve_orders(
    size: int, n_degrees: int, shared: _Group, given: tuple[Array, Array, Array, list[Array]]
) -> tuple[Complex[Array, "piece f degrees images"], Float[Array, "piece 2 f images"]]:
    """c_lm of some orders m, of which degrees l = m .. m + size - 1 are solved for."""
    n_orders, (n_frequencies, n_images) = given[0].shape[0], shared.data.shape[2:5:2]
    if size == 0:
        coefficients = jnp.zeros((n_orders, n_frequencies, n_degrees, n_images), complex)
        return coefficients, jnp.zeros((n_orders, 2, n_frequencies, n_images))

    def of_order(given: tuple[Array, Array, Array, list[Array]]) -> tuple[Array, Array]:
        order, data, at_rings, at_boundary = given
        at_boundary = at_boundary[0][: size + 1] if at_boundary else None
        return _solve_order(shared, order, data, at_rings[:size], at_boundary)

    coefficients, squares = jax.lax.map(of_order, given)
    return jnp.pad(coefficients, ((0, 0), (0, 0), (0, n_degrees - size), (0, 0))), squares


def _solve_order(
    shared: _Group,
    order: Int[Array, ""],
    data: Float[Array, "rings f 2 images 2"],
    at_rings: Float[Array, "degrees rings"],
    at_boundary: Float[Array, "one_more points"] | None,
) -> tuple[Complex[Array, "f degrees images"], Float[Array, "2 f images"]]:
    """c_lm of all frequencies and one order m, and the squares that make the residual."""
    size = at_rings.shape[0]
    weighted = at_rings * shared.areas
    gram = weighted @ at_rings.T
    moments = weighted @ data.reshape(data.shape[0], -1)
    moments = jnp.moveaxis(moments.reshape(size, *data.shape[1:]), 1, 0)
    waves = shared.waves

    def at(given: tuple[Any, ...]) -> tuple[Array, Array]:
        at_detectors, norms, scale, radial, alpha, moment = given
        a, b = order_slice(at_detectors, order, size)
        if at_boundary is None:
            factor = RegionFactor(order_slice(norms, order, size)[None])
        else:
            assert shared.boundary is not None
            sliced = jnp.swapaxes(order_slice(radial, order, size), -1, -2)
            traces = boundary_traces(order, at_boundary, sliced, shared.boundary)
            factor = RegionFactor(triangle(traces[None]))
        matrix = factor.around(scaled_gram(a[None], b[None], gram[None]))
        columns = a[:, None] * moment[:, 0].reshape(size, -1)
        columns += b[:, None] * moment[:, 1].reshape(size, -1)
        rhs = factor.matrix_times(columns[None])
        y, squares = tikhonov_solution(matrix, alpha, rhs)
        squares = squares.reshape(2, *moment.shape[2:]).sum(axis=-1)  # of real and imaginary part
        coefficients = (
            order_slice(scale, order, size)[:, None] * factor.transposed_matrix_times(y)[0]
        )
        return coefficients, squares

    given = (waves.at_detectors, waves.norms, shared.scale, shared.radial, shared.alpha, moments)
    coefficients, squares = jax.lax.map(at, given)
    parts = coefficients.reshape(*coefficients.shape[:2], -1, 2)
    return jax.lax.complex(parts[..., 0], parts[..., 1]), jnp.moveaxis(squares, 1, 0)
