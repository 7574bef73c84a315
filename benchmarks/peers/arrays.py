"""Where the detectors are: five arrays about a body of 7 mm, (detectors, 2) [m]."""

import numpy as np

RADIUS = 24e-3


def _arc(degrees: float, n: int, half_axes: tuple[float, float] = (RADIUS, RADIUS)) -> np.ndarray:
    """An arc whose middle is at the top, a whole ring for 360 degrees."""
    ends = degrees * (n - 1) / n if degrees == 360 else degrees
    theta = np.radians(90 + np.linspace(-ends / 2, ends / 2, n))
    return np.stack([half_axes[0] * np.cos(theta), half_axes[1] * np.sin(theta)], axis=1)


ARRAYS = {
    "ring": _arc(360, 256),
    "arc270": _arc(270, 192),
    "half": _arc(180, 128),
    "ellipse": _arc(300, 212, (24e-3, 20e-3)),
    "arc125": _arc(125, 128),
}
