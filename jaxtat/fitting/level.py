"""A problem on one grid, and what is computed of it once."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .data_fit import DataFit
from .spectrum import Spectrum


class Scale(NamedTuple):
    """Sizes of a problem.

    Attributes:
        square: L = max m of `spectrum`, about ||H B||².
        image: max |B^T H^T H b| / L, the size of the image.
    """

    square: Float[Array, ""]
    image: Float[Array, ""]


class Level(NamedTuple):
    """A problem on one grid.

    Attributes:
        fit, data: B and b.
        back: B^T H^T H b.
        spectrum, scale: of B.
    """

    fit: DataFit
    data: Float[Array, "stack *data"]
    back: Float[Array, "stack *space"]
    spectrum: Spectrum
    scale: Scale


def scale_of(spectrum: Spectrum, back: Float[Array, "stack *space"]) -> Scale:
    """L and the size of the image, from B^T H^T H b; 1 for zeros."""
    square = jnp.max(spectrum.data)
    square = jnp.where(square > 0, square, 1.0)
    size = jnp.max(jnp.abs(back)) / square
    return Scale(square, jnp.where(size > 0, size, 1.0))
