"""A ball of another speed of sound as the medium of a setup: what is refused, radii, images."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import DiskBody, ImageGrid, Setup, VolumeGrid, circular_arc, disk, model_based
from jaxtat.forward import pressure_terms
from jaxtat.reconstruction import forward_operator, operator_on, solve
from jaxtat.spherical import BallBody, ball, cap_radii, spherical_cap

pytestmark = pytest.mark.slow

CAP = spherical_cap(1.0, 0.7, 13, 28)
MIDDLE, OFF, RADIUS = np.zeros(3), np.array([0.05, 0.0, 0.1]), 0.45


def body(center=MIDDLE, speed=1.06, radius=RADIUS, water_speed=1.0):
    return BallBody(center, radius, speed, water_speed)


def through(center=MIDDLE, **changed):
    parts = {"curve": CAP, "region": ball(RADIUS, center=center), "medium": body(center)} | changed
    return Setup(grid=VolumeGrid(9, RADIUS, center), **parts)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"curve": spherical_cap(0.44, 0.44, 6, 12)}, "a detector is 0.44 .* in the water"),
        ({"medium": body(radius=0.3)}, "region reaches 0.45 .* sources in the body"),
        ({"medium": body(OFF)}, "the region is centred at .* the body at .*same center"),
        (
            {"medium": DiskBody((0.0, 0.0), 0.5, 1.1, 1.0)},
            "a DiskBody, expected .* in space .*Ball",
        ),
        (
            {"curve": circular_arc(1.0, 0.7, 40), "region": disk(0.4), "grid": ImageGrid(9)},
            "a BallBody, expected .* in the plane what DiskBody or OutlineBody makes",
        ),
    ],
)
def test_what_does_not_go_together_is_refused(changed, message):
    parts = {"curve": CAP, "region": ball(RADIUS), "grid": VolumeGrid(9, RADIUS), "medium": body()}
    with pytest.raises(ValueError, match=message):
        Setup(**(parts | changed))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"speed": 1.5}, "a ratio of 1.5, expected 0.7 to 1.4"),
        ({"speed": 0.6}, "a ratio of 0.6, expected 0.7 to 1.4"),
        ({"radius": 0.0}, "radius is 0.0, expected a value above zero"),
        ({"center": (0.0, 0.0)}, r"center has shape \(2,\), expected \(3\)"),
    ],
)
def test_what_is_no_body_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        body(**changed)


def test_elements_of_a_size_face_the_centre_of_the_body():
    wide = spherical_cap(1.0, 0.7, 9, 18, element_radius=0.1)
    with pytest.raises(ValueError, match="face another centre than that of the body"):
        through(OFF, curve=wide)


def test_radii_are_those_of_the_time_in_water():
    """0.55 in water, then 0.9 at another speed."""
    radii = cap_radii(CAP, ball(RADIUS), 0.01, body(speed=0.9))
    assert np.isclose(radii[0], 0.55, atol=1e-3)
    assert -1e-9 < radii[-1] - (0.55 + 0.9 / 0.9) < 0.011
    assert not through(medium=body(speed=0.9), radii=radii[:-10]).complete
    assert Setup(CAP, ball(RADIUS), VolumeGrid(9, RADIUS), radii[:-10]).complete


def bells(grid):
    local = np.asarray(grid.points) - np.asarray(grid.center)
    square = [np.sum((local - at) ** 2, axis=-1) for at in ((0.1, 0.08, 0.0), (-0.12, 0.0, -0.1))]
    return np.exp(-square[0] / 0.03) + 0.7 * np.exp(-square[1] / 0.03)


def relative_error(setup, image):
    truth, inside = bells(setup.grid), np.asarray(setup.region.contains(setup.grid.points))
    return np.linalg.norm((image - truth)[inside]) / np.linalg.norm(truth[inside])


@pytest.mark.parametrize("center", [MIDDLE, OFF], ids=["on rings", "off the centre"])
def test_the_image_of_the_data_of_a_ball(center):
    setup = through(center)
    g = forward_operator(setup)(bells(setup.grid))
    assert g.shape == setup.data_shape
    one = setup.replace(medium=body(center, 1.0))
    errors = [relative_error(each, solve(each, g, 1e-6).image) for each in (setup, one)]
    assert errors[0] < 0.03 < 0.12 < errors[1]


def test_pressure_is_fitted_by_the_speeds_of_the_body():
    medium = body(OFF, 1590.0, water_speed=1500.0)
    setup, times = through(OFF, medium=medium), np.arange(0.0, 2.2, 0.05) / 1500
    record = pressure_terms(setup.sizes.inside, 1500 * jnp.asarray(times))
    pressure = operator_on(setup, setup.grid, record=record)(bells(setup.grid))
    found = model_based(setup, pressure, times=times, weight=1e-6, max_steps=60)
    assert relative_error(setup, found.image) < 0.1
    with pytest.raises(ValueError, match="sound_speed is given, and the setup has a medium"):
        model_based(setup, pressure, times=times, sound_speed=1500.0)
