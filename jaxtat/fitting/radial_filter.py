"""A high-pass in the radius, with which spherical integrals determine all details equally fast.

In space A^T A multiplies the spectrum of f by about c/|xi|²: the mean of f by several hundred times
what its finest details get, and a gradient method finds those last. With

    (H g)' + λ0 (H g) = g',   |H(λ)|² = λ²/(λ²+λ0²),

A^T H^T H A multiplies it by c/(|xi|² + λ0²). Details finer than 1/λ0 weigh as much as before;
coarse ones, which the data tell far better than needed, less. λ0 = 1/h, h the voxel.

In the plane it would be c/|xi|, with which a gradient method gets on. For noise of unknown size H
is not used: the weight that then follows from the misfit alone would be too small.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.linear_algebra import lower_solve


@jax.jit
def high_pass(
    radii: Float[Array, " radii"], cutoff: Float[Array, ""] | float
) -> Float[Array, "radii radii"]:
    """H, by the trapezoidal rule; g is zero before the first radius.

    Args:
        radii: increasing [length].
        cutoff: λ0 [rad/length].

    >>> radii = jnp.linspace(0.5, 60.5, 1201)
    >>> slow, fast = jnp.sin(0.1 * radii), jnp.sin(10 * radii)
    >>> H = high_pass(radii, 1.0)
    >>> [round(float(abs(H @ g)[600:].max()), 2) for g in (slow, fast)]
    [0.1, 1.0]
    """
    steps = jnp.diff(radii)
    half = cutoff * jnp.concatenate([steps[:1], steps]) / 2
    left = jnp.diag(1 + half) - jnp.diag(1 - half[1:], -1)
    change = jnp.eye(radii.shape[0]) - jnp.eye(radii.shape[0], k=-1)
    return lower_solve(left, change)
