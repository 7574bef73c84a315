"""Curves that are no arc and regions that are no disk, at any size, each with smooth bells."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jaxtat import (
    ImageGrid,
    Setup,
    circular_arc,
    detector_curve,
    disk,
    elliptic_arc,
    phantoms,
    polygon,
    polyline,
)
from jaxtat.geometry import Region, join_curves, rectangle, union_of_regions

GEOMETRY_1 = [([0.3, 0.3], 0.55), ([-0.4, 0.2], 0.5)]
HALF = [([-0.45, 0.3], 0.35), ([-0.5, -0.3], 0.3)]
CAP = [(-0.4, 0.75), (-0.75, 0.6), (-0.97, 0.2), (-0.97, -0.2), (-0.75, -0.6), (-0.4, -0.75)]
IN_CAP = [([-0.65, 0.25], 0.24), ([-0.7, -0.2], 0.22)]


def ellipse(n: int):
    return elliptic_arc((1.6, 1.25), n, start=np.pi / 2, stop=3 * np.pi / 2)


def l_shape(n: int):
    return polyline([(-0.8, 1.2), (-0.8, -0.8), (1.2, -0.8)], n)


def u_shape(n: int):
    return polyline([(1.2, 1.2), (-1.2, 1.2), (-1.2, -1.2), (1.2, -1.2)], n)


def jagged(z_right: float) -> Callable:
    """Detectors off their arc by 2 % of its radius, twice their spacing at 500."""

    def curve(n: int):
        arc = circular_arc(1.3, z_right, n)
        off = 1 + 0.02 * np.random.default_rng(5).standard_normal(n)
        scattered = np.asarray(arc.points) * off[:, None]
        return detector_curve(scattered, closed=False, smooth=max(3, n // 40))

    return curve


def two_arcs(n: int):
    cut = 1.3 * np.cos(np.radians(105))  # 75 degrees to each side
    return join_curves(*(circular_arc(1.3, cut, n // 2, angle=angle) for angle in (0.0, np.pi)))


@dataclass(frozen=True)
class CurveCase:
    """A curve, a region, and bells (centre, radius) within it."""

    curve: Callable  # n_detectors -> DetectorCurve
    region: Region
    bells: list
    visible: bool = True

    def setup(self, n: int, n_detectors: int) -> tuple[Setup, phantoms.Bells]:
        """With n x n pixels, and the phantom."""
        bells = phantoms.Bells(*zip(*self.bells, strict=True))
        return Setup(self.curve(n_detectors), self.region, ImageGrid(n)), bells


HALF_DISK, DISK = disk(1.0, 0.0), disk(1.0)

CASES = {
    "ellipse, half disk": CurveCase(ellipse, HALF_DISK, HALF),
    "L, triangle": CurveCase(
        l_shape,
        polygon([(-0.65, -0.65), (0.75, -0.65), (-0.65, 0.75)]),
        [([-0.35, -0.35], 0.28), ([-0.3, 0.1], 0.2), ([0.1, -0.4], 0.2)],
    ),
    "U, disk": CurveCase(u_shape, DISK, GEOMETRY_1),
    "U, rectangle": CurveCase(
        u_shape,
        rectangle((0.8, 0.6)),
        [([0.3, 0.2], 0.38), ([-0.35, -0.1], 0.4)],
    ),
    "jagged arc, disk": CurveCase(jagged(1.0), DISK, GEOMETRY_1),
    "jagged arc, half disk": CurveCase(jagged(0.0), HALF_DISK, HALF),
    "two arcs, polygon": CurveCase(two_arcs, polygon(CAP), IN_CAP),
    "two arcs, two polygons": CurveCase(
        two_arcs,
        union_of_regions(polygon(CAP), polygon([(-x, -y) for x, y in CAP])),
        [*IN_CAP, ([0.65, 0.1], 0.25)],
    ),
    "ellipse, region poking out": CurveCase(
        ellipse,
        disk(1.0, 0.3),
        [([-0.45, 0.3], 0.35), ([0.0, -0.3], 0.28)],
        visible=False,
    ),
    "half circle, whole disk": CurveCase(
        lambda n: circular_arc(1.3, 0.0, n), DISK, GEOMETRY_1, visible=False
    ),
    "two arcs, whole disk": CurveCase(two_arcs, DISK, GEOMETRY_1, visible=False),
}
