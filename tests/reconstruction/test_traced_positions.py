"""Concrete and traced positions give one image: what is decided by values is decided once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    NormBound,
    Setup,
    Tikhonov,
    build_plan,
    circular_arc,
    detector_curve,
    disk,
    polygon,
    reconstruct,
)
from jaxtat.geometry import union_of_regions

THETA = np.linspace(-2.2, 2.0, 24)
ELLIPSE = detector_curve(np.stack([1.6 * np.cos(THETA), 1.4 * np.sin(THETA)], axis=1), closed=False)
ARC = circular_arc(1.5, 1.0, 24)
CORNERS = np.array([(-0.7, -0.3), (-0.3, -0.3), (-0.4, 0.3)])
UNION = union_of_regions(polygon(CORNERS), polygon(-CORNERS + np.array([0.0, 0.1])))
PROBLEMS = {
    "ellipse": (ELLIPSE, disk(0.9)),
    "cut disk": (circular_arc(1.5, 0.1, 24), disk(1.0, 0.1)),
    "disk off the centre": (ARC, disk(0.8, center=(-0.15, 0.1))),
    "union": (ARC, UNION),
}


def problem(name):
    curve, region = PROBLEMS[name]
    setup = Setup(curve, region, ImageGrid(9), max_frequency=6.0, n_directions=8)
    g = jnp.asarray(np.random.default_rng(0).normal(size=setup.data_shape))
    return setup, g, np.asarray(region.contains(setup.grid.points))


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_images_of_concrete_and_traced_positions_are_the_same(name):
    setup, g, inside = problem(name)

    def image(setup):
        return reconstruct(setup, g, 1e-3)

    parts = {"curve": setup.curve, "region": setup.region}
    traced = jax.jit(lambda parts: image(setup.replace(**parts)))(parts)
    eager = np.asarray(image(setup))
    np.testing.assert_allclose(traced, eager, atol=1e-10 * np.abs(eager[inside]).max())


@pytest.mark.parametrize(("name", "rule"), [("ellipse", NormBound(2.0)), ("union", Tikhonov(1e-3))])
def test_plans_of_concrete_and_traced_positions_are_the_same(name, rule):
    setup, g, inside = problem(name)

    def image(curve):
        return reconstruct(build_plan(setup.replace(curve=curve), rule), g)

    eager = np.asarray(image(setup.curve))
    traced = jax.jit(image)(setup.curve)
    np.testing.assert_allclose(traced, eager, atol=1e-9 * np.abs(eager[inside]).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ellipse", "disk off the centre"])
def test_derivatives_are_those_of_the_eager_function(name):
    """Detectors moved together and apart: differences of concrete positions."""
    setup, g, inside = problem(name)
    turn = np.random.default_rng(1).normal(size=setup.curve.points.shape)

    def energy(step):
        points = setup.curve.points + step * turn
        curve = detector_curve(points, closed=setup.curve.closed)
        return jnp.sum(
            jnp.where(inside, reconstruct(setup_of.replace(curve=curve), g, 1e-3), 0) ** 2
        )

    start = detector_curve(setup.curve.points, closed=setup.curve.closed)
    setup_of = Setup(
        start, setup.region, setup.grid, setup.radii, max_frequency=6.0, n_directions=8
    )
    slope = float(jax.jacfwd(energy)(0.0))
    wide, narrow = (float(energy(h) - energy(-h)) / (2 * h) for h in (1e-4, 5e-5))
    np.testing.assert_allclose((4 * narrow - wide) / 3, slope, rtol=1e-6)
