"""The square root of sums of squares that may be zero."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def root(square: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """√square, and 0 with derivative 0 where the square is not positive.

    √ itself has an infinite derivative at 0, which a zero cotangent turns into NaN.

    >>> import jax
    >>> float(jax.grad(root)(0.0)), float(root(jax.numpy.array(4.0)))
    (0.0, 2.0)
    """
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)
