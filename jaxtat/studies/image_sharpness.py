"""How sharp an image is: greatest for the true speed of sound and geometry."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.checks import Numbers, real_array, require_objects
from ..geometry import ImageGrid, Region


def sharpness(
    image: Numbers, grid: ImageGrid, region: Region | None = None
) -> Float[Array, "*batch"]:
    """S = ∫ |grad f|² dx over the region, by central differences at inner nodes.

    With a wrong speed of sound every circle has a wrong radius: what each detector contributes to
    an edge lies elsewhere, edges become several faint ones, and S falls. Images of different speeds
    c are compared by c² S, since f has the unit of g per length, and with c grow the lengths but
    not g. Not S over ∫ f² dx, which is greatest for a sharp image too: the ratio may even be least
    there.

    Args:
        image: f, (..., x1, x2).
        grid: its nodes.
        region: where it counts; by default the whole grid.

    Returns:
        (...) [square of the unit of f], differentiable.

    Raises:
        ValueError: for an image that does not fit the grid.

    Source: the Tenengrad measure, with which Treeby et al., J. Biomed. Opt. 16 (2011) 090501,
    choose a speed of sound.

    >>> slope = ImageGrid(5).points[..., 0] * 2.0  # 9 inner nodes, squares of area 1/4
    >>> float(sharpness(slope, ImageGrid(5)))
    9.0
    """
    require_objects(grid=grid)
    image = real_array("image", image, ("...", *grid.shape))
    h1, h2 = grid.spacing
    d1 = (image[..., 2:, 1:-1] - image[..., :-2, 1:-1]) / (2 * h1)
    d2 = (image[..., 1:-1, 2:] - image[..., 1:-1, :-2]) / (2 * h2)
    counts = 1.0 if region is None else region.contains(grid.points[1:-1, 1:-1])
    return h1 * h2 * jnp.sum(counts * (d1**2 + d2**2), axis=(-2, -1))
