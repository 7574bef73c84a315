"""The weight of a penalty, from the image and the noise.

Images with the probability density exp(-lambda P(f)), P homogeneous of degree p in n pixels, have
E[P] = n / (p lambda). With noise of variance s² the most probable image minimises
||H (B f - b)||² / 2 + w P(f), w = s² lambda. lambda follows from P of the image plus the
uncertainty of its pixels, tau = s / sqrt(L), L = ||H B||²:

    w = s² n / (p P(f) + n SPREAD tau).

s is the root mean square of the misfit, or the known noise if that is larger. The equation is
solved as a fixed point, along with the image.

With little noise this weight is too small: images are sparser than the density says, and edges
finer than pixels are no white noise. So for known noise w >= L min(FLOOR tau, max|f| / FINEST):
below the first bound the penalty does not suppress noise, above the second thin structures vanish.
The bound is not used for unknown noise, since the misfit, which the weight itself causes, would
keep the weight large for exact data; nor for second differences, which suppress noise at far
smaller weights.

Source: Pereyra, Bioucas-Dias and Figueiredo, EUSIPCO 2015, 230-234.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from .data_fit import DataFit
from .penalties import Penalty

SPREAD = 3.0  # of noise that is known
# By dimension, of a misfit in place of noise. The weight makes part of that itself: with 1 a zero
# image balanced its own weight for rods seen by few detectors, on some simulated scans of
# benchmarks/scans, and 1.5 left a part of one of them. Plane: 3 leaves more of the noise. Space:
# with 1 a finger's vessels were half gone.
SPREAD_OF_MISFIT = {2: 2.0, 3: 3.0}
# By dimension: L belongs to the mean of the image in the plane, and in space to structures of 1/λ0
# (see `radial_filter`). Plane: chosen on phantoms of the seeds 0 and 3; benchmarks/weights.py tries
# them on others. Space: chosen on balls, bells and vessels in a periodic model in which A^T A is
# c/|xi|² exactly; benchmarks/weights_in_space.py tries them on others, with A.
FLOOR = {2: 0.15, 3: 0.3}
FINEST = {2: 400.0, 3: 150.0}


def balanced_weight(
    fit: DataFit,
    penalty: Any,
    images: Float[Array, "stack *space"],
    misfit: Float[Array, "stack *data"],
    scale: Any,
    spread: float | None = None,
) -> Float[Array, ""]:
    """w of the formula above.

    Args:
        images: f.
        misfit: B f - b.
        scale: L and the size of the image.
        spread: of the formula; by default as above.
    """
    stack = images.shape[0]
    square = jnp.sum(misfit**2) / (stack * fit.n_data)
    if fit.white:
        square = jnp.maximum(square, 1.0)
    tau = jnp.sqrt(square / scale.square)
    n = stack * fit.n_pixels
    if isinstance(penalty, Penalty):
        size = penalty.value(images, penalty.smoothing * scale.image)
        if spread is None:
            spread = SPREAD if fit.white else SPREAD_OF_MISFIT[fit.support.ndim]
        weight = square * n / (size + n * spread * tau)
        if not (penalty.needs_floor and fit.white):
            return weight
        d = fit.support.ndim
        least = jnp.minimum(FLOOR[d] * tau, scale.image / FINEST[d])
        return jnp.maximum(weight, scale.square * least)
    return square * n / (jnp.sum(images**2) + n * tau**2)  # ridge, of degree 2: 2 P = ||f||²
