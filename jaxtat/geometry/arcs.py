"""Circle, arc, order and opening of measured detectors.

NumPy throughout: positions from a file decide sizes, and need no compiled program.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .circles import ROUND, fit_circle
from .measured_curves import is_closed, require_sorted

SMOOTH = 0.8  # cosine of the sharpest turn of a smooth curve


class ArcFit(NamedTuple):
    """The arc of a circle along which detectors lie.

    Attributes:
        center: of the circle, (x1, x2) [length].
        radius: R_g [length].
        deviation: root mean square distance of the detectors from the circle [length].
        span: the angle of the arc from first to last detector, 2π of a ring [rad].
        step: median angle between neighbours [rad].
        opening: direction in which the arc opens [rad].
        chord: where the ends lie along that direction, from the centre; infinite for a ring
            [length].
    """

    center: tuple[float, float]
    radius: float
    deviation: float
    span: float
    step: float
    opening: float
    chord: float

    @property
    def closed(self) -> bool:
        return bool(np.isinf(self.chord))


def fit_arc(points: Float[np.ndarray, "detectors 2"]) -> ArcFit:
    """Circle, span and opening of detectors in order along an arc.

    Raises:
        ValueError: as `fit_circle`.

    >>> theta = np.radians(np.arange(100, 371))  # opens towards 55 degrees
    >>> arc = fit_arc(0.04 * np.stack([np.cos(theta), np.sin(theta)], axis=1))
    >>> [round(float(np.degrees(angle)), 6) for angle in (arc.span, arc.opening)]
    [270.0, 55.0]
    """
    circle = fit_circle(points)
    center, radius = np.asarray(circle.center), float(circle.radius)
    offset = points - center
    deviation = float(np.sqrt(np.mean((np.hypot(*offset.T) - radius) ** 2)))
    angles = np.unwrap(np.arctan2(offset[:, 1], offset[:, 0]))
    step = float(np.median(np.abs(np.diff(angles))))
    closed = is_closed(points)
    span = 2 * np.pi if closed else abs(float(angles[-1] - angles[0]))
    opening = 0.0 if closed else float((angles[0] + angles[-1]) / 2 + np.pi)
    chord = np.inf if closed else radius * float(np.cos(np.pi - span / 2))
    middle = (float(center[0]), float(center[1]))
    return ArcFit(middle, radius, deviation, span, step, _principal(opening), chord)


def order_along_curve(points: Float[np.ndarray, "detectors 2"]) -> Int[np.ndarray, " detectors"]:
    """Indices that put detectors in order along their curve.

    Detectors that come in order, along whatever curve, stay as they are. Others are sorted by their
    angle about the circle through them, anticlockwise, beginning behind the widest gap.

    Raises:
        ValueError: for two detectors at one place, and detectors out of order that lie neither on a
            circle nor, sorted in this way, on a smooth curve such as an ellipse.

    >>> theta = np.array([3.0, 1.0, 2.0, 5.0, 4.0])
    >>> order_along_curve(np.stack([np.cos(theta), np.sin(theta)], axis=1)).tolist()
    [1, 2, 0, 4, 3]
    """
    try:
        require_sorted(points, is_closed(points))
        return np.arange(len(points))
    except ValueError as error:
        try:
            circle = fit_circle(points)
        except ValueError:
            raise error from None
        out_of_order = error
    offset = points - np.asarray(circle.center)
    angles = np.arctan2(offset[:, 1], offset[:, 0])
    order = np.argsort(angles, kind="stable")
    gaps = np.diff(angles[order], append=angles[order[0]] + 2 * np.pi)
    order = np.roll(order, -(int(np.argmax(gaps)) + 1))
    round_enough = np.abs(np.hypot(*offset.T) / float(circle.radius) - 1).max() <= ROUND
    if not (round_enough or _smooth(points[order])):
        raise out_of_order from None
    require_sorted(points[order], is_closed(points[order]))
    return order


def _smooth(points: Float[np.ndarray, "detectors 2"]) -> bool:
    """Whether a curve through points in order nowhere turns sharply: it has no corners."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if lengths.min() == 0.0:
        return False
    cosines = np.sum(steps[1:] * steps[:-1], axis=1) / (lengths[1:] * lengths[:-1])
    return bool(cosines.min() > SMOOTH)


def _principal(angle: float) -> float:
    """The angle modulo 2π, between -π and π."""
    return float(np.arctan2(np.sin(angle), np.cos(angle)))
