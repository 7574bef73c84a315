"""A ball of another speed of sound, off the middle of the detectors, estimated from the record."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat.forward import pressure_terms, sphere_integrals, sphere_sizes
from jaxtat.geometry import DetectorPoints, VolumeGrid
from jaxtat.io import Scan
from jaxtat.scans import choose, estimate_body, misfit_in_space, setup_of
from jaxtat.scans.space import facts_in_space
from jaxtat.spherical import BallBody, SolidBells

pytestmark = pytest.mark.slow

WATER, TISSUE, RADIUS, CENTER = 1500.0, 1560.0, 0.012, np.array([2e-3, -1.5e-3, 1.5e-3])
BODY = BallBody(CENTER, RADIUS, TISSUE, WATER)
RATE, DISTANCE = 1e7, 0.04
BELLS = SolidBells(
    CENTER + 3.5e-3 * np.array([[1, 1, 0], [-1, 0.5, 1], [0, -1, -1], [0.5, -1, 1], [-1, 0, -1]]),
    [6e-3, 5.5e-3, 6e-3, 5e-3, 5.5e-3],
    [1.0, 0.8, 0.6, 1.0, 0.7],
)
GRID = VolumeGrid(25, RADIUS, CENTER)


def spiral(n):
    """Points on a sphere that is open above."""
    height, turn = np.linspace(0.7, -1, n), np.pi * (3 - 5**0.5) * np.arange(n)
    beside = np.sqrt(1 - height**2)
    return DISTANCE * np.stack([beside * np.cos(turn), beside * np.sin(turn), height], axis=1)


@pytest.fixture(scope="module")
def through_ball():
    """The record of bells by the forward operator, on voxels that the estimate does not have."""
    curve, times = DetectorPoints(spiral(48), None, np.zeros(3)), np.arange(440) / RATE
    sizes = sphere_sizes(curve, GRID, BODY)
    operator = sphere_integrals(curve, GRID, jnp.ones(1), sizes, None, 1e-6, BODY)
    recorded = operator.recorded(pressure_terms(sizes, WATER * jnp.asarray(times)))
    return np.asarray(eqx.filter_jit(recorded)(BELLS.volume(GRID)[None])[0])


def scan_of(pressure, **known):
    return Scan("pressure", pressure, {"detectors": spiral(48), "sampling_rate": RATE} | known)


def test_choices_go_through_the_ball_that_the_record_tells(through_ball, monkeypatch):
    """With the water's speed alone; its centre is that of the region then."""
    monkeypatch.setattr(misfit_in_space, "VOXELS", 13)
    scan = scan_of(through_ball)
    through = choose(scan, water_speed=WATER, region_radius=0.0145)
    assert through.sound_speed == pytest.approx(TISSUE, abs=8.0)
    assert through.body_radius == pytest.approx(RADIUS, rel=0.05)
    np.testing.assert_allclose(through.body_center, CENTER, atol=4e-4)
    assert through.region_center == through.body_center and through.region_radius == 0.0145
    assert through.water_speed == WATER and through.grade("sound_speed") == "likely"
    assert 0 < dict(through.standard_errors)["body_radius"] < 5e-4


def test_the_region_is_about_a_ball_that_is_given(through_ball):
    body = {"sound_speed": TISSUE, "water_speed": WATER, "body_radius": RADIUS}
    choices = choose(scan_of(through_ball), **body, body_center=CENTER, region_radius=0.0145)
    assert eqx.tree_equal(choices.medium, BODY, rtol=1e-9)
    np.testing.assert_allclose(choices.region_center, CENTER, rtol=1e-12)
    np.testing.assert_allclose(choices.region.center, CENTER, rtol=1e-12)


def test_detectors_of_rings_that_open_downwards_stay_where_they_are():
    """About a ball off their middle they are no rings that are taken in their mirror."""
    heights, turn = np.linspace(-0.5, 0.9, 9), 2 * np.pi * np.arange(12) / 12
    across = np.sqrt(1 - heights[:, None] ** 2) * np.ones(12)
    parts = across * np.cos(turn), across * np.sin(turn), heights[:, None] * np.ones(12)
    points = DISTANCE * np.stack(parts, axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(0)
    known = {"detectors": points, "sampling_rate": RATE}
    scan = Scan("pressure", rng.standard_normal((len(points), 440)), known)
    assert facts_in_space(scan).upside_down
    body = {"sound_speed": TISSUE, "water_speed": WATER, "body_radius": RADIUS}
    given = {"region_radius": 0.0145, "max_frequency": 200.0, "model_based": True}
    choices = choose(scan, **body, body_center=CENTER, **given)
    setup = setup_of(scan, choices)
    order = list(choices.channels)
    np.testing.assert_allclose(setup.curve.points, points[order], atol=1e-12)
    np.testing.assert_allclose(setup.curve.center, CENTER, rtol=1e-12)


def test_frames_that_cannot_be_are_refused(through_ball):
    scan = scan_of(through_ball)
    chosen = choose(scan, sound_speed=1520.0, region_radius=0.0145)
    damaged = through_ball.copy()
    damaged[3, 7] = np.nan
    with pytest.raises(ValueError, match="frame holds 1 NaN"):
        estimate_body(scan, chosen, damaged)
    with pytest.raises(ValueError, match=r"frame has shape .*, expected"):
        estimate_body(scan, chosen, through_ball[:5])


def test_elements_of_a_size_have_no_ball_off_their_middle(through_ball):
    scan = scan_of(through_ball, element_radius=np.asarray(1e-3))
    chosen = choose(scan, sound_speed=1520.0, region_radius=0.0145)
    with pytest.raises(ValueError, match="elements without a size"):
        estimate_body(scan, chosen, through_ball)
    with pytest.raises(ValueError, match="elements have a size and face another centre"):
        choose(scan, sound_speed=TISSUE, water_speed=WATER, body_center=CENTER)
