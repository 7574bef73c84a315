"""Proximal maps: they minimise half the squared distance to an image plus the penalty.

    prox(v) = argmin over u in C of ||u - v||² / 2 + w P(u),   C: f = 0 outside the support, f >= 0.

For P = Σ h(|D u|) through its dual: u = Π_C(v - D^T p), where p maximises

    ||v||² / 2 - ||v - D^T p||² / 2 + dist(v - D^T p, C)² / 2 - delta |p|² / 2w  over |p_i| <= w,

by projected gradients with momentum. p is kept from one call to the next, since v changes little.

Source: Beck and Teboulle, IEEE Trans. Image Process. 18 (2009) 2419-2434.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .penalties import Penalty

Images = Float[Array, "stack *space"]


def prox(
    penalty: Penalty,
    images: Images,
    weight: Float[Array, ""],
    delta: Float[Array, ""],
    allowed: Callable[[Images], Images],
    dual: Float[Array, "parts stack *space"],
    n_steps: int,
) -> tuple[Images, Float[Array, "parts stack *space"]]:
    """The proximal map of w P on C after a number of steps, and p / w to go on from.

    Args:
        penalty: P.
        images: v.
        weight: w > 0.
        delta: below which h is rounded off [unit of v].
        allowed: Π_C, the nearest image in C.
        dual: p / w to start from.
        n_steps: of the dual's.
    """
    transpose = jax.linear_transpose(penalty.parts, images)
    weight, delta = (jnp.asarray(value, images.dtype) for value in (weight, delta))
    # in q = p / w: gradient D u - delta q, whose Lipschitz constant is w ||D||² + delta
    step = 1 / (weight * penalty.bound(images.ndim - 1) + delta)

    def nearest(q: Array) -> Array:
        return allowed(images - weight * transpose(q)[0])

    def ascend(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        q, ahead, t = state
        new = ahead + step * (penalty.parts(nearest(ahead)) - delta * ahead)
        new = new / jnp.maximum(1.0, penalty.sizes(new))
        t_new = (1 + jnp.sqrt(1 + 4 * t**2)) / 2
        return new, new + (t - 1) / t_new * (new - q), t_new

    dual = jax.lax.fori_loop(0, n_steps, ascend, (dual, dual, jnp.ones((), images.dtype)))[0]
    return nearest(dual), dual
