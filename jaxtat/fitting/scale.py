"""Sizes of a problem: of the operator, and of the image."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .spectrum import Spectrum


class Scale(NamedTuple):
    """Sizes of a problem.

    Attributes:
        square: L = max m of `spectrum`, about ||H B||².
        image: max |B^T H^T H b| / L, the size of the image.
    """

    square: Float[Array, ""]
    image: Float[Array, ""]


def scale_of(spectrum: Spectrum, back: Float[Array, "stack *space"]) -> Scale:
    """L and the size of the image, from B^T H^T H b; 1 for zeros."""
    square = jnp.max(spectrum.data)
    square = jnp.where(square > 0, square, 1.0)
    size = jnp.max(jnp.abs(back)) / square
    return Scale(square, jnp.where(size > 0, size, 1.0))
