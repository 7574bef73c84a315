"""Curves of detectors, regions of interest, image grids and data radii.

All lengths of a problem are in one unit: metres, millimetres, or the
radius of the region of interest as in the paper.
"""

from .arcs import ArcFit, fit_arc, order_along_curve
from .balls import Ball, ball
from .bodies import (
    BallBody,
    Body,
    DiskBody,
    OutlineBody,
    around_body,
    body_about,
    radial_step,
    region_about,
    require_surrounded,
)
from .caps import DetectorPoints, SphericalCap, spherical_cap
from .circles import Circle, circle_through, fit_circle, near_circle
from .curves import CircularArc, DetectorCurve, SampledCurve, circular_arc, turned_views
from .grids import Grid, ImageGrid, VolumeGrid
from .line_weights import transverse_weight
from .measured_curves import detector_curve, in_plane, keep_detectors
from .polygons import Polygon, RegionUnion, polygon, rectangle, union_of_regions
from .radii import data_radii, require_radii, uncovered
from .regions import Disk, Region, disk, require_outside
from .rings import DetectorRings, find_rings
from .seen_lines import Visibility, VisibilityWarning, visibility
from .shapes import elliptic_arc, join_curves, parametric_curve, polyline
from .visible_edges import VISIBLE, edge_weight, visibility_map, visible_disk

__all__ = [
    "VISIBLE",
    "ArcFit",
    "Ball",
    "BallBody",
    "Body",
    "Circle",
    "CircularArc",
    "DetectorCurve",
    "DetectorPoints",
    "DetectorRings",
    "Disk",
    "DiskBody",
    "Grid",
    "ImageGrid",
    "OutlineBody",
    "Polygon",
    "Region",
    "RegionUnion",
    "SampledCurve",
    "SphericalCap",
    "Visibility",
    "VisibilityWarning",
    "VolumeGrid",
    "around_body",
    "ball",
    "body_about",
    "circle_through",
    "circular_arc",
    "data_radii",
    "detector_curve",
    "disk",
    "edge_weight",
    "elliptic_arc",
    "find_rings",
    "fit_arc",
    "fit_circle",
    "in_plane",
    "join_curves",
    "keep_detectors",
    "near_circle",
    "order_along_curve",
    "parametric_curve",
    "polygon",
    "polyline",
    "radial_step",
    "rectangle",
    "region_about",
    "require_outside",
    "require_radii",
    "require_surrounded",
    "spherical_cap",
    "transverse_weight",
    "turned_views",
    "uncovered",
    "union_of_regions",
    "visibility",
    "visibility_map",
    "visible_disk",
]
