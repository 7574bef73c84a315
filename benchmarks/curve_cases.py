"""Curves that are no arc and regions that are no disk, at any size, each with smooth bells."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jaxtat import (
    ImageGrid,
    circular_arc,
    data_radii,
    detector_curve,
    disk,
    elliptic_arc,
    join_curves,
    phantoms,
    polygon,
    polyline,
    rectangle,
    union_of_regions,
)

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
    region: Callable  # n_collocation -> Region
    bells: list
    visible: bool = True

    def setup(self, n: int, n_detectors: int):
        """(curve, region, grid, radii, phantom) with n x n pixels."""
        curve, region = self.curve(n_detectors), self.region(2 * n_detectors)
        grid = ImageGrid(n)
        radii = data_radii(curve, region, grid.spacing[0])
        return curve, region, grid, radii, phantoms.Bells(*zip(*self.bells, strict=True))


def half_disk(m: int):
    return disk(1.0, 0.0)


def disk(m: int):
    return disk(1.0)


CASES = {
    "ellipse, half disk": CurveCase(ellipse, half_disk, HALF),
    "L, triangle": CurveCase(
        l_shape,
        lambda m: polygon([(-0.65, -0.65), (0.75, -0.65), (-0.65, 0.75)]),
        [([-0.35, -0.35], 0.28), ([-0.3, 0.1], 0.2), ([0.1, -0.4], 0.2)],
    ),
    "U, disk": CurveCase(u_shape, disk, GEOMETRY_1),
    "U, rectangle": CurveCase(
        u_shape,
        lambda m: rectangle((0.8, 0.6)),
        [([0.3, 0.2], 0.38), ([-0.35, -0.1], 0.4)],
    ),
    "jagged arc, disk": CurveCase(jagged(1.0), disk, GEOMETRY_1),
    "jagged arc, half disk": CurveCase(jagged(0.0), half_disk, HALF),
    "two arcs, polygon": CurveCase(two_arcs, lambda m: polygon(CAP), IN_CAP),
    "two arcs, two polygons": CurveCase(
        two_arcs,
        lambda m: union_of_regions(polygon(CAP), polygon([(-x, -y) for x, y in CAP])),
        [*IN_CAP, ([0.65, 0.1], 0.25)],
    ),
    "ellipse, region poking out": CurveCase(
        ellipse,
        lambda m: disk(1.0, 0.3),
        [([-0.45, 0.3], 0.35), ([0.0, -0.3], 0.28)],
        visible=False,
    ),
    "half circle, whole disk": CurveCase(
        lambda n: circular_arc(1.3, 0.0, n), disk, GEOMETRY_1, visible=False
    ),
    "two arcs, whole disk": CurveCase(two_arcs, disk, GEOMETRY_1, visible=False),
}
