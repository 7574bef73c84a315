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

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Complex, Float

from ..base.parallel import map_shards
from ..geometry import DetectorCurve, Region
from ..geometry.elements import NODES
from ..regularization import (
    FrequencyData,
    SolveReport,
    relative_residual,
    single_crossing,
    tikhonov_solution,
)
from .cylindrical_waves import RuleInputs
from .single_layer import plane_wave_traces, potential_matrix

# relative alpha: below it the rounding of A^T A, over alpha, is more than 1e-7 of the traces, and
# derivatives lose more
_CARRIED = 1e-10


def solve_on_boundary(
    curve: DetectorCurve,
    region: Region,
    frequencies: Float[Array, " frequencies"],
    angles: Float[Array, " directions"],
    transformed: Float[Array, "frequencies images 2 detectors"],
    inputs: RuleInputs,
    mesh: Mesh | None = None,
    n_nodes: int = NODES,
) -> tuple[Complex[Array, "images frequencies directions"], SolveReport]:
    """fhat on the polar grid, phases counted from the centre of the region.

    Args:
        curve, region: the geometry.
        frequencies: lambda [rad/length].
        angles: theta [rad].
        transformed: (G_J, G_Y), frequencies first.
        inputs: noise, norm and rule of every frequency.
        mesh: devices that share the frequencies.
        n_nodes: on elements of finite width.
    """

    @jax.checkpoint
    def at(common: Any, share: tuple[Array, Array, RuleInputs]) -> tuple[Array, SolveReport]:
        curve, region, angles = common
        frequency, values, inputs = share
        matrix = potential_matrix(frequency, curve, region, n_nodes)
        rhs = (jnp.sqrt(curve.weights) * values).reshape(-1, matrix.shape[1]).T
        alpha = inputs.rule.absolute(_frequency_data(frequency, inputs, matrix, rhs))
        y, residual = _traces(matrix, rhs, alpha)
        waves = plane_wave_traces(frequency, angles, region)
        fhat = jax.lax.complex(y.T @ waves.real, y.T @ waves.imag) / (2 * jnp.pi)
        relative = alpha / single_crossing(frequency) ** 2
        converged = jnp.isfinite(residual) & (relative >= _CARRIED * (1 - 1e-9))
        return fhat, SolveReport(alpha, relative, residual, converged)

    fhat, report = map_shards(
        lambda common, share: jax.lax.map(partial(at, common), share),
        (curve, region, angles),
        (frequencies, transformed, inputs),
        mesh,
    )
    return jnp.moveaxis(fhat, 1, 0), report


def _frequency_data(
    frequency: Array, inputs: RuleInputs, matrix: Array, rhs: Array
) -> FrequencyData:
    return FrequencyData(
        matrix=None,
        plane=None,
        diagonal=jnp.sum(matrix**2, axis=1)[None],
        unit_norm=inputs.unit_norm,
        data_power=jnp.mean(rhs**2),
        noise_power=inputs.noise_power,
        single_crossing=single_crossing(frequency),
        unit=single_crossing(frequency) ** 2,
        n_data=matrix.shape[1],
    )


def _traces(
    matrix: Float[Array, "traces unknowns"],
    rhs: Float[Array, "unknowns images"],
    alpha: Array,
) -> tuple[Float[Array, "traces images"], Array]:
    """y = (A A^T + alpha)^-1 A √w G, by way of whichever side is the smaller, and the residual."""
    by_traces = matrix.shape[0] < matrix.shape[1]
    inner = matrix.T if by_traces else matrix  # the system is inner^T inner + alpha
    right = matrix @ rhs if by_traces else rhs
    x, squares = tikhonov_solution((inner.T @ inner)[None], alpha, right[None])
    return x[0] if by_traces else matrix @ x[0], relative_residual(squares)
