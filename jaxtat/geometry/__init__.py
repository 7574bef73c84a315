"""Where the detectors, the region of interest, the image and the data radii are.

Lengths are in any one unit, the same for everything in a problem: metres, millimetres, or the
radius of the region of interest as in the paper.
"""

from .curves import (
    Circle,
    CircularArc,
    DetectorCurve,
    SampledCurve,
    circular_arc,
    detector_curve,
    fit_circle,
    turned_views,
)
from .grids import ImageGrid
from .radii import data_radii, require_cover
from .regions import Region, TruncatedDisk, require_outside, truncated_disk
from .visibility import Visibility, VisibilityWarning, visibility

__all__ = [
    "Circle",
    "CircularArc",
    "DetectorCurve",
    "ImageGrid",
    "Region",
    "SampledCurve",
    "TruncatedDisk",
    "Visibility",
    "VisibilityWarning",
    "circular_arc",
    "data_radii",
    "detector_curve",
    "fit_circle",
    "require_cover",
    "require_outside",
    "truncated_disk",
    "turned_views",
    "visibility",
]
