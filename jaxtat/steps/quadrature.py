"""Integrals over radii of data times an oscillating kernel, for radii at any distances.

The trapezoid rule on equispaced radii is as accurate as can be: data and kernel may both reach the
shortest wave that the step samples. On other radii it is of second order only. So data are read at
as many equispaced radii first, by polynomials through their neighbours, where the kernel is known:
G = Σ_j k(s_j) h Σ_i L_ji g_i. Where the radii are equispaced L is the unit matrix.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

HALF_STENCIL = 12  # radii to either side of the nearest one: a wave of four steps to 4e-5


@jax.jit
def radial_quadrature(
    radii: Float[Array, " radii"],
) -> tuple[Float[Array, " radii"], Float[Array, "radii radii"]]:
    """s and Q of ∫ k(r) g(r) dr ≈ Σ_j k(s_j) Σ_i Q_ji g(r_i), for g that vanishes beyond the ends.

    Args:
        radii: increasing, (radii,) [length].

    Returns:
        s, equispaced from the first to the last radius, and Q = h L [length], half at the ends.
        Both are differentiable with respect to the radii.

    Source: Lagrange's formula, on the nearest radius and 12 to either side. Beyond the ends radii
    go on as in a mirror, and g is zero there.

    >>> nodes, weights = radial_quadrature(jnp.array([1.0, 1.5, 2.0, 2.5]))
    >>> bool(jnp.abs(weights - jnp.diag(jnp.array([0.25, 0.5, 0.5, 0.25]))).max() < 1e-14)
    True
    """
    nodes = jnp.linspace(radii[0], radii[-1], radii.shape[0])
    return nodes, trapezoid_weights(nodes)[:, None] * interpolation_matrix(radii, nodes)


@jax.jit
def interpolation_matrix(
    radii: Float[Array, " radii"], nodes: Float[Array, " nodes"]
) -> Float[Array, "nodes radii"]:
    """L of g(s_j) ≈ Σ_i L_ji g(r_i), L_ji = Π_{k≠i} (s_j - r_k)/(r_i - r_k) over the neighbours."""
    n = radii.shape[0]
    half = min(HALF_STENCIL, n - 1)
    first, last = radii[0], radii[-1]
    around = jnp.concatenate(
        [2 * first - radii[half:0:-1], radii, 2 * last - radii[-2 : -half - 2 : -1]]
    )
    # the nearest radius is the middle, so that a small change of equispaced radii changes none
    nearest = jnp.searchsorted(jax.lax.stop_gradient(radii[1:] + radii[:-1]) / 2, nodes)
    columns = nearest[:, None] + np.arange(2 * half + 1)
    local = around[columns]
    itself = np.eye(2 * half + 1, dtype=bool)
    between = jnp.where(itself, 1.0, local[:, :, None] - local[:, None, :])
    factors = jnp.where(itself, 1.0, (nodes[:, None] - local)[:, None, :] / between)
    rows = np.arange(nodes.shape[0])[:, None]
    matrix = jnp.zeros((nodes.shape[0], n + 2 * half)).at[rows, columns].set(factors.prod(axis=-1))
    return matrix[:, half : half + n]


def trapezoid_weights(nodes: Float[Array, " n"]) -> Float[Array, " n"]:
    """Weights of the trapezoid rule on increasing nodes.

    >>> trapezoid_weights(jnp.array([0.0, 1.0, 3.0])).tolist()
    [0.5, 1.5, 1.0]
    """
    half = jnp.diff(nodes) / 2
    return jnp.pad(half, (0, 1)) + jnp.pad(half, (1, 0))


def wave_error(radii: Float[np.ndarray, " radii"], frequency: float) -> float:
    """Root mean square error of a wave of one lambda interpolated at the equispaced radii.

    >>> wave_error(np.linspace(1.0, 2.0, 30), 60.0) < 1e-12
    True
    """
    n, half = len(radii), min(HALF_STENCIL, (len(radii) - 1) // 2)
    nodes = np.linspace(radii[0], radii[-1], n)[half : n - half]  # waves do not vanish at the ends
    if nodes.size == 0:
        return 0.0
    matrix = np.asarray(interpolation_matrix(jnp.asarray(radii), jnp.asarray(nodes)))
    error = matrix @ np.exp(1j * frequency * radii) - np.exp(1j * frequency * nodes)
    return float(np.sqrt(np.mean(np.abs(error) ** 2)))
