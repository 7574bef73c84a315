"""Where the detectors are: arrays of scanners, about the origin, in metres.

jaxtat is imported where it is needed: `two_speeds.py` runs without it.
"""

from typing import NamedTuple

import numpy as np


class Array(NamedTuple):
    """Detectors.

    Attributes:
        positions: (detectors, 3), along the curve [m].
        radius: of the largest circle about the origin without detectors [m].
    """

    positions: np.ndarray
    radius: float


def arc(radius: float, degrees: float, n: int, turn: float = 90.0) -> Array:
    """Detectors on an arc whose middle lies at the angle ``turn``; 360 degrees is a ring."""
    ends = degrees * (n - 1) / n if degrees == 360 else degrees
    theta = np.radians(turn + np.linspace(-ends / 2, ends / 2, n))
    points = radius * np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)
    return Array(points, radius)


def ellipse(n: int) -> Array:
    """Five sixths of an ellipse of half-axes 45 and 38 mm."""
    from jaxtat import elliptic_arc

    curve = elliptic_arc((45e-3, 38e-3), n, start=np.radians(-60), stop=np.radians(240))
    return Array(np.insert(np.asarray(curve.points), 2, 0.0, axis=1), 38e-3)


def cap(rings: int, around: int) -> Array:
    """Rings on a spherical cap of 40 mm that is open at the top."""
    from jaxtat.spherical import spherical_cap

    points = np.asarray(spherical_cap(40e-3, 28e-3, rings, around).points)
    return Array(points.reshape(-1, 3), 40e-3)


ARRAYS = {
    "arc270": lambda share: arc(40.5e-3, 270, int(256 * share)),
    "arc125": lambda share: arc(40.5e-3, 125, int(256 * share)),
    "arc180": lambda share: arc(40e-3, 180, int(128 * share), turn=-90.0),
    "ring": lambda share: arc(40e-3, 360, int(512 * share)),
    "quarter": lambda share: arc(40e-3, 90, int(128 * share), turn=30.0),
    "ellipse": lambda share: ellipse(int(256 * share)),
    "cap": lambda share: cap(24, 56),
}
"""By name: functions of the share of the detectors that are wanted."""
