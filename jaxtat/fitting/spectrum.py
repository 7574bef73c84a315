"""How strongly data and penalty hold each frequency of an image: the symbol of B^T H^T H B.

B^T H^T H B is nearly a convolution. Applied to one pixel in the middle of the support it gives the
kernel, whose Fourier transform m(xi) is what a wave of frequency xi is multiplied by there; l(xi)
is that of D^T D. Systems (B^T H^T H B + a D^T D + b) f = r are preconditioned by 1 / (m + a l + b),
and max m is about ||H B||².

Source: for tomography, Fessler and Booth, IEEE Trans. Image Process. 8 (1999) 688-699.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft
from jaxtyping import Array, Float

from .data_fit import DataFit
from .penalties import Penalty

ROOM = 8  # zeros beside the image, at least, so that opposite edges are no neighbours


class Spectrum(NamedTuple):
    """Symbols on the frequencies of an image with zeros beside it.

    Attributes:
        data: m >= 0.
        differences: l of the penalty; None for one without D.
    """

    data: Float[Array, "*frequencies"]
    differences: Float[Array, "*frequencies"] | None


def middle_pixel(fit: DataFit) -> Float[Array, "1 *space"]:
    """An image that is 1 in the pixel of the support nearest to its middle."""
    shape = fit.support.shape
    return jnp.zeros((1, *shape), fit.whitening.dtype).at[(0, *_middle(fit))].set(1.0)


def spectrum_of(fit: DataFit, penalty: Any, kernel: Float[Array, "1 *space"]) -> Spectrum:
    """m and l, from what B^T H^T H B makes of `middle_pixel`."""
    shape, middle = fit.support.shape, _middle(fit)

    def symbol(kernel: Array) -> Array:
        kernel = jnp.pad(kernel[0], [(0, p - n) for p, n in zip(period(shape), shape, strict=True)])
        for axis, i in enumerate(middle):
            kernel = jnp.roll(kernel, -i, axis)
        return jnp.fft.rfftn(kernel).real

    data = jnp.maximum(symbol(kernel), 0.0)
    if not isinstance(penalty, Penalty):
        return Spectrum(data, None)
    back = jax.linear_transpose(penalty.parts, kernel)
    return Spectrum(data, symbol(back(penalty.parts(middle_pixel(fit)))[0]))


def preconditioned(
    images: Float[Array, "stack *space"], symbol: Float[Array, "*frequencies"]
) -> Float[Array, "stack *space"]:
    """Images whose spectrum is divided by a symbol."""
    shape = images.shape[1:]
    axes, periods = range(1, images.ndim), period(shape)
    spectrum = jnp.fft.rfftn(images, s=periods, axes=axes) / symbol
    found = jnp.fft.irfftn(spectrum, s=periods, axes=axes)
    return found[(slice(None), *(slice(n) for n in shape))]


def period(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Pixels with the zeros beside them, of which FFTs are fast."""
    return tuple(int(scipy.fft.next_fast_len(n + ROOM, real=True) or 0) for n in shape)


def _middle(fit: DataFit) -> tuple[Array, ...]:
    """The pixel of the support nearest to its middle."""
    shape = fit.support.shape
    axes = jnp.meshgrid(*(jnp.arange(n) for n in shape), indexing="ij")
    count = jnp.maximum(jnp.sum(fit.support), 1)
    means = [jnp.sum(jnp.where(fit.support, axis, 0)) / count for axis in axes]
    away = sum((axis - mean) ** 2 for axis, mean in zip(axes, means, strict=True))
    nearest = jnp.argmin(jnp.where(fit.support, away, np.inf))
    return jnp.unravel_index(nearest, shape)
