"""A body of another speed of sound: its numbers, what is refused, and ways through it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special as sp
from jax.test_util import check_grads

from jaxtat import (
    DiskBody,
    ImageGrid,
    OutlineBody,
    Setup,
    circular_arc,
    data_radii,
    disk,
)
from jaxtat.geometry import polygon, region_about
from jaxtat.geometry.bodies import lag

BODY = DiskBody((0.1, -0.06), 0.45, 1560.0, 1500.0)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"radius": 0.0}, "radius is 0.0, expected a value above zero"),
        ({"radius": np.nan}, "radius is nan"),
        ({"center": (0.0, 0.0, 0.0)}, r"center has shape \(3,\), expected \(2\)"),
        ({"sound_speed": 1.5}, "a ratio of 0.001, expected 0.7 to 1.4: give both in the same"),
        ({"water_speed": -1500.0}, "water_speed is -1500.0, expected a value above zero"),
        ({"density_ratio": 0.0}, "density_ratio is 0.0"),
    ],
)
def test_what_is_no_body_is_refused(changed, message):
    given = {"center": (0, 0), "radius": 0.4, "sound_speed": 1560.0, "water_speed": 1500.0}
    with pytest.raises(ValueError, match=message):
        DiskBody(**(given | changed))


@pytest.mark.parametrize(
    ("curve", "region", "medium", "message"),
    [
        (circular_arc(0.5, 0.5, 60), disk(0.3), BODY, "a detector is 0.38.* expected detectors in"),
        (circular_arc(1.3, 1.3, 60), disk(0.6), BODY, "region reaches 0.716.* sources in the body"),
        (circular_arc(1.3, 1.3, 60), disk(0.4), 1560.0, "medium is 1560.0, expected .* DiskBody"),
    ],
)
def test_what_does_not_go_together_is_refused(curve, region, medium, message):
    with pytest.raises(ValueError, match=message):
        Setup(curve, region, ImageGrid(21), medium=medium)


def test_numbers_are_traced():
    def ratio(c):
        return DiskBody((0.0, 0.0), 0.4, c, 1500.0).speed_ratio

    assert np.isclose(jax.jit(jax.grad(ratio))(1560.0), 1 / 1500)
    assert np.isclose(BODY.source_strength, (1500 / 1560) ** 2)


def test_the_least_disk_about_the_body():
    around = region_about(BODY, disk(0.3, center=(0.2, -0.06)))
    assert np.isclose(around.radius, 0.4)
    corners = np.array([[-0.2, -0.3], [0.3, -0.3], [0.3, 0.2]])
    farthest = np.hypot(*(corners - BODY.center).T).max()
    found = float(region_about(BODY, polygon(corners)).radius)
    assert farthest - 0.01 < found <= farthest


def test_lags_by_steps_along_the_way():
    detectors, points = np.array([(1.0, 0.2), (0.1, 1.0)]), np.array([(0.0, 0.0), (0.3, 0.3)])
    share = (np.arange(20000) + 0.5) / 20000
    way = detectors[:, None, None] + share[:, None] * (points - detectors[:, None])[:, :, None]
    inside = (np.linalg.norm(way - np.asarray(BODY.center), axis=-1) < 0.45).mean(axis=-1)
    length = np.linalg.norm(points - detectors[:, None], axis=-1)
    found = lag(BODY, jnp.asarray(detectors), jnp.asarray(points))
    assert np.abs(found - length * inside * (1500 / 1560 - 1)).max() < 1e-5


def test_radii_are_those_of_the_time_in_water():
    """Across the body that is concentric: 0.55 in water, then 0.9 at another speed."""
    body = DiskBody((0.0, 0.0), 0.45, 0.9, 1.0)
    curve, region = circular_arc(1.0, 1.0, 90), disk(0.45, n_boundary=90)
    radii = data_radii(curve, region, 0.01, medium=body)
    assert np.isclose(radii[0], 0.55, atol=1e-3)
    assert -1e-9 < radii[-1] - (0.55 + 0.9 / 0.9) < 0.011
    setup = Setup(curve, region, ImageGrid(21, 0.45), radii[:-10], medium=body)
    assert not setup.complete
    assert Setup(curve, region, ImageGrid(21, 0.45), radii[:-10]).complete


@pytest.mark.parametrize(
    ("points", "speeds", "message"),
    [
        (np.ones((5, 2)), (1.0, 1.0), "outline has 5 points, expected at least 8"),
        (np.full((9, 2), np.nan), (1.0, 1.0), "points .*NaN"),
        ("eight", (1.0, 1.0), "crosses itself, or is not seen whole"),
        ("circle", (2.0, 1.0), "a ratio of 2, expected 0.7 to 1.4"),
    ],
)
def test_outlines_that_are_refused(points, speeds, message):
    t = 2 * np.pi * np.arange(16) / 16
    shapes = {
        "eight": np.stack([np.cos(t), np.sin(2 * t)], axis=1),
        "circle": np.stack([np.cos(t), np.sin(t)], axis=1),
    }
    points = shapes[points] if isinstance(points, str) else points
    with pytest.raises(ValueError, match=message):
        OutlineBody(points, *speeds)


def test_a_stretched_disk_is_an_ellipse():
    """Half axes a exp(±|s|), the longer at half of the angle of s; at s = 0 derivatives too."""
    axes, turn = np.array([0.5, 0.4]), 0.35
    stretch = np.log(axes[0] / axes[1]) / 2 * np.array([np.cos(2 * turn), np.sin(2 * turn)])
    ellipse = OutlineBody.ellipse((0.1, 0.0), axes, 1.04, 1.0, angle=turn)
    radius = np.sqrt(axes.prod())
    made = OutlineBody.stretched_disk((0.1, 0.0), radius, stretch, 1.04, 1.0)
    rim = np.asarray(made.points) - [0.1, 0.0]
    np.testing.assert_allclose(ellipse.relative_radius(made.points), 1.0, rtol=1e-4)
    along = np.array([np.cos(turn), np.sin(turn)])
    across = rim @ [-along[1], along[0]]
    np.testing.assert_allclose((rim @ along / axes[0]) ** 2 + (across / axes[1]) ** 2, 1.0)

    def points(s):
        return OutlineBody.stretched_disk((0.0, 0.0), 0.4, s, 1.04, 1.0).points

    for at in (jnp.zeros(2), jnp.array([1e-5, 2e-5]), jnp.asarray(stretch)):
        check_grads(points, (at,), order=2, modes=("fwd", "rev"), rtol=1e-5)


def test_shares_of_the_way_to_the_rim():
    points = jnp.array([[0.1, 0.34], [0.55, -0.06], [0.1, -0.06]])
    np.testing.assert_allclose(BODY.relative_radius(points), [0.4 / 0.45, 1.0, 0.0], atol=1e-12)
    ellipse = OutlineBody.ellipse((0.1, -0.06), (0.45, 0.2), 1.04, 1.0)
    np.testing.assert_allclose(ellipse.relative_radius(points), [2.0, 1.0, 0.0], atol=1e-3)


@pytest.mark.parametrize("ratio", [1.02, 1.08, 1.3])
@pytest.mark.parametrize("k", [150.0, 400.0])
def test_beyond_the_rim_waves_of_a_faster_body_have_not_grown(ratio, k):
    """Of orders that travel in water alone; those of a slower body do not grow."""
    away = jnp.linspace(0.9, 1.25, 351)[:, None] * 0.45 * jnp.array([0.6, -0.8])
    points, k = jnp.asarray(BODY.center) + away, jnp.asarray(k)
    for make, most in (
        (lambda c: DiskBody(BODY.center, 0.45, c, 1.0), 5.0),
        (lambda c: OutlineBody.ellipse(BODY.center, (0.45, 0.45), c, 1.0), 2.0),
    ):
        sound, sizes = (
            np.asarray(each)
            for each in (make(ratio).may_sound(points, k), make(ratio).relative_radius(points))
        )
        assert sound[sizes <= 1].all() and sizes[sound].max() > 1
        orders = np.arange(np.ceil(k * 0.45), np.floor(ratio * k * 0.45) + 1)
        grown = sp.jv(orders, k * 0.45 * sizes[sound].max()) / sp.jv(orders, k * 0.45)
        assert np.max(grown) < np.exp(most)
        assert np.asarray(make(1 / ratio).may_sound(points, k)).all()


def test_rims_are_those_of_an_ellipse_and_the_middle_sounds():
    """At the tip and at the flat side as far out; a distance of zero is no NaN."""
    ellipse = OutlineBody.ellipse((0.0, 0.0), (0.6, 0.4), 1.2, 1.0)
    beyond = jnp.linspace(0.0, 0.1, 401)
    reach = []
    for rim, along in ((0.6, (1.0, 0.0)), (0.4, (0.0, 1.0))):
        sound = ellipse.may_sound((rim + beyond)[:, None] * jnp.array(along), jnp.asarray(100.0))
        reach.append(float(beyond[np.asarray(sound)].max()))
    np.testing.assert_allclose(reach, 2.0 / (100.0 * np.sqrt(0.44)), atol=3e-4)
    assert bool(ellipse.may_sound(jnp.zeros(2), jnp.asarray(100.0)))
