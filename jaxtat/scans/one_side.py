"""Whether detectors lie on one side of the region, and see its edges once or twice."""

import numpy as np
from jaxtyping import Float

from ..io import Scan
from .acquisition import facts_of
from .choices import Choices

SEEN_TWICE = 200.0  # degrees, from which on most edges are seen from both sides
TOLD_APART = 110.0  # from which on a slower speed and a body farther off sound different
BETWEEN = 0.5  # of the region's radius: as near to its centre a line between detectors comes


def seen_once(scan: Scan, choices: Choices) -> bool:
    """Whether hardly a line between two detectors passes the region.

    From half a circle, only edges across the lines between its ends are seen twice.

    Args:
        scan, choices: in the plane.
    """
    points = facts_of(scan).points[list(choices.channels)]
    center = np.asarray(choices.region_center)
    first, last = points[0] - center, points[-1] - center
    from_one_side = span(points, center) < SEEN_TWICE
    return from_one_side and _aside(first, last) > BETWEEN * choices.region_radius


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
