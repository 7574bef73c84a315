"""Where the detectors, the region of interest, the image and the data radii are.

Lengths are in any one unit, the same for everything in a problem: metres, millimetres, or the
radius of the region of interest as in the paper.
"""

from .arcs import ArcFit, fit_arc, order_along_curve
from .curves import (
    Circle,
    CircularArc,
    DetectorCurve,
    SampledCurve,
    circular_arc,
    detector_curve,
    fit_circle,
    in_plane,
    keep_detectors,
    turned_views,
)
from .grids import ImageGrid
from .radii import data_radii, require_cover
from .regions import Region, TruncatedDisk, require_outside, truncated_disk
from .transverse_weight import transverse_weight
from .visibility import Visibility, VisibilityWarning, visibility
from .visible_edges import VISIBLE, edge_weight, visibility_map

__all__ = [
    "VISIBLE",
    "ArcFit",
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
    "edge_weight",
    "fit_arc",
    "fit_circle",
    "in_plane",
    "keep_detectors",
    "order_along_curve",
    "require_cover",
    "require_outside",
    "transverse_weight",
    "truncated_disk",
    "turned_views",
    "visibility",
    "visibility_map",
]
