"""Tikhonov regularisation in cylindrical waves: one small system per frequency, all directions.

The densities rho = A^T (A A^T + alpha)^-1 u_xi give fhat(xi) = rho·(√w G) / 2π. A and G are real,
so with one solution y for all directions

    (A A^T + alpha) y = A √w G,   fhat(xi) = (1/2π) b_xi^T R^T y,   u_xi = R b_xi,

where the entries of b_xi are eps_n Delta_n (-i)^n (cos|sin)(n theta_xi): c = eps Delta R^T y are
the coefficients of the circular harmonics of fhat.

On a disk R is diagonal. Elsewhere it is not needed: with K = M M^T, G = R^T R and x = R^-1 y

    (K G + alpha) x = M √w G_J|Y,   R^T y = G x,

which is one decomposition of a matrix that is not symmetric, in place of that of the traces, the
product R K R^T, and one that is.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int

from ...base.parallel import map_shards
from ...regularization import seen_once
from ...regularization.alpha import Problem, TikhonovRule
from .cut_disks import CutDisk, cut_disk
from .linear_systems import cholesky_solve, conjugate_gradients, lu_solve, product_of_blocks
from .polar import PolarGeometry
from .table import (
    RegionFactor,
    WaveTable,
    alpha_unit,
    blocks,
    circle_gram,
    cut_gram,
    detector_matrix,
    detector_powers,
    gram_matrix,
    pairs,
    product_of_grams,
    region_factor,
    region_gram,
    scaled_gram,
    with_matrix,
)
from .waves import angular

MAX_ITERATIONS = 500


class SolveReport(eqx.Module):
    """How the systems were solved, per frequency.

    Attributes:
        alpha: in the unit of A A^T [length²].
        relative_alpha: in the unit in which numbers are given, see `Tikhonov`.
        residual: largest ||(A A^T + alpha) y - A G|| / ||A G|| of the images.
        iterations: of conjugate gradients, the most of all images; 0 for a factorisation.
        converged: whether the residual is as small as was asked (all finite for a factorisation).
    """

    alpha: Float[Array, "*frequencies"]
    relative_alpha: Float[Array, "*frequencies"]
    residual: Float[Array, "*frequencies"]
    iterations: Int[Array, "*frequencies"]
    converged: Bool[Array, "*frequencies"]


class Asked(eqx.Module):
    """Norms and noise at every frequency, which rules depend on, and the rule; frequencies first.

    Attributes:
        noise_power: mean square of √w (G_J, G_Y) for white noise of variance 1 in g.
        unit_norm: N(lambda); anything for rules that do not ask for it.
        rule: gives alpha.
    """

    noise_power: Float[Array, "*f"]
    unit_norm: Float[Array, "*f"]
    rule: TikhonovRule


class _System(eqx.Module):
    """The system of one frequency.

    Attributes:
        values: Σ_k w_k (cos|sin)(n theta_k) G_k, (..., images, 2, 2, orders), or w G, (..., images,
            2, detectors), if the detectors do not lie on a circle: summed over the detectors
            beforehand where that is alike at all frequencies.
        power: mean square of √w (G_J, G_Y).
        asked: noise, norm and rule.
    """

    values: Array
    power: Float[Array, "*f"]
    asked: Asked


class _Tables(eqx.Module):
    """Tables that do not depend on the frequency.

    Attributes:
        detectors: T of detectors on a circle.
        region: of a cut disk.
    """

    detectors: Float[Array, "blocks r r"] | None
    region: CutDisk | None


def solve_harmonics(
    geometry: PolarGeometry,
    table: WaveTable,
    groups: tuple[tuple[int, int, int], ...],
    transformed: Float[Array, "frequencies images 2 detectors"],
    asked: Asked,
    solver: str,
    tolerance: Array | float,
    mesh: Mesh | None = None,
) -> tuple[Float[Array, "images frequencies 2 orders"], SolveReport]:
    """Circular harmonics c of fhat, by which fhat(xi) = (1/2π) Σ_n (-i)^n c_n·(cos|sin)(n theta).

    Args:
        geometry: curve and region.
        table: waves of all frequencies, up to the most orders of all groups.
        groups: (first, last + 1, orders) of frequencies that are solved alike.
        transformed: (G_J, G_Y), frequencies first.
        asked: noise, norm and rule of every frequency.
        solver: "cholesky" or "cg".
        tolerance: relative residual at which conjugate gradients stop.
        mesh: devices that share the frequencies of every group.

    Returns:
        c, zero beyond the orders of a frequency, and how the systems were solved.
    """
    n_max = max(orders for *_, orders in groups)
    with_factor = geometry.disk or asked.rule.needs_matrix
    tables = _Tables(
        circle_gram(geometry, n_max) if solver == "cholesky" and geometry.on_circle else None,
        cut_disk(geometry, n_max) if solver == "cholesky" and not with_factor else None,
    )

    def at(
        orders: int, common: tuple[PolarGeometry, _Tables], wave: WaveTable, system: _System
    ) -> tuple[Array, SolveReport]:
        geometry, tables = common
        wave = with_matrix(geometry, wave.up_to(orders))
        gram = None if tables.detectors is None else cut_gram(geometry, tables.detectors, orders)
        if solver == "cg":
            found, report = _iterated(geometry, wave, system, tolerance)
        elif with_factor:
            found, report = _factorised(geometry, wave, system, gram)
        else:
            shared = None if tables.region is None else tables.region.up_to(orders)
            found, report = _without_factor(geometry, wave, system, gram, shared)
        harmonics = wave.plane_scale * pairs(found)
        return jnp.pad(harmonics, [(0, 0)] * 2 + [(0, n_max - orders)]), report

    # One loop over all frequencies, and in it the program of the frequency's group. With a loop for
    # each group XLA on CPUs runs them at once, and their calls of the linear algebra library have
    # been seen to wait for each other's threads for ever.
    programs = [partial(at, orders) for *_, orders in groups]
    group = np.repeat(np.arange(len(groups)), [stop - start for start, stop, _ in groups])

    @jax.checkpoint
    def choose(common: Any, given: tuple[Array, WaveTable, _System]) -> tuple[Array, SolveReport]:
        number, wave, system = given
        return jax.lax.switch(number, programs, common, wave, system)

    harmonics, report = map_shards(
        lambda common, share: jax.lax.map(partial(choose, common), share),
        (geometry, tables),
        (jnp.asarray(group), table, _summed(geometry, transformed, asked, n_max)),
        mesh,
    )
    return jnp.moveaxis(harmonics, 1, 0), report


def _summed(geometry: PolarGeometry, transformed: Array, asked: Asked, n_max: int) -> _System:
    """One product of matrices for all frequencies, if the detectors lie on a circle."""
    values = transformed * geometry.weights
    power = jnp.mean(values * transformed, axis=(-3, -2, -1))
    return _System(summed_over_detectors(geometry, values, n_max), power, asked)


def summed_over_detectors(
    geometry: PolarGeometry, values: Float[Array, "*batch detectors"], n_max: int
) -> Array:
    """`_System.values` from w G."""
    if not geometry.on_circle:
        return values
    return jnp.einsum("pnk,...k->...pn", angular(n_max, geometry.detector_angles), values)


def moments(
    geometry: PolarGeometry, wave: WaveTable, values: Float[Array, "images 2 ..."]
) -> Float[Array, "images blocks r"]:
    """M √w √w G, of one frequency, from `_System.values`."""
    if wave.on_circle is None:
        return jnp.einsum("jbrk,ijk->ibr", detector_matrix(geometry, wave), values)
    harmonics = values[..., : wave.on_circle.shape[-1]]
    return blocks(geometry, jnp.einsum("jn,ijpn->ipn", wave.on_circle, harmonics))


def normal_matrix(
    geometry: PolarGeometry,
    wave: WaveTable,
    factor: RegionFactor,
    gram: Float[Array, "blocks r r"] | None,
) -> Float[Array, "blocks m m"]:
    """A A^T of one frequency."""
    if gram is None:
        return factor.around(detector_gram(geometry, wave, None))
    a, b = _on_circle(geometry, wave)
    return gram_matrix(a, b, gram, factor)


def detector_gram(
    geometry: PolarGeometry, wave: WaveTable, gram: Float[Array, "blocks r r"] | None
) -> Float[Array, "blocks r r"]:
    """K = M M^T of one frequency."""
    if gram is None:
        waves = detector_matrix(geometry, wave)
        return jnp.einsum("jbrk,jbsk->brs", waves * geometry.weights, waves)
    a, b = _on_circle(geometry, wave)
    return scaled_gram(a, b, gram)


def _detector_powers(
    geometry: PolarGeometry, wave: WaveTable, gram: Float[Array, "blocks r r"] | None
) -> Float[Array, "blocks r"]:
    """The diagonal of M M^T; on a circle from that of T, which is there."""
    if gram is None:
        return detector_powers(geometry, wave)
    a, b = _on_circle(geometry, wave)
    return (a**2 + b**2) * jnp.diagonal(gram, axis1=-2, axis2=-1)


def _factorised(
    geometry: PolarGeometry, wave: WaveTable, system: _System, gram: Array | None
) -> tuple[Array, SolveReport]:
    """R^T y by Cholesky decomposition, with implicit derivatives: one more solve each."""
    factor = region_factor(geometry, wave)
    matrix = normal_matrix(geometry, wave, factor, gram)
    diagonal = jnp.diagonal(matrix, axis1=-2, axis2=-1)
    unit = alpha_unit(factor.powers, _detector_powers(geometry, wave, gram))
    plane = None
    if system.asked.rule.needs_matrix:
        plane = factor.around(_diagonal_matrix(blocks(geometry, _plane_power(wave))))
    alpha = system.asked.rule.absolute(
        _problem(geometry, wave, system, diagonal, unit, matrix, plane)
    )
    shifted = matrix + alpha * jnp.eye(matrix.shape[-1])
    rhs = factor.times(moments(geometry, wave, system.values))
    rhs = jnp.moveaxis(rhs, 0, -1)  # images last, as columns
    y = cholesky_solve(shifted, rhs)
    residual = _relative(product_of_blocks(shifted, y) - rhs, rhs, axes=(0, 1))
    found = factor.transposed_times(jnp.moveaxis(y, -1, 0))
    return found, _solved_directly(alpha, unit, residual)


def _without_factor(
    geometry: PolarGeometry,
    wave: WaveTable,
    system: _System,
    gram: Array | None,
    shared: CutDisk | None,
) -> tuple[Array, SolveReport]:
    """R^T y = G x by LU decomposition of K G + alpha, with implicit derivatives."""
    inner, outer = detector_gram(geometry, wave, gram), region_gram(geometry, wave, shared)
    matrix = product_of_grams(geometry, inner, outer)
    inner_diagonal, outer_diagonal, diagonal = (
        jnp.diagonal(part, axis1=-2, axis2=-1) for part in (inner, outer, matrix)
    )
    unit = alpha_unit(outer_diagonal, inner_diagonal)
    alpha = system.asked.rule.absolute(_problem(geometry, wave, system, diagonal, unit, None, None))
    matrix += alpha * jnp.eye(matrix.shape[-1])
    rhs = jnp.moveaxis(moments(geometry, wave, system.values), 0, -1)  # images last, as columns
    x = lu_solve(matrix, rhs)
    residual = _relative(product_of_blocks(matrix, x) - rhs, rhs, axes=(0, 1))
    found = jnp.moveaxis(product_of_blocks(outer, x), -1, 0)
    return found, _solved_directly(alpha, unit, residual)


def _solved_directly(alpha: Array, unit: Array, residual: Array) -> SolveReport:
    finite = jnp.isfinite(residual)
    return SolveReport(alpha, alpha / unit, residual, jnp.zeros((), int), finite)


def _iterated(
    geometry: PolarGeometry,
    wave: WaveTable,
    system: _System,
    tolerance: Array | float,
) -> tuple[Array, SolveReport]:
    """R^T y by conjugate gradients; derivatives are one more solve each, not of the iteration."""
    factor = region_factor(geometry, wave)
    multiply, inner_diagonal = _products(geometry, wave)
    diagonal = _diagonal(geometry, wave, factor, inner_diagonal)
    unit = alpha_unit(factor.powers, inner_diagonal)
    alpha = system.asked.rule.absolute(_problem(geometry, wave, system, diagonal, unit, None, None))
    rhs = factor.times(moments(geometry, wave, system.values))
    precondition = factor.inverse_around(inner_diagonal, alpha)

    def matrix(y: Array) -> Array:
        return factor.times(multiply(factor.transposed_times(y))) + alpha * y

    def solve(product: Callable[[Array], Array], right: Array) -> tuple[Array, Array]:
        return conjugate_gradients(product, precondition, right, tolerance, MAX_ITERATIONS)

    y, steps = jax.lax.custom_linear_solve(
        jax.vmap(matrix), rhs, solve, symmetric=True, has_aux=True
    )
    residual = _relative(jax.vmap(matrix)(y) - rhs, rhs, axes=(1, 2))
    # the residual of the recurrence drifts off the true one by rounding
    converged = residual <= 10 * tolerance
    report = SolveReport(alpha, alpha / unit, residual, steps, converged)
    return factor.transposed_times(y), report


def _products(
    geometry: PolarGeometry, wave: WaveTable
) -> tuple[Callable[[Array], Array], Float[Array, "blocks r"]]:
    """v -> M M^T v, and the diagonal of M M^T.

    Off a circle by exact sums over the detectors. On a circle T v is v as a function of the angle,
    times the density of detectors, as Fourier coefficients again: two real FFTs, which need the
    density up to the order 2 N only.
    """
    if wave.on_circle is None:
        matrix = detector_matrix(geometry, wave)
        weighted = matrix * geometry.weights

        def exact(v: Array) -> Array:
            return jnp.einsum("jbrk,jbk->br", matrix, jnp.einsum("jbrk,br->jbk", weighted, v))

        return exact, jnp.einsum("jbrk,jbrk->br", matrix, weighted)
    on_circle = wave.on_circle
    n_max = on_circle.shape[-1] - 1
    cosine, sine = angular(2 * n_max, geometry.detector_angles) @ geometry.weights
    length = 2 ** math.ceil(math.log2(4 * n_max + 2))
    density = jnp.fft.irfft(cosine - 1j * sine, length)

    def by_fft(v: Array) -> Array:
        waves = on_circle[:, None, :] * pairs(v)  # (J|Y, cos|sin, orders)
        halves = jnp.where(jnp.arange(n_max + 1) == 0, 1.0, 0.5)
        function = jnp.fft.irfft((waves[:, 0] - 1j * waves[:, 1]) * halves, length)
        product = jnp.fft.rfft(function * density)[:, : n_max + 1] * length
        found = jnp.stack([product.real, -product.imag], axis=1)
        found = found.at[:, 1, 0].set(0.0)  # sin 0
        return blocks(geometry, jnp.einsum("jn,jpn->pn", on_circle, found))

    total = jnp.sum(geometry.weights)
    twofold = jnp.stack([total + cosine[::2], jnp.maximum(total - cosine[::2], 0.0)]) / 2
    power = jnp.sum(on_circle**2, axis=0)
    return by_fft, blocks(geometry, power * twofold)


def _diagonal(
    geometry: PolarGeometry,
    wave: WaveTable,
    factor: RegionFactor,
    inner_diagonal: Float[Array, "blocks r"],
) -> Float[Array, "blocks m"]:
    """The diagonal of A A^T. A triangle R mixes waves, which takes all of M M^T."""
    if factor.is_diagonal:
        return factor.values**2 * inner_diagonal
    matrix = jnp.moveaxis(detector_matrix(geometry, wave), 0, -2)
    matrix *= jnp.sqrt(geometry.weights)
    matrix = factor.matrix_times(matrix.reshape(*matrix.shape[:2], -1))
    return jnp.sum(matrix**2, axis=-1)


def _plane_power(wave: WaveTable) -> Float[Array, "2 orders"]:
    """Mean square of the entries of b_xi over all directions."""
    square = wave.plane_scale**2 / 2
    return jnp.stack([square.at[0].multiply(2.0), square.at[0].set(0.0)])


def _problem(
    geometry: PolarGeometry,
    wave: WaveTable,
    system: _System,
    diagonal: Array,
    unit: Array,
    matrix: Array | None,
    plane: Array | None,
) -> Problem:
    n_data = 2 * geometry.detector_angles.shape[0]
    return Problem(
        matrix=matrix,
        plane=plane,
        diagonal=diagonal,
        unit_norm=system.asked.unit_norm,
        data_power=system.power,
        noise_power=system.asked.noise_power,
        seen_once=seen_once(wave.frequencies),
        unit=unit,
        n_data=n_data,
    )


def _on_circle(geometry: PolarGeometry, wave: WaveTable) -> Float[Array, "2 blocks r"]:
    """a and b for cosines and sines."""
    waves = wave.on_circle
    assert waves is not None
    return blocks(geometry, jnp.stack([waves, waves], axis=1))


def _diagonal_matrix(values: Float[Array, "blocks r"]) -> Float[Array, "blocks r r"]:
    return jax.vmap(jnp.diag)(values)


def _relative(residual: Array, rhs: Array, axes: tuple[int, int]) -> Array:
    """The largest ratio of norms over the images; 0 for a right-hand side that is zero."""
    size = jnp.sum(rhs**2, axis=axes)
    ratio = jnp.sum(residual**2, axis=axes) / jnp.where(size > 0, size, 1.0)
    return jnp.sqrt(jax.lax.stop_gradient(ratio).max())
