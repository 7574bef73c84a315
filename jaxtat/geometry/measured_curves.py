"""Acquisition curves through measured positions: order, gaps, weights and normals."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Array, Bool, Float

from ..base.checks import (
    Numbers,
    by_library,
    is_concrete,
    real_array,
    require_positive,
    whole_number,
)
from .crossing import first_crossing
from .curves import (
    DetectorCurve,
    SampledCurve,
    one_after_another,
    outward,
    require_detectors,
    with_elements,
)

_SAME = 1e-9  # of the size: detectors closer to each other than that have the same position
UNEVEN = 0.05  # of the length, which given weights may miss
# steps like those beside it: farther apart, neighbours belong to separate pieces; where three of
# equal ones are missing they do not yet
_WIDE = 4 + 1e-9


def detector_curve(
    positions: Numbers,
    *,
    weights: Numbers | None = None,
    closed: bool | None = None,
    pieces: Sequence[int] | None = None,
    smooth: int = 0,
    element_width: Numbers | None = None,
) -> SampledCurve:
    """Acquisition curve through measured detector positions, in order along the curve.

    The weight of a detector is half the arcs to its neighbours, w_k = (l_{k-1,k} + l_{k,k+1})/2; an
    end detector has a full step, as if its sensitive area reached half a step past it. The arcs l
    and the tangents are those of the circle through three neighbouring detectors: exact for a
    circle; for other smooth curves weights are third and normals second order in the spacing.
    Beside a gap of more than four steps, like those to either side (medians of three) and like all
    of them (the median), a detector counts as an end: several separate arcs may follow one another.

    Args:
        positions: (detectors, 2), or (detectors, 3) where one of the three coordinates is constant
            (a planar array) and is dropped [length]. Any orientation, any spacing.
        weights: arc length of each, if it is known better than by the order, (detectors,) [length];
            they are checked against the length that the order gives.
        closed: whether the last detector is a neighbour of the first. By default it is if that
            distance is at most twice the median step; under tracing it must be given.
        pieces: numbers of detectors, at least 3, of separate curves that follow one another, if
            they meet in corners or in gaps too narrow to be seen.
        smooth: for positions that scatter about a smooth curve by more than a small part of their
            spacing: weights and normals are those of the curve that local parabolas through this
            many neighbours to either side make of them. The positions stay as they are.
        element_width: length over which a detector takes the mean, along the tangent, a number or
            one for each detector; None for point detectors [length].

    Returns:
        DetectorCurve with normals on the outer side, away from the middle of the curve.

    Raises:
        ValueError: for fewer than 3 detectors, positions off a plane, repeated or unsorted ones, a
            curve that crosses itself, weights that do not add up to its length, and elements that
            are longer than it.

    >>> import numpy as np
    >>> theta = np.linspace(0.8, 5.5, 256)
    >>> curve = detector_curve(40.5e-3 * np.stack([np.cos(theta), np.sin(theta)], axis=1))
    >>> np.allclose(curve.weights, 40.5e-3 * 4.7 / 255, rtol=1e-12)
    True
    """
    points = in_plane(positions)
    require_detectors(points.shape[0], least=3)
    smooth = whole_number("smooth", smooth, 0)
    sizes = _piece_sizes(points.shape[0], pieces)
    if len(sizes) > 1:
        if closed:
            raise ValueError("closed=True and pieces: a curve of several pieces is open.")
        closed = False
    if closed is None:
        if not is_concrete(points):
            raise ValueError(
                "closed must be given (True or False) when the detector positions are traced."
            )
        closed = is_closed(np.asarray(points))
    closed = bool(closed)
    if len(sizes) == 1:
        curve = _smoothed_curve(points, closed, smooth)
    else:
        bounds = np.cumsum([0, *sizes])
        parts = [_smoothed_curve(points[a:b], closed, smooth) for a, b in pairwise(bounds)]
        curve = one_after_another(parts)
    if weights is not None:
        checked = real_array("weights", weights, (points.shape[0],))
        require_positive("weights", checked)
        _require_length(checked, curve.weights)
        curve = SampledCurve(points, checked, curve.normals, closed)
    return with_elements(curve, element_width)


def _piece_sizes(n: int, pieces: Any) -> tuple[int, ...]:
    if pieces is None:
        return (n,)
    if np.ndim(pieces) != 1:
        raise ValueError(f"pieces is {pieces!r}, expected one number of detectors for each piece.")
    sizes = tuple(whole_number("pieces", size, 3) for size in pieces)
    if sum(sizes) != n:
        raise ValueError(f"pieces are {sizes}, which makes {sum(sizes)}, expected {n} detectors.")
    return sizes


def _smoothed_curve(points: Array, closed: bool, smooth: int) -> SampledCurve:
    """One piece, checked, with the weights and normals of its smoothed positions."""
    n, smoothed = points.shape[0], points
    if smooth:
        if n <= 2 * smooth:
            raise ValueError(f"smooth is {smooth}, expected less than half of {n} detectors.")
        smoothing = _local_parabolas(n, smooth, closed)
        smoothed = by_library(lambda xp, points: smoothing @ points, (points,))
    if is_concrete(smoothed):
        require_sorted(np.asarray(smoothed), closed)
        require_simple(np.asarray(smoothed), closed)
    curve = _sampled(smoothed, closed)
    return SampledCurve(points, curve.weights, curve.normals, closed)


def _local_parabolas(n: int, smooth: int, closed: bool) -> Float[np.ndarray, "n n"]:
    """Values at every point of parabolas fitted to 2 smooth + 1 neighbours, as a matrix.

    Source: Savitzky and Golay, Anal. Chem. 36 (1964) 1627-1639.
    """
    matrix = np.zeros((n, n))
    for k in range(n):
        # at an open end the window stays as wide and the parabola is read off its middle
        first = k - smooth if closed else min(max(k - smooth, 0), n - 2 * smooth - 1)
        window = np.arange(first, first + 2 * smooth + 1)
        powers = np.vander((window - k) / smooth, 3)
        matrix[k, window % n] = np.linalg.pinv(powers)[2]
    return matrix


def _require_length(weights: Array, from_order: Array) -> None:
    if not is_concrete(weights, from_order):
        return
    total, length = float(weights.sum()), float(from_order.sum())
    if abs(total - length) > UNEVEN * length:
        raise ValueError(
            f"the weights add up to {total:.6g}, but the curve through the detectors is "
            f"{length:.6g} long: expected lengths of arc, in the unit of the positions and in the "
            "order of the detectors."
        )


def keep_detectors(curve: DetectorCurve, keep: Numbers | np.ndarray) -> SampledCurve:
    """The curve without some detectors; the weight of each is half the arc to its neighbours.

    So the arc of one missing detector is shared by its neighbours. A gap of more than four steps
    like those beside it is a gap in the curve: the detectors next to it are ends, and it has no
    weight; after the last detector it opens a closed curve. Data keep the same rows,
    ``g[..., keep, :]``. Elements keep their widths, along the tangent.

    Args:
        curve: any, its weights are not used.
        keep: whether each detector stays, boolean, (detectors,), concrete; such as
            ``channel_quality(...).good``.

    Returns:
        DetectorCurve, differentiable with respect to the positions.

    Raises:
        ValueError: for a mask that does not fit, is traced, or keeps fewer than 3.

    >>> from jaxtat import circular_arc
    >>> curve = circular_arc(1.3, 0.0, 100)
    >>> keep = np.arange(100) != 40
    >>> weights = keep_detectors(curve, keep).weights * (100 / (np.pi * 1.3))
    >>> [round(float(w), 9) for w in weights[37:43]]
    [1.0, 1.0, 1.5, 1.5, 1.0, 1.0]
    """
    if not is_concrete(keep):
        raise ValueError("keep is traced, expected a concrete mask: sizes depend on it.")
    mask = np.asarray(keep)
    if mask.dtype != bool or mask.shape != (curve.n_detectors,):
        raise ValueError(
            f"keep has dtype {mask.dtype} and shape {mask.shape}, expected booleans "
            f"({curve.n_detectors},)."
        )
    require_detectors(int(mask.sum()), least=3)
    kept = np.flatnonzero(mask)
    closed, width = curve.closed, curve.element_width
    points = by_library(lambda xp, points: points[kept], (curve.points,))
    if width is not None and width.ndim:
        width = by_library(lambda xp, width: width[kept], (width,))
    if closed and is_concrete(points):
        where = np.asarray(points)
        steps = np.linalg.norm(np.roll(where, -1, axis=0) - where, axis=1)
        closed = not behind_gap(steps, True)[-1]
    return replace(_sampled(points, closed), element_width=width)


def _sampled(points: Array, closed: bool) -> SampledCurve:
    """Weights and normals from the circles through three neighbours."""
    return SampledCurve(points, *by_library(_weights_and_normals, (points,), closed), closed)


def _weights_and_normals(xp: Any, points: Any, closed: bool) -> tuple[Any, Any]:
    before, here, after = _neighbours(xp, points, closed)
    step = _arc_to_next(xp, before, here, after)  # from each detector to the next one
    wide = behind_gap(step, closed, xp)
    back, back_wide = xp.roll(step, 1), xp.roll(wide, 1)
    # beside one gap the other step counts twice; alone between two, a detector owns one like others
    own = xp.where(wide & back_wide, xp.median(step), xp.where(wide, back, step))
    weights = (own + xp.where(back_wide, own, back)) / 2
    tangents = _tangents(xp, before, here, after)
    normals = xp.stack([tangents[:, 1], -tangents[:, 0]], axis=-1)
    return weights, outward(points, normals, points.mean(axis=0), xp)


def behind_gap(steps: Any, closed: bool, xp: Any = np) -> Bool[Array | np.ndarray, " detectors"]:
    """After which detectors the curve has a gap, by numpy or jax.numpy.

    Every step is compared with the largest of three medians: of the three steps before it, of the
    three after it, and of all. So nothing breaks off where the density of detectors changes.

    Args:
        steps: to the next detector, (detectors,), the last one back to the first [length].
        closed: whether the last one belongs to the curve.
    """
    k, three = np.arange(len(steps))[:, None], np.arange(1, 4)
    before, after, last = k - three, k + three, max(len(steps) - 2, 0)
    if closed:
        before, after = before % len(steps), after % len(steps)
    else:
        before, after = np.maximum(before, 0), np.minimum(after, last)
        before, after = np.where(k > 0, before, after), np.where(k < last, after, before)
    beside = xp.maximum(xp.median(steps[before], axis=1), xp.median(steps[after], axis=1))
    every = xp.median(steps if closed else steps[:-1])  # three steps of scattered positions may
    wide = steps > _WIDE * xp.maximum(beside, every)  # all be short by chance
    return wide if closed else wide | (np.arange(len(steps)) > last)


def in_plane(positions: Numbers) -> Float[Array, "detectors 2"]:
    points = real_array("positions", positions, ("detectors", None))
    if points.shape[1] not in (2, 3):
        raise ValueError(f"positions has shape {points.shape}, expected (detectors, 2 or 3).")
    if points.shape[1] == 2:
        return points
    if not is_concrete(points):
        raise ValueError("traced positions must be (detectors, 2): drop the constant coordinate.")
    flat = flat_axis(np.asarray(points))
    if flat is None:
        raise ValueError(
            "the detectors do not lie in a coordinate plane: their coordinates spread over "
            f"{np.ptp(np.asarray(points), axis=0)}; rotate them into a plane and pass the two "
            "coordinates in it."
        )
    return by_library(lambda xp, points: xp.delete(points, flat, axis=1), (points,))


def flat_axis(points: np.ndarray) -> int | None:
    """The axis normal to the coordinate plane of the points; None if they lie in no such plane.

    Those of two coordinates lie in the first two axes.
    """
    if points.shape[1] == 2:
        return 2
    spread = np.ptp(points, axis=0)
    flat = int(np.argmin(spread))
    return flat if spread[flat] <= 1e-3 * spread.max() else None


def is_closed(points: np.ndarray) -> bool:
    """Whether the last detector is a neighbour of the first."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return bool(np.linalg.norm(points[0] - points[-1]) <= 2 * np.median(steps))


def require_sorted(points: np.ndarray, closed: bool) -> None:
    """Neighbours in the array must be neighbours on the curve: no repeats, turns back or jumps."""
    steps = np.diff(np.concatenate([points, points[:1]]), axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    inner = lengths if closed else lengths[:-1]
    if inner.min() == 0.0:
        k = int(np.argmin(inner))
        raise ValueError(f"detectors {k} and {k + 1} are at the same position: leave one out.")
    directions = steps[: len(inner)] / inner[:, None]
    turns = np.sum(directions[1:] * directions[:-1], axis=1)
    advice = "sort the detectors along the curve (an arc: by angle) and their data with them."
    if turns.min() < -0.8:  # swapped neighbours turn right round, a coarse triangle by 120 degrees
        k = int(np.argmin(turns)) + 1
        raise ValueError(
            f"the detectors are not in order: the curve turns back at {k}; {advice} If they "
            "scatter about a smooth curve, give detector_curve(..., smooth=5) or more."
        )
    wide = behind_gap(lengths, True)
    # several wide gaps are those between separate pieces
    if wide[: len(inner)].any() and (closed or not wide[-1]):
        k = int(np.argmax(np.where(wide[: len(inner)], inner, 0.0)))
        raise ValueError(
            f"the detectors are not in order: the widest opening lies between detectors {k} and "
            f"{k + 1}, inside the sequence; start behind it with np.roll(..., -{k + 1}, axis=0), "
            "the data likewise, or say whether the curve is closed (closed=True or False)."
        )


def _same_points(points: np.ndarray, distance: float) -> set[tuple[int, int]]:
    from scipy.spatial import KDTree  # slow to import

    return KDTree(points).query_pairs(distance)


def require_simple(points: np.ndarray, closed: bool) -> None:
    """Raise ValueError for a curve that crosses or repeats itself, not counting wide gaps."""
    near = _SAME * np.ptp(points, axis=0).max()
    shadow = np.sort(points @ (np.cos(1.0), np.sin(1.0)))  # equal points are neighbours in it
    if np.diff(shadow).min(initial=np.inf) <= near and (same := _same_points(points, near)):
        i, j = min(same)
        raise ValueError(
            f"detectors {i} and {j} are at the same position, {points[i]}: leave one out, or go "
            "along the curve only once."
        )
    ends = np.roll(points, -1, axis=0)
    whole = ~behind_gap(np.hypot(*(ends - points).T), closed)
    numbers = np.flatnonzero(whole)
    crossing = first_crossing(points[whole], ends[whole])
    if crossing is not None:
        i, j = numbers[list(crossing)]
        raise ValueError(
            f"the curve crosses itself: behind detectors {i} and {j}, at {points[i]}. Sort the "
            "detectors along the curve, or make separate curves of it and use join_curves."
        )


def _neighbours(xp: Any, points: Any, closed: bool) -> tuple[Any, Any, Any]:
    """For each detector the three points of its circle; open ends take two from one side."""
    number = np.arange(len(points))
    before, after = np.roll(number, 1), np.roll(number, -1)
    if not closed:
        before[0], after[-1] = number[2], number[-3]
    return points[before], points, points[after]


def _tangents(xp: Any, before: Any, here: Any, after: Any) -> Any:
    """Unit tangents at ``here`` of the circles through the three points.

    Inversion about ``here`` maps the circle to a straight line parallel to its tangent.
    """
    ahead, behind = after - here, before - here
    tangent = ahead / _square(ahead) - behind / _square(behind)
    # at the open ends both neighbours lie on one side; keep the direction of travel
    ends = (tangent[0] @ (here[1] - here[0]), tangent[-1] @ (here[-1] - here[-2]))
    signs = [xp.sign(end)[None] for end in ends]
    tangent = tangent * xp.concatenate([signs[0], np.ones(len(here) - 2), signs[1]])[:, None]
    return tangent / xp.sqrt(_square(tangent))


def _arc_to_next(xp: Any, before: Any, here: Any, after: Any) -> Any:
    """Arc length (2/κ) asin(κ c/2) over the chord c to the next point, κ of the three points."""
    chord = xp.sqrt(_square(xp.roll(here, -1, axis=0) - here))
    a, b = after - here, before - here
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    curvature2 = 4 * cross**2 / (_square(a) * _square(b) * _square(a - b))[:, 0]
    # the chord that closes an open curve is no arc of it, and is replaced by the caller
    x2 = xp.minimum(curvature2 * chord[:, 0] ** 2 / 4, 0.999)
    small = x2 < 1e-8  # asin(x)/x, by its series where the quotient and its derivative are 0/0
    x = xp.sqrt(xp.where(small, 0.5, x2))
    return chord[:, 0] * xp.where(small, 1 + x2 / 6, xp.arcsin(x) / x)


def _square(vectors: Any) -> Any:
    return (vectors**2).sum(axis=-1, keepdims=True)
