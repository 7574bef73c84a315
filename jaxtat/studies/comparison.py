"""Truncation, Tikhonov's regularisation and iterations side by side, at one frequency.

All three look for densities with S rho ≈ exp(-i xi·x) whose norm is moderate. What each buys is a
curve: the error of the plane waves against the norm of the densities, which is the gain of noise.
"""

import time
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from ..base.checks import (
    Numbers,
    is_concrete,
    real_array,
    require_objects,
    require_positive,
    require_x64,
)
from ..densities.cylindrical_waves import (
    PolarGeometry,
    polar_geometry,
    unfold,
    wave_orders,
    wave_system,
    wave_table,
)
from ..phantoms import Phantom, noise_like
from ..reconstruction import Setup
from ..reconstruction.setup import plane_of, require_one_speed
from ..regularization import NormBound, Tikhonov, unit_norms
from ..regularization.filtered import filtered_solve
from ..steps import polar_grid
from ..steps.radial_transforms import radial_transform
from .ridge_solver import ridge


class TradeOff(eqx.Module):
    """One method at several values of its parameter.

    Attributes:
        parameter: K, or alpha in units of the strongest wave, `alpha_unit`.
        residual: relative L2 error of the plane waves' traces, root mean square over directions.
        norm: ||rho|| over N(lambda), root mean square over directions: the gain of noise.
        clean: relative L2 error of the image's part at this frequency, from exact data.
        noisy: the same from noisy data.
        seconds: time to solve for all directions, compiled beforehand.
        iterations: 0 for a factorisation.
        converged: whether what was asked for was reached.
    """

    parameter: Float[Array, " values"]
    residual: Float[Array, " values"]
    norm: Float[Array, " values"]
    clean: Float[Array, " values"]
    noisy: Float[Array, " values"]
    seconds: Float[Array, " values"]
    iterations: Int[Array, " values"]
    converged: Bool[Array, " values"]


class RuleComparison(eqx.Module):
    """Three curves.

    Attributes:
        truncation: the paper's bound on the norm, of singular components.
        tikhonov: Tikhonov's filter of the same components.
        iterative: Tikhonov's minimum by jaxopt.
    """

    truncation: TradeOff
    tikhonov: TradeOff
    iterative: TradeOff


def compare_regularizations(
    setup: Setup,
    phantom: Phantom,
    frequency: Numbers,
    *,
    K: Numbers = (1.5, 2.0, 3.0, 4.3, 6.0, 10.0),
    alpha: Numbers = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8),
    noise: float = 0.05,
    seed: int = 0,
    n_directions: int | None = None,
    tolerance: float = 1e-6,
    max_steps: int = 1000,
) -> RuleComparison:
    """Error of plane waves and image against norm of densities, for three ways of regularising.

    The part of the image at frequency lambda, per unit of frequency, is

        f_lambda(x) = (1/2π) ∫ fhat(xi) exp(i xi·x) lambda dtheta,  f = ∫ f_lambda dlambda.

    Args:
        setup: in the plane.
        phantom: the true image.
        frequency: lambda [rad/length].
        K: bounds for the truncation, `NormBound`.
        alpha: of `Tikhonov`, by singular values and by iterations.
        noise: level of the noise in the noisy data, see `phantoms.noise_like`.
        seed: of that noise.
        n_directions: by default enough for the frequency.
        tolerance, max_steps: of the iterations, see `ridge.ridge`.

    Returns:
        RuleComparison.

    Raises:
        ValueError: for parameters that are not positive, and detectors that cylindrical waves do
            not reach.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> bell = phantoms.Bells([[0.2, 0.1]], [0.6])
    >>> result = compare_regularizations(setup, bell, 12.0, K=[2.0, 4.0], alpha=[1e-2, 1e-3])
    >>> bool(jnp.all(jnp.diff(result.truncation.residual) < 0)), result.iterative.converged.tolist()
    (True, [True, True])
    """
    require_x64()
    curve, region, radii, sizes = plane_of(setup)
    require_one_speed(setup, "compare_regularizations")
    require_objects(phantom=phantom)
    grid = setup.grid
    bounds, alphas = real_array("K", K, ("values",)), real_array("alpha", alpha, ("values",))
    frequency = real_array("frequency", frequency, ())
    for name, value in (("K", bounds), ("alpha", alphas), ("frequency", frequency)):
        require_positive(name, value)
        if not value.size:
            raise ValueError(f"{name} is empty, expected one value at least.")
    if not noise >= 0:
        raise ValueError(f"noise is {noise}, expected a level of 0 or more.")
    if not is_concrete(setup, frequency):
        raise ValueError("compare_regularizations measures time: nothing of it can be traced.")
    _, angles = polar_grid(region, grid, radii, frequency, n_directions)
    geometry = polar_geometry(curve, region, sizes.n_nodes, sizes.wave_offset)
    n_max = int(wave_orders(geometry, np.asarray(frequency)[None]).max())
    # parts and sums by numpy: nothing is traced, and each would be a program
    alone, unit_vectors = jax.device_put(np.asarray(frequency)[None]), _unit(np.asarray(angles))
    matrix, rhs, unit = _system(geometry, alone, angles, n_max)
    norm = np.asarray(unit_norms(curve, region, alone, angles=angles))[0]
    data = phantom.circular_integrals(curve, radii)
    noisy = np.asarray(data) + np.asarray(noise_like(jax.random.key(seed), data, noise))
    data = jax.device_put(np.stack([np.asarray(data), noisy]))
    points = np.asarray(grid.points)[np.asarray(region.contains(grid.points))]
    # lambda exp(i xi·x) dtheta / π: the half turn of directions stands for the whole
    waves = np.exp(1j * float(frequency) * (points @ unit_vectors))
    known = {
        "transformed": np.asarray(radial_transform(data, radii, alone))[:, 0],
        "exact": np.asarray(phantom.fourier(alone, angles))[0],
        "waves": waves * float(frequency) / angles.shape[0],
        "shift": np.exp(-1j * float(frequency) * (np.asarray(geometry.center) @ unit_vectors)),
        "unit_norm": norm,
    }
    judge = _Judge(geometry=geometry, matrix=matrix, unit=unit, rhs=rhs, **jax.device_put(known))

    def iterated(judge: _Judge, alpha: Array) -> tuple[Array, Array, Array]:
        return _iterated(judge, alpha, tolerance, max_steps)

    return RuleComparison(
        judge.trade_off(_truncated, bounds),
        judge.trade_off(_damped, alphas),
        judge.trade_off(iterated, alphas),
    )


class _Judge(eqx.Module):
    """Tables for the error and norm of densities of one frequency."""

    geometry: PolarGeometry
    matrix: Float[Array, "blocks m columns"]
    unit: Float[Array, ""]
    rhs: Complex[Array, "blocks m directions"]
    transformed: Float[Array, "2 2 detectors"]  # clean and noisy, J and Y
    exact: Complex[Array, " directions"]
    waves: Complex[Array, "points directions"]
    shift: Complex[Array, " directions"]
    unit_norm: Float[Array, "*one_or_directions"]

    def trade_off(
        self,
        solve: Callable[["_Judge", Array], tuple[Array, Array, Array]],
        parameters: Float[Array, " values"],
    ) -> TradeOff:
        """The curve of one method: densities solved and judged for each parameter."""
        values = jax.device_put(list(np.asarray(parameters)))
        jax.block_until_ready(solve(self, values[0]))  # compile
        rows = []
        for parameter in values:
            start = time.perf_counter()
            q, iterations, converged = jax.block_until_ready(solve(self, parameter))
            seconds = time.perf_counter() - start
            rows.append((parameter, *self.judged(q), seconds, iterations, converged))
        columns = [np.stack(list(map(np.asarray, column))) for column in zip(*rows, strict=True)]
        return TradeOff(*jax.device_put(columns))

    @eqx.filter_jit
    def judged(self, q: Complex[Array, "blocks columns directions"]) -> Sequence[Array]:
        """residual, norm, clean, noisy."""
        misfit = self.matrix @ q - self.rhs
        residual = jnp.sqrt(_square(misfit) / _square(self.rhs))
        norm = jnp.sqrt(jnp.mean(_square(q)) / jnp.mean(self.unit_norm**2))
        weighted = unfold(q, self.geometry.weights, self.geometry.mirror)
        fhat = jnp.einsum("djk,ijk->id", weighted, self.transformed) / (2 * jnp.pi)
        image = jnp.real((self.shift * fhat) @ self.waves.T)
        exact = jnp.real(self.waves @ self.exact)
        error = jnp.linalg.norm(image - exact, axis=-1) / jnp.linalg.norm(exact)
        return jnp.sqrt(jnp.mean(residual**2)), norm, error[0], error[1]


@eqx.filter_jit
def _system(
    geometry: PolarGeometry, alone: Array, angles: Float[Array, " directions"], n_max: int
) -> tuple[
    Float[Array, "blocks m columns"], Complex[Array, "blocks m directions"], Float[Array, ""]
]:
    """A, u_xi and the unit of alpha."""
    wave = jax.tree.map(lambda leaf: leaf[0], wave_table(geometry, alone, n_max))
    matrix, rhs, _, unit = wave_system(geometry, wave, angles - geometry.axis)
    return matrix, rhs, unit


@eqx.filter_jit
def _truncated(judge: _Judge, bound: Array) -> tuple[Array, Array, Array]:
    solution = filtered_solve(judge.matrix, judge.rhs, NormBound(bound), judge.unit_norm)
    return solution.q, jnp.zeros((), int), jnp.ones((), bool)


@eqx.filter_jit
def _damped(judge: _Judge, alpha: Array) -> tuple[Array, Array, Array]:
    rule = Tikhonov(alpha * judge.unit)
    solution = filtered_solve(judge.matrix, judge.rhs, rule, judge.unit_norm)
    return solution.q, jnp.zeros((), int), jnp.ones((), bool)


@eqx.filter_jit
def _iterated(
    judge: _Judge, alpha: Array, tolerance: float, max_steps: int
) -> tuple[Array, Array, Array]:
    alpha = alpha * judge.unit
    solution = ridge(judge.matrix, judge.rhs, alpha, tolerance=tolerance, max_steps=max_steps)
    return solution.q, solution.iterations, solution.converged


def _square(columns: Complex[Array, "blocks n c"]) -> Float[Array, " c"]:
    return jnp.sum(jnp.abs(columns) ** 2, axis=(0, 1))


def _unit(angles: Float[np.ndarray, " directions"]) -> Float[np.ndarray, "2 directions"]:
    return np.stack([np.cos(angles), np.sin(angles)])
