"""A body of another speed of sound, and detectors on no circle: unevenly along an ellipse.

Each has its own distance from the body, and its own table in the forward operator.
"""

import numpy as np
import pytest
from gaussians_in_a_body import (
    CENTER,
    RADII,
    RADIUS,
    body,
    gaussians,
    series,
    waves_at_the_detectors,
)

from jaxtat import (
    ImageGrid,
    OutlineBody,
    Setup,
    Tikhonov,
    build_plan,
    circular_arc,
    detector_curve,
    disk,
    forward_operator,
    live,
    model_based,
    reconstruct,
    solve,
)
from jaxtat.geometry import circle_through
from jaxtat.studies import data_residual, pixel_standard_deviation

pytestmark = pytest.mark.slow

HALF_AXES = np.array([1.1, 0.95])
SMALL = ImageGrid(21, 0.45, CENTER)
INSIDE = np.asarray(disk(0.42, center=CENTER).contains(SMALL.points))


def ellipse(n):
    """Closer by turns, over 270 degrees; on no circle to rounding."""
    t = np.linspace(-0.75 * np.pi, 0.75 * np.pi, n)
    t = t + 0.3 / n * np.sin(2.6 * np.arange(n))
    return detector_curve(HALF_AXES * np.stack([np.cos(t), np.sin(t)], axis=1))


def outline():
    """The circle of the disk."""
    return OutlineBody.ellipse(CENTER, (RADIUS, RADIUS), 1.04, 1.0)


BODIES = pytest.mark.parametrize("medium", [body(), outline()], ids=["disk", "outline"])


def setup_of(medium, n=40, grid=SMALL, radii=RADII[::2]):
    return Setup(ellipse(n), disk(RADIUS, center=CENTER), grid, radii, medium=medium)


def relative(found, wanted):
    return np.linalg.norm(found - wanted) / np.linalg.norm(wanted)


@pytest.fixture(scope="module")
def data():
    return forward_operator(setup_of(body()))(gaussians(SMALL))


def test_waves_at_the_detectors_are_those_of_the_series():
    """Every frequency of the forward operator, at distances that differ by a fifth."""
    medium, grid = body(0.9, 1.1), ImageGrid(65, 0.45, CENTER)
    setup = setup_of(medium, 24, grid, RADII)
    assert circle_through(setup.curve) is None
    found = waves_at_the_detectors(setup, grid, medium, gaussians(grid))
    wanted = series(medium, np.asarray(setup.curve.points), setup.sizes.operator.frequencies).real
    assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max()


def test_detectors_of_a_circle_record_the_same_beside_one_that_is_off_it():
    """Which takes the waves of all from tables, where those of an arc are moved by two FFTs."""
    arc = circular_arc(1.0, np.cos(np.pi / 4), 40)
    points = np.concatenate([arc.points, [(-0.9, 0.0)]])
    where = disk(RADIUS, center=CENTER), SMALL, RADII[::2]
    one, other = (Setup(curve, *where, medium=body()) for curve in (arc, detector_curve(points)))
    assert circle_through(other.curve) is None
    wanted = forward_operator(one)(gaussians(SMALL))
    found = forward_operator(other)(gaussians(SMALL))[:-1]
    assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max()


@BODIES
def test_the_transpose_is_exact(medium, data):
    rng = np.random.default_rng(0)
    f, g = rng.standard_normal(SMALL.shape), rng.standard_normal(data.shape)
    operator = forward_operator(setup_of(medium))
    assert np.isclose(np.vdot(operator(f), g), np.vdot(f, operator.T(g)), rtol=1e-11)


@BODIES
def test_the_image_of_its_own_data(medium):
    """By solve and by a plan; with one speed it is wrong."""
    setup, truth = setup_of(medium, 60, radii=RADII), gaussians(SMALL)[INSIDE]
    data = forward_operator(setup)(gaussians(SMALL))
    image = solve(setup, data, 1e-7).image
    one = solve(setup_of(None, 60, radii=RADII), data, 1e-7).image
    assert relative(image[INSIDE], truth) < 0.03 < 0.2 < relative(one[INSIDE], truth)
    planned = reconstruct(build_plan(setup, Tikhonov(1e-7)), data)
    assert np.abs(planned - image).max() < 1e-7 * np.abs(image).max()


def test_an_outline_that_is_a_circle_is_a_disk(data):
    """Data, images, live ones, their spread, what is not explained, and fits."""
    one, other = setup_of(body()), setup_of(outline())
    image = gaussians(SMALL)
    assert np.abs(forward_operator(other)(image) - data).max() < 1e-8 * np.abs(data).max()

    def alike(of, tolerance):
        wanted, found = of(one), of(other)
        assert np.nanmax(np.abs(found - wanted)) < tolerance * np.nanmax(np.abs(wanted))
        return wanted

    alike(lambda setup: solve(setup, data, 1e-6).image, 1e-8)
    alike(lambda setup: live(setup, rule=1e-6, dtype=np.float64)(data), 1e-8)
    alike(lambda setup: pixel_standard_deviation(setup, 0.1, 1e-4), 1e-7)
    alike(lambda setup: data_residual(setup, data, 0.9 * image).relative, 1e-7)
    fitted = alike(lambda setup: model_based(setup, data, weight=1e-4, max_steps=60).image, 1e-6)
    assert relative(fitted[INSIDE], image[INSIDE]) < 0.1


@BODIES
def test_live_images_are_those_of_solve_also_of_another_body(medium, data):
    setup = setup_of(medium)
    faster = OutlineBody.ellipse(CENTER, (RADIUS, 0.4), 1.06, 1.0)
    if not isinstance(medium, OutlineBody):
        faster = body(1.06)
    to_images = live(setup, rule=1e-6, dtype=np.float64)
    for images, here in (
        (to_images, setup),
        (to_images.replace(medium=faster), setup.replace(medium=faster)),
    ):
        wanted = solve(here, data, 1e-6).image
        assert np.abs(images(data) - wanted).max() < 1e-8 * np.abs(wanted).max()
