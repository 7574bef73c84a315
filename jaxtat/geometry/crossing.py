"""Whether a polyline crosses or overlaps itself; its vertices are concrete."""

import numpy as np
from jaxtyping import Float

_ROWS = 256  # of the table of pairs at a time
_ON_LINE = 1e-12  # of the size: off a line by rounding only
_COMMON = 1e-9  # of the size: least part that segments on one line have in common


def first_crossing(
    starts: Float[np.ndarray, "n 2"], ends: Float[np.ndarray, "n 2"]
) -> tuple[int, int] | None:
    """The first two segments that cross or overlap; None if no two do.

    Segments that share an end do not cross there.

    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> first_crossing(square, np.roll(square, -1, axis=0))
    >>> bow = square[[0, 2, 1, 3]]
    >>> first_crossing(bow, np.roll(bow, -1, axis=0))
    (0, 2)
    >>> first_crossing(square[[0, 0]], np.array([[1.0, 0.0], [0.3, 0.0]]))
    (0, 1)
    """
    size = np.ptp(np.concatenate([starts, ends]), axis=0).max()
    for first in range(0, len(starts), _ROWS):
        rows = slice(first, first + _ROWS)
        here = starts[rows], ends[rows]
        off, reached = _along_lines(*here, starts, ends)
        off_here, _ = _along_lines(starts, ends, *here)
        # on the line counts to the left, so that of two segments that meet on it one is crossed
        left, left_here = off >= -_ON_LINE * size, off_here >= -_ON_LINE * size
        pairs = (left[0] != left[1]) & (left_here[0] != left_here[1]).T
        for one in here:  # neighbours share a point
            for other in (starts, ends):
                pairs &= (one[:, None] != other).any(axis=2)
        length = np.hypot(*(here[1] - here[0]).T)[:, None]
        common = np.minimum(reached.max(axis=0), length) - np.maximum(reached.min(axis=0), 0.0)
        common[np.arange(len(length)), first + np.arange(len(length))] = 0.0  # itself
        pairs |= (np.abs(off).max(axis=0) <= _ON_LINE * size) & (common > _COMMON * size)
        if pairs.any():
            i, j = np.argwhere(pairs)[0]
            return int(first + i), int(j)
    return None


def _along_lines(
    starts: Float[np.ndarray, "lines 2"], ends: Float[np.ndarray, "lines 2"], *points: np.ndarray
) -> tuple[Float[np.ndarray, "points lines n"], Float[np.ndarray, "points lines n"]]:
    """Distances of points to the left of each segment's line, and along it."""
    along = ends - starts
    unit = along / np.hypot(*along.T)[:, None]
    local = np.stack(points)[:, None] - starts[:, None]
    off = unit[:, 0, None] * local[..., 1] - unit[:, 1, None] * local[..., 0]
    return off, unit[:, 0, None] * local[..., 0] + unit[:, 1, None] * local[..., 1]
