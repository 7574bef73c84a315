"""From coarse to fine: a fit on few pixels and low frequencies is where the next one starts.

The mean of a body, and all that is wide, takes steps in proportion to its width in pixels, and most
of them where a record's band lacks low frequencies. On a grid of half as many nodes along each axis
they are half as many, and cost a quarter, in space an eighth.

Source: nested iteration, e.g. Briggs, Henson and McCormick, A Multigrid Tutorial, SIAM 2000,
chapter 3.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .penalties import NoPenalty, Penalty, Ridge

COARSEST = 17  # nodes along the shortest axis, fewer of which show nothing of an object
HALVINGS = 3


def ladder(grid: Any) -> list[Any]:
    """The grid, and before it coarser ones over the same square or box, each of half the nodes.

    >>> from jaxtat import ImageGrid
    >>> [level.shape for level in ladder(ImageGrid(129))]
    [(17, 17), (33, 33), (65, 65), (129, 129)]
    """
    grids = [grid]
    while len(grids) <= HALVINGS:
        shape = tuple((n - 1) // 2 + 1 for n in grids[0].shape)
        if min(shape) < COARSEST:
            break
        grids.insert(0, type(grid)(shape, grid.half_width, grid.center))
    return grids


def between_nodes(
    images: Float[Array, "stack *coarse"], shape: tuple[int, ...]
) -> Float[Array, "stack *fine"]:
    """Images on a finer grid over the same square or box, linear between nodes."""
    for axis, n in enumerate(shape, start=1):
        m = images.shape[axis]
        if m == n:
            continue
        place = np.linspace(0, m - 1, n)
        share = np.maximum(0, 1 - np.abs(place[:, None] - np.arange(m)))
        rows = jnp.tensordot(jnp.asarray(share, images.dtype), images, (1, axis))
        images = jnp.moveaxis(rows, 0, axis)
    return images


def weight_on(
    coarse: tuple[int, ...], fine: tuple[int, ...], penalty: Any, weight: Array | None
) -> Array | None:
    """The weight by which a penalty of the same function costs as much on a coarser grid.

    Sums over pixels of differences of order k are h^(k - d) times an integral.
    """
    if weight is None or coarse == fine:
        return weight
    ratio = np.mean([(n - 1) / (m - 1) for n, m in zip(fine, coarse, strict=True)])
    return weight * ratio ** (len(fine) - penalty.order)


def same_on_all_grids(penalty: Any) -> bool:
    """Whether a penalty means the same on all grids, as a denoiser of the user's need not."""
    return isinstance(penalty, Penalty | Ridge | NoPenalty)
