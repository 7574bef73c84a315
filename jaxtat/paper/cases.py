"""The paper's two geometries, its phantoms and its grid."""

from dataclasses import dataclass

from ..geometry import ImageGrid, circular_arc, data_radii, disk
from ..phantoms import Bells, Disks
from ..reconstruction import Setup

N_PIXELS, N_DETECTORS, N_BOUNDARY = 129, 500, 1000
ARC_RADIUS = 1.3


@dataclass(frozen=True)
class Case:
    """One geometry: everything is cut at x_1 = ``right``, and data radii are the pixel apart."""

    name: str
    right: float
    smooth: Bells
    disks: Disks
    setup: Setup


def paper_cases() -> tuple[Case, Case]:
    """Geometry #1 (three quarters of a circle, whole disk) and #2 (half a circle, half a disk)."""
    return (
        _case(
            "geometry1",
            1.0,
            Bells([[0.3, 0.3], [-0.4, 0.2]], [0.55, 0.5]),
            Disks(
                [[0.0, 0.0], [0.2, 0.35], [-0.35, -0.1], [0.3, -0.4]],
                [0.8, 0.25, 0.15, 0.2],
                [1.0, 0.5, -0.5, 1.0],
            ),
        ),
        _case(
            "geometry2",
            0.0,
            Bells([[-0.45, 0.3], [-0.5, -0.3]], [0.35, 0.3]),
            Disks([[-0.5, 0.3], [-0.45, -0.35], [-0.5, 0.35]], [0.3, 0.25, 0.1], [1.0, 0.7, -0.5]),
        ),
    )


def _case(name: str, right: float, smooth: Bells, disks: Disks) -> Case:
    grid = ImageGrid(N_PIXELS)
    curve = circular_arc(ARC_RADIUS, right, N_DETECTORS)
    region = disk(1.0, right, n_boundary=N_BOUNDARY)
    # in both geometries the paper's 129 radii, those that the whole disk needs
    whole = disk(1.0, n_boundary=N_BOUNDARY)
    radii = data_radii(curve, region, grid.spacing[0], sources=whole)
    return Case(name, right, smooth, disks, Setup(curve, region, grid, radii))
