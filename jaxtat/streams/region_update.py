"""The disk for which densities are computed, and the disk within it that is shown.

The densities hold for all sources in their disk. Another disk within it is the same function at
other pixels, so that showing it takes no time; one that leaves it is another problem.

By numpy: positions are known, and nothing is compiled for them.
"""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from ..base.checks import Numbers, real_array, require_positive
from ..geometry import Disk, ImageGrid, Region, disk
from ..geometry.radii import covers
from ..reconstruction import Setup
from ..reconstruction.setup import plane_of
from ..scans import Choices

ROUNDING = 1e-9  # relative, by which a disk may stand out


def wider_setup(setup: Setup, reach: Numbers, n_groups: int) -> Setup:
    """The setup for all sources within ``reach`` of the region's centre, which the radii cover."""
    curve, region, radii, sizes = plane_of(setup)
    around = disk(_reach_of(reach, region), center=region.center)
    highest = sizes.max_frequency
    return Setup(curve, around, setup.grid, radii, max_frequency=highest, _n_groups=n_groups)


def wider_choices(choices: Choices, reach: Numbers, points: np.ndarray | None) -> Choices:
    """The choices for a wider region, as `wider_setup`.

    Args:
        choices: with radii that cover its region.
        reach: of the disk [length].
        points: detectors that are used, whose radii get more where they do not cover the disk, as
            close as before; None where the data have radii of their own.
    """
    assert isinstance(choices.region, Disk)
    radius = _reach_of(reach, choices.region)
    wider = dataclasses.replace(choices, region_radius=radius, region_cut=radius)
    if points is None:
        return wider
    first, step, last = choices.first_radius, choices.radial_step, float(choices.radii[-1])
    distance = np.linalg.norm(np.asarray(points) - np.asarray(choices.region_center), axis=1)
    before = max(0, math.ceil((first - (distance.min() - radius)) / step))
    behind = max(0, math.ceil((distance.max() + radius - last) / step))
    before = min(before, math.ceil(first / step) - 1)  # radii are positive
    n_radii = choices.n_radii + before + behind
    return dataclasses.replace(wider, first_radius=first - before * step, n_radii=n_radii)


def _reach_of(reach: Numbers, region: Region) -> float:
    value = real_array("reach", reach, ())
    require_positive("reach", value)
    if not (isinstance(region, Disk) and region.whole):
        raise ValueError("reach is for whole disks: leave it out for other regions.")
    if value < region.radius * (1 - ROUNDING):
        raise ValueError(
            f"reach is {float(value):.6g}, expected at least the region's radius "
            f"{float(region.radius):.6g}."
        )
    return float(value)


def another_disk(region: Region, center: Numbers | None, radius: Numbers | None) -> Disk:
    """A disk moved to a centre, and of another radius."""
    if not isinstance(region, Disk):
        raise ValueError("region_center moves disks; make another function for other regions.")
    middle = region.center if center is None else real_array("region_center", center, (2,))
    size = region.radius if radius is None else real_array("region_radius", radius, ())
    require_positive("region_radius", size)
    if radius is not None and not region.whole:
        raise ValueError("region_radius is for whole disks; make another function for a cut one.")
    middle, scale = np.asarray(middle), float(size) / float(region.radius)
    points = middle + scale * (np.asarray(region.points) - np.asarray(region.center))
    parts = points, scale * np.asarray(region.weights), middle, np.asarray(size)
    return eqx.tree_at(
        lambda r: (r.points, r.weights, r.center, r.radius), region, jax.device_put(parts)
    )


def lies_in(region: Region, around: Region) -> bool:
    """Whether a disk lies in a whole one."""
    if not (isinstance(region, Disk) and isinstance(around, Disk) and around.whole):
        return False
    apart = np.linalg.norm(np.asarray(region.center) - np.asarray(around.center))
    farthest = apart + float(region.radius)
    return bool(farthest <= float(around.radius) * (1 + ROUNDING))


def grid_of(grid: ImageGrid, before: Disk, after: Disk) -> ImageGrid:
    """A grid about another disk, with as many pixels."""
    scale = float(after.radius) / float(before.radius)
    middle = np.asarray(after.center) + scale * (
        np.asarray(grid.center) - np.asarray(before.center)
    )
    parts = jax.device_put((scale * np.asarray(grid.half_width), middle))
    return eqx.tree_at(lambda g: (g.half_width, g.center), grid, parts)


def moved(setup: Setup, center: Array, free: bool) -> Setup:
    """The disk about another centre.

    Radii that cover it too stay as they are, as in `scans.reconstruct`, so that what depends on
    them alone does; free ones that do not go along, as many as before.
    """
    region, radii = setup.region, np.asarray(setup.radii)
    assert isinstance(region, Disk)
    before, after = (
        np.linalg.norm(np.asarray(setup.curve.points) - np.asarray(middle), axis=1)
        for middle in (region.center, center)
    )
    nearest, farthest = after.min() - region.radius, after.max() + region.radius
    if free and not covers(radii, float(nearest), float(farthest)):
        first = radii[0] + after.min() - before.min()
        radii = np.linspace(first, radii[-1] + after.max() - before.max(), len(radii))
    return setup.replace(region=another_disk(region, center, None), radii=jax.device_put(radii))


def placed(setup: Setup, before: Region, after: Disk, free: bool) -> tuple[Setup, bool]:
    """The setup that shows another disk, and whether it is another problem."""
    assert isinstance(before, Disk)
    around, solved_anew = setup.region, not lies_in(after, setup.region)
    if solved_anew:
        if float(after.radius) > float(around.radius) * (1 + ROUNDING):
            raise ValueError(
                f"region_radius is {float(after.radius):.6g}, and densities are for a disk of "
                f"{float(around.radius):.6g}: make another function, with a larger reach."
            )
        setup = moved(setup, after.center, free)
    grid: Any = grid_of(setup.grid, before, after)
    return eqx.tree_at(lambda s: s.grid, setup, grid), solved_anew
