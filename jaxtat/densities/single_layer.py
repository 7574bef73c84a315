"""Single-layer potentials with the kernels J_0 and Y_0 on the acquisition curve.

    (S rho)(x) = ∫_gamma [rho_J(z) J_0(lambda |x - z|) + rho_Y(z) Y_0(lambda |x - z|)] dl(z)

solves the Helmholtz equation off the curve; of elements of finite size the kernels are means over
each. Here are its matrix on the boundary of the region, the traces that plane waves have there, and
its values at any points.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ..base.checks import by_library
from ..base.rows import map_rows
from ..geometry import DetectorCurve, Region
from ..geometry.elements import NODES
from ..special import both_kinds


def potential_matrix(
    frequency: Float[Array, ""], curve: DetectorCurve, region: Region, n_nodes: int = NODES
) -> Float[Array, "traces unknowns"]:
    """A = [[J_0, Y_0], [-c J_1, -c Y_1]] of lambda |x - z|, c = (x - z)·n / |x - z|.

    The rows are (u, (1/lambda) du/dn) at the boundary points, the columns (rho_J, rho_Y) at the
    detectors. Rows are scaled by √w_x and columns by √w_z, so that 2-norms of traces and unknowns
    are the L2 norms on boundary and curve. Both traces are needed: with one alone the problem is
    singular at the Dirichlet or Neumann eigenvalues of the region.

    Args:
        frequency: lambda > 0 [rad/length].
        curve: detectors, n.
        region: boundary points, m.
        n_nodes: over which elements of finite width take the mean of a column.

    Returns:
        (2 m, 2 n), real.

    Source: Kunyansky 2008, section 3.2.

    >>> from jaxtat import circular_arc, disk
    >>> a = potential_matrix(jnp.array(5.0), circular_arc(1.3, 0.0, 20), disk(1, 0, n_boundary=40))
    >>> a.shape
    (80, 40)
    """
    rows = jnp.sqrt(region.weights)[:, None]
    columns = jnp.sqrt(curve.weights)[None, :]

    def of_points(detectors: Float[Array, "detectors 2"]) -> Array:
        difference = region.points[:, None, :] - detectors[None, :, :]
        distance = jnp.sqrt(jnp.sum(difference**2, axis=-1))
        cosine = jnp.einsum("xzi,xi->xz", difference, region.normals) / distance
        argument = frequency * distance
        scale, normal_scale = rows * columns, -cosine * rows * columns
        return jnp.block(
            [
                [scale * values for values in both_kinds(0, argument)],
                [normal_scale * slopes for slopes in both_kinds(1, argument)],
            ]
        )

    return curve.mean_over_elements(of_points, n_nodes)


def plane_wave(
    frequency: Float[Array, ""], angles: Float[Array, " directions"], points: Float[Array, "*n 2"]
) -> Complex[Array, "*n directions"]:
    """u_xi(x) = exp(-i xi·x), xi = lambda (cos theta, sin theta).

    Args:
        frequency: lambda [rad/length].
        angles: theta, (directions,) [rad].
        points: x, (..., 2), counted from the point where the phase is zero [length].

    Returns:
        Complex, (..., directions).
    """
    return jnp.exp(-1j * frequency * (points @ _unit(angles)))


def phases_from(
    frequencies: Float[Array, "*f"],
    angles: Float[Array, " directions"],
    offset: Float[Array, "2"],
) -> Complex[Array, "*f directions"]:
    """exp(i xi·offset), by which plane waves change that count their phases from another point.

    Args:
        frequencies: lambda, one or many [rad/length].
        angles: theta, (directions,) [rad].
        offset: the new point, from where the old one is [length].
    """

    def phases(xp: Any, frequencies: Any, angles: Any, offset: Any) -> Any:
        along = xp.cos(angles) * offset[0] + xp.sin(angles) * offset[1]
        return xp.exp(1j * frequencies[..., None] * along)

    return by_library(phases, (frequencies, angles, offset))


def plane_wave_traces(
    frequency: Float[Array, ""], angles: Float[Array, " directions"], region: Region
) -> Complex[Array, "traces directions"]:
    """(u, (1/lambda) du/dn) = (u_xi, -i (n·xi/lambda) u_xi) at the boundary points.

    Rows are scaled by √w_x as in `potential_matrix`. Phases are counted from ``region.center``.
    Arguments as in `potential_matrix` and `plane_wave`.
    """
    wave = plane_wave(frequency, angles, region.points - region.center)
    rows = jnp.sqrt(region.weights)[:, None]
    return jnp.concatenate([rows * wave, -1j * rows * (region.normals @ _unit(angles)) * wave])


@partial(jax.jit, static_argnames=("batch_size", "n_nodes"))
def potential(
    frequency: Float[Array, ""],
    densities: Complex[Array, "directions 2 detectors"],
    curve: DetectorCurve,
    points: Float[Array, "*n 2"],
    *,
    batch_size: int = 1024,
    n_nodes: int = NODES,
) -> Complex[Array, "*n directions"]:
    """The potential Σ_k w_k [rho_J J_0(lambda |x - z_k|) + rho_Y Y_0(lambda |x - z_k|)] at points.

    Args:
        frequency: lambda > 0 [rad/length].
        densities: (rho_J, rho_Y), one pair per direction [1/length].
        curve: the detectors.
        points: x, off the detectors, (..., 2) [length].
        batch_size: points at a time, which bounds the memory.
        n_nodes: as for `potential_matrix`.

    Returns:
        Complex, (..., directions).

    >>> from jaxtat import circular_arc
    >>> from jaxtat.special import j0
    >>> curve = circular_arc(1.3, 1.3, 64)
    >>> ones = jnp.stack([jnp.ones(64), jnp.zeros(64)])[None] + 0j
    >>> u = potential(jnp.array(3.0), ones, curve, jnp.zeros(2))  # 2π R_g J_0(lambda R_g)
    >>> bool(abs(u[0] - 2 * jnp.pi * 1.3 * j0(jnp.array(3.9))) < 1e-13)
    True
    """
    weighted = densities * curve.weights

    def at(point: Array) -> Array:
        def of_points(detectors: Float[Array, "detectors 2"]) -> Array:
            argument = frequency * jnp.sqrt(jnp.sum((point - detectors) ** 2, axis=-1))
            return jnp.stack(both_kinds(0, argument))

        kernel = curve.mean_over_elements(of_points, n_nodes)
        return jnp.einsum("djk,jk->d", weighted, kernel)

    values = map_rows(at, points.reshape(-1, 2), batch_size)
    return values.reshape(points.shape[:-1] + values.shape[1:])


def _unit(angles: Array) -> Float[Array, "2 directions"]:
    return jnp.stack([jnp.cos(angles), jnp.sin(angles)])
