"""From coarse to fine: a fit on few pixels and low frequencies is where the next one starts.

The level inside a body, and all that is wide, takes most steps, above all where a record's band
lacks low frequencies. On a grid of a quarter of the nodes along each axis a step costs a sixteenth,
in space a sixty-fourth. Halves instead of quarters save no steps on the last grid (217 pixels of a
measured scan), and each grid is compiled by itself.

Source: nested iteration, e.g. Briggs, Henson and McCormick, A Multigrid Tutorial, SIAM 2000,
chapter 3.
"""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from ..base.checks import by_library

COARSEST = 40  # nodes along the shortest axis; of fewer, steps cost less than their programs
COARSEST_IN_SPACE = 17
STEP = 4  # from grid to grid


def ladder(grid: Any) -> list[Any]:
    """The grid, and before it coarser ones over the same square or box, each of a quarter.

    >>> from jaxtat import ImageGrid
    >>> [level.shape for level in ladder(ImageGrid(433))]
    [(109, 109), (433, 433)]
    """
    grids = [grid]
    while True:
        shape = tuple((n - 1) // STEP + 1 for n in grids[0].shape)
        if min(shape) < (COARSEST if len(shape) == 2 else COARSEST_IN_SPACE):
            break
        grids.insert(0, type(grid)(shape, grid.half_width, grid.center))
    return grids


def between_nodes(
    images: Float[Array, "stack *coarse"], shape: tuple[int, ...]
) -> Float[Array, "stack *fine"]:
    """Images on a finer grid over the same square or box, linear between nodes."""
    return by_library(_between_nodes, (images,), shape)


def _between_nodes(xp: Any, images: Any, shape: tuple[int, ...]) -> Any:
    for axis, n in enumerate(shape, start=1):
        m = images.shape[axis]
        if m == n:
            continue
        place = np.linspace(0, m - 1, n)
        share = np.maximum(0, 1 - np.abs(place[:, None] - np.arange(m))).astype(images.dtype)
        images = xp.moveaxis(xp.tensordot(share, images, (1, axis)), 0, axis)
    return images


def weight_on(
    coarse: tuple[int, ...], fine: tuple[int, ...], penalty: Any, weight: Array | None
) -> Array | None:
    """The weight on a coarser grid from that on the last one.

    Sums over pixels of differences of order k are h^(k - d) times an integral. Of that h^-1 is left
    out: on coarse grids there is less noise to suppress, and such a start is nearer to what comes
    of it (measured at 217 from 109 pixels: 9 instead of 14 %).
    """
    if weight is None or coarse == fine:
        return weight
    ratio = np.mean([(n - 1) / (m - 1) for n, m in zip(fine, coarse, strict=True)])
    return weight * ratio ** (len(fine) - 1 - penalty.order)
