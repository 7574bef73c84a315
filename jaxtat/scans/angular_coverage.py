"""Angle from which detectors see the region, and the speed of sound where they see edges once.

From less than about 200 degrees most edges are seen from one side. The speed is then that at which
an image in the region explains most; else a guess, by negative values. On such arcs the best image
f >= 0 explains a record nearly as well at a wrong speed (`misfit`): on arcs of 125 degrees these
two are nearer.
"""

import numpy as np
from jaxtyping import Float

from ..base.choice_table import GUESSED
from ..io import Scan
from .acquisition import facts_of
from .best_explained import speed_best_explained
from .choices import Choices
from .estimate import Estimate, Source
from .least_negative import speed_least_negative
from .speed_found import with_speed

SEEN_TWICE = 200.0  # degrees, from which on most edges are seen from both sides
TOLD_APART = 110.0  # from which on a slower speed and a body farther off sound different
BETWEEN = 0.5  # of the region's radius: as near to its centre a line between detectors comes


def with_speed_seen_once(scan: Scan, choices: Choices) -> Choices:
    """Choices with the sound speed estimated from a typical frame, or with water's.

    Args:
        scan, choices: in the plane, of pressure, at water's speed.
    """
    points, center = facts_of(scan).points[list(choices.channels)], choices.region_center
    degrees = span(points, np.asarray(center))
    why = f"from {degrees:.0f} degrees edges are seen once, and "
    if _hardly_between(points, np.asarray(center), choices.region_radius):
        why += "little of the region is between any two detectors"
    else:
        found = speed_best_explained(scan, choices)
        if found.source is Source.ESTIMATE:
            return with_speed(choices, found)
        why += found.why
    speed = speed_least_negative(scan, choices) if degrees >= TOLD_APART else None
    if speed is None:
        return with_speed(choices, Estimate(1.0, why, GUESSED))
    why = f"the image is least negative: {why}"
    return with_speed(choices, Estimate(speed, why, GUESSED, Source.ESTIMATE))


def _hardly_between(points: np.ndarray, center: np.ndarray, radius: float) -> bool:
    """Whether hardly a line between two detectors passes the region.

    From half a circle, only edges across the lines between its ends are seen twice.
    """
    first, last = points[0] - center, points[-1] - center
    return span(points, center) < SEEN_TWICE and _aside(first, last) > BETWEEN * radius


def span(points: Float[np.ndarray, "detectors 2"], center: np.ndarray) -> float:
    """Angle under which the curve is seen from the region's centre, without its gap [degrees].

    >>> float(round(span(np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]), np.zeros(2)), 6))
    180.0
    """
    angles = np.sort(np.arctan2(*(points - center).T))
    gaps = np.diff(angles, append=angles[0] + 2 * np.pi)
    return float(np.degrees(2 * np.pi - gaps.max()))


def _aside(end: Float[np.ndarray, "2"], other: Float[np.ndarray, "2"]) -> float:
    """Distance of the origin from the line through two points."""
    along = (other - end) / max(float(np.hypot(*(other - end))), 1e-300)
    return abs(float(end[0] * along[1] - end[1] * along[0]))
