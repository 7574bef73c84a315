"""Classical filtered back-projection of Radon projections, by the same steps 4 and 5.

The paper compares with it: steps 4 and 5 applied to projections that were measured as such.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry import ImageGrid
from .fbp import filtered_back_projection
from .radon import LowPass, low_pass_values, polar_fourier_of_projections, radon_projections


@eqx.filter_jit
def classical_fbp(
    projections: Float[Array, "*batch directions offsets"],
    offset_step: Float[Array, ""],
    angles: Float[Array, " directions"],
    grid: ImageGrid,
    center: Float[Array, "2"],
    *,
    low_pass: LowPass | None = None,
) -> Float[Array, "*batch x1 x2"]:
    """f from p(theta, s) = ∫_{(x - c)·theta = s} f dl by filtered back-projection.

    Args:
        projections: at offsets j h, j = -n..n-1, (..., directions, 2 n).
        offset_step: h [length].
        angles: theta, equispaced over half a turn, (directions,) [rad].
        grid: where the image is wanted.
        center: c, (2,) [length].
        low_pass: eta(lambda / lambda_max), such as `cosine_filter` or "cosine"; none by default.

    Returns:
        (..., x1, x2).

    >>> from jaxtat import phantoms
    >>> angles, offsets = jnp.arange(128) * jnp.pi / 128, (jnp.arange(128) - 64) / 32
    >>> bell, grid = phantoms.Bells([[0.1, 0.2]], [0.6]), ImageGrid(33)
    >>> p = bell.radon(angles, offsets)
    >>> image = classical_fbp(p, jnp.array(1 / 32), angles, grid, jnp.zeros(2))
    >>> bool(jnp.abs(image - bell.image(grid)).max() < 1e-5)
    True
    """
    fhat = polar_fourier_of_projections(projections, offset_step)
    n = fhat.shape[-2] - 1
    frequency_step = jnp.pi / (n * offset_step)
    filtered = radon_projections(fhat, frequency_step, low_pass_values(low_pass, n))
    return filtered_back_projection(filtered, offset_step, angles, grid, center)
