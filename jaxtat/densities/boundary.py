"""Tikhonov regularisation on boundary traces: for detectors that no cylindrical waves reach.

Cylindrical waves need every detector farther from some centre than all of the region. Around an L,
or beside a long rectangle, there is no such centre. There the potentials are taken as they are: A
holds the traces of J_0 and Y_0 of every detector on the boundary (`single_layer.potential_matrix`),
and with u_xi the traces of the plane waves

    fhat(xi) = (1/2π) u_xi^T (A A^T + alpha)^-1 A √w G = (1/2π) u_xi^T A (A^T A + alpha)^-1 √w G,

one solution for all directions again, in as many unknowns as there are data, or traces if these are
fewer. No basis is chosen, so none can be too small, and nothing stands between the image and its
derivatives with respect to positions and boundary.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Complex, Float

from ..base.parallel import map_shards
from ..geometry import DetectorCurve, Region
from ..geometry.elements import NODES
from ..regularization import Problem, seen_once
from .cylindrical_waves import Asked, SolveReport, cholesky_solve, conjugate_gradients
from .single_layer import plane_wave_traces, potential_matrix

MAX_ITERATIONS = 2000  # of conjugate gradients
# relative alpha: below it the rounding of A^T A, over alpha, is more than 1e-7 of the traces, and
# derivatives lose more
_CARRIED = 1e-10


def solve_on_boundary(
    curve: DetectorCurve,
    region: Region,
    frequencies: Float[Array, " frequencies"],
    angles: Float[Array, " directions"],
    transformed: Float[Array, "frequencies images 2 detectors"],
    asked: Asked,
    solver: str,
    tolerance: Array | float,
    mesh: Mesh | None = None,
    n_nodes: int = NODES,
) -> tuple[Complex[Array, "images frequencies directions"], SolveReport]:
    """fhat on the polar grid, phases counted from the centre of the region.

    Args:
        curve, region: the geometry.
        frequencies: lambda [rad/length].
        angles: theta [rad].
        transformed: (G_J, G_Y), frequencies first.
        asked: noise, norm and rule of every frequency.
        solver: "cholesky", or "cg": no matrix but A itself is formed.
        tolerance: relative residual at which conjugate gradients stop.
        mesh: devices that share the frequencies.
        n_nodes: on elements of finite width.
    """

    @jax.checkpoint
    def at(common: Any, given: tuple[Array, Array, Asked]) -> tuple[Array, SolveReport]:
        curve, region, angles = common
        frequency, values, asked = given
        matrix = potential_matrix(frequency, curve, region, n_nodes)
        rhs = (jnp.sqrt(curve.weights) * values).reshape(-1, matrix.shape[1]).T
        alpha = asked.rule.absolute(_problem(frequency, asked, matrix, rhs))
        y, report = _traces(matrix, rhs, alpha, solver, tolerance)
        waves = plane_wave_traces(frequency, angles, region)
        fhat = jax.lax.complex(y.T @ waves.real, y.T @ waves.imag) / (2 * jnp.pi)
        relative = alpha / seen_once(frequency) ** 2
        converged = report.converged & (relative >= _CARRIED * (1 - 1e-9))
        return fhat, eqx.tree_at(
            lambda tree: (tree.relative_alpha, tree.converged), report, (relative, converged)
        )

    fhat, report = map_shards(
        lambda common, share: jax.lax.map(partial(at, common), share),
        (curve, region, angles),
        (frequencies, transformed, asked),
        mesh,
    )
    return jnp.moveaxis(fhat, 1, 0), report


def _problem(frequency: Array, asked: Asked, matrix: Array, rhs: Array) -> Problem:
    return Problem(
        matrix=None,
        plane=None,
        diagonal=jnp.sum(matrix**2, axis=1)[None],
        unit_norm=asked.unit_norm,
        data_power=jnp.mean(rhs**2),
        noise_power=asked.noise_power,
        seen_once=seen_once(frequency),
        unit=seen_once(frequency) ** 2,
        n_data=matrix.shape[1],
    )


def _traces(
    matrix: Float[Array, "traces unknowns"],
    rhs: Float[Array, "unknowns images"],
    alpha: Array,
    solver: str,
    tolerance: Array | float,
) -> tuple[Float[Array, "traces images"], SolveReport]:
    """y = (A A^T + alpha)^-1 A √w G, by way of whichever side is the smaller."""
    by_traces = matrix.shape[0] < matrix.shape[1]
    inner = matrix.T if by_traces else matrix  # the system is inner^T inner + alpha
    right = matrix @ rhs if by_traces else rhs
    solve = _factorised if solver == "cholesky" else partial(_iterated, tolerance=tolerance)
    x, steps = solve(inner, right, alpha)
    misfit = inner.T @ (inner @ x) + alpha * x - right
    size = jnp.sum(right**2, axis=0)
    ratio = jnp.sum(misfit**2, axis=0) / jnp.where(size > 0, size, 1.0)
    residual = jnp.sqrt(jax.lax.stop_gradient(ratio).max())
    factorised = solver == "cholesky"
    converged = jnp.isfinite(residual) if factorised else residual <= 10 * tolerance
    report = SolveReport(alpha, alpha, residual, steps, converged)
    return x if by_traces else matrix @ x, report


def _factorised(inner: Array, right: Array, alpha: Array) -> tuple[Array, Array]:
    gram = inner.T @ inner
    shifted = gram + alpha * jnp.eye(gram.shape[0])
    return cholesky_solve(shifted[None], right[None])[0], jnp.zeros((), int)


def _iterated(
    inner: Array, right: Array, alpha: Array, tolerance: Array | float
) -> tuple[Array, Array]:
    """Derivatives are one more solve each, not those of the iteration."""
    diagonal = jax.lax.stop_gradient(jnp.sum(inner**2, axis=0) + alpha)

    def system(x: Array) -> Array:  # (images, 1, unknowns)
        return (x @ inner.T) @ inner + alpha * x

    def solve(product: Callable[[Array], Array], right: Array) -> tuple[Array, Array]:
        return conjugate_gradients(
            product, lambda v: v / diagonal, right, tolerance, MAX_ITERATIONS
        )

    x, steps = jax.lax.custom_linear_solve(
        system, right.T[:, None, :], solve, symmetric=True, has_aux=True
    )
    return x[:, 0].T, steps
