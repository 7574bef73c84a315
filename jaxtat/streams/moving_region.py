"""The disk that densities are solved for, and the disk within it that is shown.

Densities hold for all sources in their disk: another disk within it is the same function at other
pixels. One that leaves it has another `Setup`, whose systems are solved anew.
"""

import math

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..base.checks import Numbers, real_array, require_positive
from ..base.units import ROUNDING
from ..geometry import Disk, ImageGrid, Region, disk
from ..geometry.grids import Grid
from ..geometry.radii import covers, data_radii
from ..reconstruction import Setup
from ..reconstruction.setup import plane_of, require_complete

N_GROUPS = 8  # of frequencies that have as many orders: the fewer, the more rows are zero


def moved_disk(region: Region, center: Numbers | None, radius: Numbers | None) -> Disk:
    """A disk about another centre, and of another radius if it is whole."""
    if not isinstance(region, Disk):
        raise ValueError("region_center moves disks; make another function for other regions.")
    middle = region.center if center is None else real_array("region_center", center, (2,))
    size = region.radius if radius is None else real_array("region_radius", radius, ())
    require_positive("region_radius", size)
    if radius is not None and not region.whole:
        raise ValueError("region_radius is for whole disks; make another function for a cut one.")
    cut = None if region.whole else region.cut
    return disk(size, cut, center=middle, angle=region.angle).with_counts(region.counts)


def moved_grid(grid: Grid, before: Region, after: Disk) -> ImageGrid:
    """A grid about another disk as the one before lay about its own, with as many pixels."""
    scale = float(after.radius) / float(before.reach)
    off = np.asarray(grid.center) - np.asarray(before.center)
    return ImageGrid(
        grid.shape, scale * np.asarray(grid.half_width), np.asarray(after.center) + scale * off
    )


def lies_in(region: Disk, around: Region) -> bool:
    """Whether a disk lies in another one, which is whole."""
    if not (isinstance(around, Disk) and around.whole):
        return False
    apart = np.linalg.norm(np.asarray(region.center) - np.asarray(around.center))
    return bool(apart + float(region.radius) <= float(around.radius) * (1 + ROUNDING))


def setup_showing(
    setup: Setup, before: Region, after: Disk, end: float | None
) -> tuple[Setup, bool]:
    """The setup that shows another disk, and whether it is for another one than before.

    Args:
        setup: whose region is solved for.
        before, after: disks that are shown.
        end: the largest radius of the record [length]; None for circular integrals.

    Raises:
        ValueError: for a larger disk, and for one that detectors or data do not surround.
    """
    around, grid = setup.region, moved_grid(setup.grid, before, after)
    if lies_in(after, around):
        return eqx.tree_at(lambda setup: setup.grid, setup, grid), False
    if float(after.radius) > float(around.radius) * (1 + ROUNDING):
        raise ValueError(
            f"region_radius is {float(after.radius):.6g}, and densities are for a disk of "
            f"{float(around.radius):.6g}: make another function, with a larger reach."
        )
    moved = moved_disk(around, after.center, None)
    try:
        return _setup_around(setup, moved, grid, end), True
    except ValueError as error:
        size, (x1, x2) = float(moved.radius), np.asarray(moved.center)
        raise ValueError(
            f"a disk of radius {size:.6g} about ({x1:.6g}, {x2:.6g}): {error}"
        ) from error


def setup_within_reach(setup: Setup, reach: Numbers, end: float | None) -> Setup:
    """The setup for all sources within ``reach`` of the region's centre.

    Args:
        setup: of the region.
        reach: of the disk [length].
        end: as in `setup_showing`.
    """
    _, region, _, _ = plane_of(setup)
    value = real_array("reach", reach, ())
    require_positive("reach", value)
    if not (isinstance(region, Disk) and region.whole):
        raise ValueError("reach is for whole disks: leave it out for other regions.")
    if value < region.radius * (1 - ROUNDING):
        raise ValueError(
            f"reach is {float(value):.6g}, expected at least the region's radius "
            f"{float(region.radius):.6g}."
        )
    return _setup_around(setup, disk(value, center=region.center), setup.grid, end)


def _setup_around(setup: Setup, region: Disk, grid: Grid, end: float | None) -> Setup:
    """The same detectors and highest frequency for another disk, with radii that cover it."""
    curve, _, radii, sizes = plane_of(setup)
    radii = np.asarray(radii)
    if end is not None:
        wanted = data_radii(curve, region, radii[1] - radii[0], medium=setup.medium)
        radii = _covering(radii, np.asarray(wanted), end)
    made = Setup(
        curve,
        region,
        grid,
        radii,
        medium=setup.medium,
        max_frequency=sizes.max_frequency,
        _n_groups=N_GROUPS,
    )
    require_complete(made)
    return made


def _covering(
    radii: Float[np.ndarray, " radii"], wanted: Float[np.ndarray, " wanted"], end: float
) -> Float[np.ndarray, " more"]:
    """Radii with more of them, as close as before, where they do not cover the wanted ones."""
    if covers(radii, wanted[0], wanted[-1]):
        return radii
    first, step = radii[0], radii[1] - radii[0]
    before = min(max(0, math.ceil((first - wanted[0]) / step)), math.ceil(first / step) - 1)
    behind = max(0, math.ceil((min(wanted[-1], end) - radii[-1]) / step))
    more = first + step * np.arange(-before, len(radii) + behind)
    return more[more <= end * (1 + ROUNDING)]
