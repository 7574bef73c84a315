"""Images and operators with one speed of sound, through a disk of another, and through an ellipse.

A body 4 % faster than the water, detectors on 270 degrees of a circle of radius 1. "about the
middle": body and region of radius 0.45 about the detectors' centre; "off it": about (0.1, -0.06).
Errors are the largest against the phantom in the region, of data by the operator. What comes later
than the last direct wave is not recorded, and a body reflects some of it: errors have a floor.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    DiskBody,
    ImageGrid,
    OutlineBody,
    Setup,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    forward_operator,
    phantoms,
    reconstruct,
    solve,
)

RADIUS, SPEED = 0.45, 1.04
DETECTORS = {129: 256, 257: 512}
PLACES = {"about the middle": (0.0, 0.0), "off it": (0.1, -0.06)}
BODIES = {
    "one speed": lambda center: None,
    "disk": lambda center: DiskBody(center, RADIUS, SPEED, 1.0),
    "ellipse": lambda center: OutlineBody.ellipse(center, (RADIUS, 0.38), SPEED, 1.0),
}


class Case:
    """A setup, an image, and its data."""

    def __init__(self, n, place, body):
        center = PLACES[place]
        curve = circular_arc(1.0, 1 / np.sqrt(2), DETECTORS[n])
        region, medium = disk(RADIUS, center=center), BODIES[body](center)
        grid = ImageGrid(n, RADIUS, center)
        radii = data_radii(curve, region, grid.spacing[0], medium=medium)
        self.setup = Setup(curve, region, grid, radii, medium=medium)
        middles = np.array([[0.12, 0.1], [-0.15, -0.05]]) + center
        self.bells = phantoms.Bells(middles, [0.2, 0.15])
        self.operator = forward_operator(self.setup)
        self.g = self.operator(self.bells.image(grid))

    def error(self, image):
        grid = self.setup.grid
        inside = self.setup.region.contains(grid.points)
        return jnp.abs(image - self.bells.image(grid))[inside].max()


@pytest.mark.parametrize("body", ["one speed", "disk"])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("n", DETECTORS)
def bench_image(measure, n, place, body):
    case = Case(n, place, body)
    measure(lambda: solve(case.setup, case.g, 1e-6).image, n=n, error=case.error)


@pytest.mark.parametrize("body", ["one speed", "disk"])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("n", DETECTORS)
def bench_operator(measure, n, place, body):
    case = Case(n, place, body)
    image = case.bells.image(case.setup.grid)
    measure(lambda: case.operator(image), n=n)


def bench_plan_of_an_ellipse(measure):
    case = Case(129, "off it", "ellipse")
    measure(lambda: jax.tree.leaves(build_plan(case.setup, 1e-6)), n=129, rounds=1)


def bench_image_through_an_ellipse(measure):
    case = Case(129, "off it", "ellipse")
    plan = build_plan(case.setup, 1e-6)
    measure(lambda: reconstruct(plan, case.g), n=129, error=case.error)
