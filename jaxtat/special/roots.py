"""The square root of sums of squares that may be zero."""

from typing import Any

import jax.numpy as jnp


def root(square: Any, xp: Any = jnp) -> Any:
    """√square, and 0 with derivative 0 where the square is not positive.

    √ itself has an infinite derivative at 0, which a zero cotangent turns into NaN.

    Args:
        square: (...,).
        xp: jax.numpy, or numpy for known arrays.

    >>> import jax
    >>> float(jax.grad(root)(0.0)), float(root(jax.numpy.array(4.0)))
    (0.0, 2.0)
    """
    positive = square > 0
    return xp.where(positive, xp.sqrt(xp.where(positive, square, 1.0)), 0.0)
