"""Which edges can be seen, pixel by pixel.

An edge sends its wave along its normal, both ways. So a pixel's edges with normal d are recorded if
the line {x + t d} through it meets the curve. Lines are judged by their transverse weight, which
holds for any curve.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import (
    Numbers,
    is_concrete,
    real_array,
    require_objects,
    require_positive,
    whole_number,
)
from .curves import DetectorCurve
from .grids import ImageGrid
from .line_weights import kernel_width, line_normals, transverse_weight, weight_of_line
from .seen_lines import connected_pieces

VISIBLE = 0.75  # least transverse weight of a line whose wave is reconstructed stably
_STEPS = 8.0  # of the table of offsets within the Gaussian's width


def edge_weight(
    curve: DetectorCurve, points: Numbers, angles: Numbers, *, width: Numbers | None = None
) -> Float[Array, "*n angles"]:
    """Transverse weight W of the lines normal to edges at some points: how well they are recorded.

    The edges that can be seen are those with ``edge_weight(...) >= VISIBLE`` (0.75).

    Args:
        curve: the detectors, of any shape.
        points: (..., 2) [length].
        angles: of the edges' normals, (angles,) [rad]; half a turn is all.
        width: eps of `transverse_weight`.

    Returns:
        (..., angles): 1 for an edge whose wave crosses the curve once and squarely, 2 for one that
        is recorded on both sides, 0 for one that no detector records. Differentiable.

    >>> import numpy as np
    >>> from jaxtat import circular_arc
    >>> half = circular_arc(1.3, 0.0, 200)  # z_1 < 0: a point on its open side
    >>> np.round(edge_weight(half, [0.5, 0.0], [0.0, np.pi / 2]), 2).tolist()
    [1.0, 0.0]
    """
    points = real_array("points", points, ("...", 2))
    angles = real_array("angles", angles, ("angles",))
    offsets = points @ line_normals(angles)
    return transverse_weight(curve, angles + jnp.pi / 2, offsets, width=width)


def visibility_map(
    curve: DetectorCurve,
    grid: ImageGrid,
    *,
    n_angles: int = 360,
    least: Numbers = VISIBLE,
    width: Numbers | None = None,
) -> Float[Array, "x1 x2"]:
    """For each pixel the share of edge directions that can be seen: W >= least.

    An edge sends its wave along its normal, both ways; it is seen if that line meets the curve. 1
    where every line through the pixel does. With ``least=0.5`` lines that cross the curve squarely
    count up to its very ends; 0.75 leaves out those within about one width of an end, whose waves
    are recorded but in part.

    Args:
        curve: the detectors, of any shape.
        grid: nodes where it is wanted.
        n_angles: number of directions over half a turn.
        least: W of a line that counts as seen, above zero.
        width: eps of `transverse_weight`.

    Returns:
        (x1, x2), between 0 and 1, in steps of 1 / n_angles.

    Raises:
        ValueError: as `transverse_weight`.

    Source: E. T. Quinto, SIAM J. Math. Anal. 24 (1993) 1215-1225 (which edges data determine).

    >>> from jaxtat import ImageGrid, circular_arc
    >>> seen = visibility_map(circular_arc(1.3, 0.0, 200), ImageGrid(5, 0.65), least=0.5)
    >>> [round(float(v), 1) for v in np.asarray(seen)[:, 2]]  # half the circle, from left to right
    [1.0, 1.0, 1.0, 0.8, 0.7]
    """
    require_objects(curve=curve, grid=grid)
    least = real_array("least", least, ())
    require_positive("least", least)
    width = kernel_width(curve, width)
    n_angles = whole_number("n_angles", n_angles, 1)
    angles = np.arange(n_angles) * (np.pi / n_angles)
    steps = _STEPS * curve.n_detectors  # where the sizes are traced: the width is three spacings
    if is_concrete(curve, grid, width):
        steps = _STEPS * 2 * np.hypot(*np.asarray(grid.half_width)) / np.asarray(width).min()
    n_offsets = 256 * (int(steps) // 256 + 1)  # few programs
    return _share(curve, grid, jax.device_put(angles), width, least, n_offsets)


def visible_disk(
    curve: DetectorCurve, *, center: Numbers | None = None, n: int = 65
) -> tuple[np.ndarray, float] | None:
    """Centre and radius of the largest disk of which every edge can be seen; None if there is none.

    Found on the n x n pixels of the box around the detectors, and smaller by up to two of them. It
    keeps clear of detectors by a tenth of its radius.

    Args:
        curve: the detectors, concrete.
        center: of the disk, if only its radius is wanted, (2,) [length].
        n: pixels on each side of the box.

    Raises:
        ValueError: for traced detectors.

    >>> from jaxtat import polyline
    >>> middle, radius = visible_disk(polyline([(-1, 1), (-1, -1), (1, -1)], 90))
    >>> bool(np.abs(middle + 1 - radius).max() < 0.2)  # it keeps clear of both sides alike
    True
    >>> 0.4 < radius < 0.59  # 2 - √2 is that of the whole triangle
    True
    """
    if not is_concrete(curve, center):
        raise ValueError(
            "curve or center are traced, expected known ones: compute the disk outside of jax.jit. "
            "visibility_map can be traced."
        )
    with jax.ensure_compile_time_eval():  # inside jax.jit too
        return _visible_disk(curve, center, n)


def _visible_disk(
    curve: DetectorCurve, center: Numbers | None, n: int
) -> tuple[np.ndarray, float] | None:
    from scipy.ndimage import distance_transform_edt  # slow to import
    from scipy.spatial import KDTree

    points = np.asarray(curve.points)
    half = np.maximum(np.ptp(points, axis=0).max() / 2, 1e-300)
    grid = ImageGrid(n, half, (points.max(axis=0) + points.min(axis=0)) / 2)
    nodes = np.asarray(grid.points)
    # the transverse weight looks past the ends of the curve by its width, and is not enough alone
    seen = np.asarray(visibility_map(curve, grid, n_angles=90)) > 0.99
    seen &= _meets_every_line(curve, nodes)
    nearest, which = KDTree(points).query(nodes)
    seen &= nearest > np.asarray(kernel_width(curve, None))[which]  # points on the curve itself
    # what is not seen may begin up to a pixel before the first one that is not
    radius = (np.asarray(distance_transform_edt(seen)) - 1) * float(grid.spacing[0])
    radius = np.minimum(radius, nearest / 1.1)
    if center is None:
        place = np.unravel_index(np.argmax(radius), radius.shape)
    else:
        off = np.linalg.norm(nodes - np.asarray(center, float), axis=-1)
        place = np.unravel_index(np.argmin(off), off.shape)
    if not radius[place] > 0:
        return None
    return (nodes[place] if center is None else np.asarray(center, float)), float(radius[place])


def _meets_every_line(curve: DetectorCurve, points: np.ndarray) -> np.ndarray:
    """Whether every line through a point meets the curve, by the order of the detectors.

    From a point each piece of the curve covers the directions between its least and its greatest
    bearing; lines are directions modulo half a turn. If any is left free, some free range begins
    where a piece's range ends.
    """
    ends = []
    for piece in connected_pieces(curve):
        local = piece - points[..., None, :]
        bearing = np.unwrap(np.arctan2(local[..., 1], local[..., 0]))
        ends.append((bearing.min(axis=-1), bearing.max(axis=-1)))
    covered = [
        np.any([(end - low) % np.pi < high - low for low, high in ends], axis=0) for _, end in ends
    ]
    return np.all(covered, axis=0)


@partial(jax.jit, static_argnames="n_offsets")
def _share(
    curve: DetectorCurve, grid: ImageGrid, angles: Array, width: Array, least: Array, n_offsets: int
) -> Float[Array, "x1 x2"]:
    reach = jnp.linalg.norm(grid.half_width)
    table = jnp.linspace(-reach, reach, n_offsets)
    local = grid.points - grid.center

    def count(total: Array, angle: Array) -> tuple[Array, None]:
        across = line_normals(angle)
        weights = weight_of_line(curve, angle + jnp.pi / 2, grid.center @ across + table, width)
        position = (local @ across + reach) / (table[1] - table[0])
        first = jnp.clip(position.astype(int), 0, n_offsets - 2)
        t = position - first
        weight = (1 - t) * weights[first] + t * weights[first + 1]
        return total + (weight >= least), None

    total, _ = jax.lax.scan(count, jnp.zeros(grid.shape, int), angles)
    return total / angles.shape[0]
