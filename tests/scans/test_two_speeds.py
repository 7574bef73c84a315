"""Scans of a body whose speed of sound is another than the water's, by given speeds."""

import json
import shlex
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from made_scans import BELLS, RATE, TIMES, positions

from jaxtat import DiskBody, ImageGrid, Setup, detector_curve, disk, live, phantoms
from jaxtat.cli import main
from jaxtat.io import Scan
from jaxtat.records import simulate_pressure, water_speed
from jaxtat.scans import choose, reconstruct, trials, with_best_method
from jaxtat.viewer import Session

pytestmark = pytest.mark.slow

WATER, TISSUE, RADIUS, CENTER = 1480.0, 1600.0, 0.011, (1e-3, -5e-4)
BODY = DiskBody(CENTER, RADIUS, TISSUE, WATER)
CURVE = detector_curve(positions()[:, :2])
SIZES = {"region_radius": RADIUS, "region_center": CENTER, "pixels": 41, "max_frequency": 3500.0}
GIVEN = SIZES | {"sound_speed": TISSUE, "water_speed": WATER}


@pytest.fixture(scope="module")
def truth():
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"], [1.0, 0.7, 0.5])
    return lambda grid: np.asarray(bells.image(grid))


@pytest.fixture(scope="module")
def two_speeds(truth):
    """The record of the bells through the body, in finer pixels than images have."""
    setup = Setup(CURVE, disk(RADIUS, center=CENTER), ImageGrid(65, RADIUS, CENTER), medium=BODY)
    pressure = simulate_pressure(setup, truth(setup.grid), jnp.asarray(TIMES), model="in-plane")
    return Scan("pressure", np.asarray(pressure), {"detectors": positions(), "sampling_rate": RATE})


@pytest.fixture(scope="module")
def best_single_speed(two_speeds):
    """Told by the record."""
    speed = choose(two_speeds, band="none", two_speeds=False, **SIZES).sound_speed
    assert WATER < speed < TISSUE
    return speed


def error(found, truth):
    wanted, inside = truth(found.grid), np.asarray(found.region.contains(found.grid.points))
    return np.linalg.norm((found.image - wanted)[inside]) / np.linalg.norm(wanted)


@pytest.mark.parametrize("fit", [False, True], ids=["direct", "fitted"])
def test_images_through_the_body_are_right(two_speeds, best_single_speed, truth, fit):
    """And those by one speed, even the best, are not."""
    of_fit = {"model_based": True} if fit else {"alpha": 1e-6}  # no filter
    chosen = choose(two_speeds, band="none", **GIVEN, **of_fit)
    assert (chosen.water_speed, chosen.body_radius, chosen.body_center) == (WATER, RADIUS, CENTER)
    assert chosen.grade("body_radius") == "guessed" and chosen.grade("water_speed") == "sure"
    off = error(reconstruct(two_speeds, chosen), truth)
    one = choose(two_speeds, band="none", sound_speed=best_single_speed, **SIZES, **of_fit)
    off_of_one = error(reconstruct(two_speeds, one), truth)
    assert off < 0.1 and off < 0.5 * off_of_one, (off, off_of_one)


def test_the_body_is_kept_in_files_and_tables(two_speeds):
    chosen = choose(two_speeds, body_radius=0.0115, **GIVEN)
    again = type(chosen).from_settings(json.loads(json.dumps(chosen.settings())))
    assert again.settings() == chosen.settings() and again.medium.radius == 0.0115
    rows = {name: value for name, value, _, _ in chosen.rows()}
    assert (rows["water_speed"], rows["body_radius"]) == ("1480 m/s", "11.5 mm")
    one = choose(two_speeds, **SIZES, sound_speed=TISSUE)
    assert one.medium is None and "water_speed" not in one.table()


def test_the_speed_of_the_body_is_tried_and_radii_stay(two_speeds, monkeypatch):
    monkeypatch.setattr("jaxtat.scans.parameter_sweep.reconstruct", lambda scan, choices: choices)
    chosen = choose(two_speeds, **GIVEN)
    found = trials(two_speeds, chosen, GIVEN, "sound_speed", [1580.0, 1620.0])
    for one, speed in zip(found, (1580.0, 1620.0), strict=True):
        assert (one.sound_speed, one.water_speed) == (speed, WATER)


def test_images_through_a_body_are_fitted_where_one_speed_has_its_formula(two_speeds):
    chosen = replace(choose(two_speeds, **GIVEN), model="2d")
    single = replace(chosen, water_speed=None, body_radius=None, body_center=None)
    assert with_best_method(two_speeds, chosen).model_based
    assert not with_best_method(two_speeds, single).model_based


def test_live_images_go_through_the_body(two_speeds):
    chosen = choose(two_speeds, alpha=1e-4, **GIVEN)
    found = reconstruct(two_speeds, chosen)
    inside = np.asarray(found.region.contains(found.grid.points))
    image = np.asarray(live(two_speeds, chosen)(two_speeds.data))
    np.testing.assert_allclose(image[inside], found.image[inside], atol=2e-6)


def test_the_viewer_turns_both_speeds(two_speeds):
    session = Session(two_speeds, choose(two_speeds, alpha=1e-4, **GIVEN))
    first = session.image(session.start)
    controls = replace(session.start, sound_speed=1570.0, water_speed=1490.0)
    image = session.image(controls)[session.inside]
    turned = session.choices_of(controls)
    assert (turned.sound_speed, turned.water_speed, turned.body_radius) == (1570.0, 1490.0, RADIUS)
    assert dict(turned.reasons)["water_speed"] == "set in the viewer"
    wanted = reconstruct(two_speeds, turned).image[session.inside]
    np.testing.assert_allclose(image, wanted, atol=1e-4 * np.abs(wanted).max())
    assert np.abs(image - first[session.inside]).max() > 1e-2 * np.abs(wanted).max()
    assert np.array_equal(session.image(session.start), first, equal_nan=True)
    assert session.unexplained(controls) is None  # the curve is of one speed


def test_the_command_takes_two_speeds(two_speeds, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("scan.npz", pressure=two_speeds.data, **two_speeds.known)
    line = "reconstruct scan.npz --sound-speed 1600 --water-speed 1480 --direct --pixels 41"
    line += " --body-radius 0.0115 --body-center 0.001 -0.0005 --out a.h5"
    assert main(shlex.split(line)) == 0
    for name in ("a.npy", "b.npy"):
        assert main(shlex.split(f"reconstruct scan.npz --repeat a.h5 --out {name}")) == 0
    assert np.array_equal(np.load("a.npy"), np.load("b.npy"))


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"water_speed": 1490.0, "body_radius": 0.01}, "give sound_speed too. It is looked for"),
        ({"two_speeds": False, "water_speed": 1490.0}, "one speed is asked for, and water_speed"),
        ({"two_speeds": False, "water_temperature": 25.0}, "and water_temperature is of two"),
        ({"two_speeds": False, "body_radius": 0.01}, "and body_radius is of two"),
        ({"body_radius": 0.01}, "the speed around it is not: water_speed"),
        ({"water_speed": 900.0, "sound_speed": 1550.0}, "0.7 to 1.4"),
        ({"water_speed": -1.0, "sound_speed": 1550.0}, "water_speed is -1"),
        (
            {"water_speed": 1490.0, "sound_speed": 1550.0, "body_radius": 11.5},
            "body_radius is 1.15e[+]04 mm, expected less than the 40 mm of the detectors",
        ),
    ],
)
def test_parts_of_a_body_are_refused(two_speeds, given, reason):
    with pytest.raises(ValueError, match=reason):
        reconstruct(two_speeds, choose(two_speeds, **SIZES, **given))


def test_the_bodys_speed_is_looked_for_where_the_waters_is_given_alone(two_speeds, monkeypatch):
    """What is asked is whether and with what; the search itself has its own tests."""
    asked, found = [], choose(two_speeds, **GIVEN)

    def search(scan, given, shape):
        assert shape == "disk"
        asked.append(given["water_speed"])
        return found

    monkeypatch.setattr("jaxtat.scans.choosing.with_two_speeds", search)
    monkeypatch.setattr("jaxtat.scans.choosing.estimate_alpha", lambda scan, made: made)
    assert choose(two_speeds, water_speed=1490.0) is found
    assert choose(two_speeds, water_temperature=25.0) is found
    assert asked == [1490.0, pytest.approx(float(water_speed(25.0)))]
    of_file = replace(two_speeds, known={**two_speeds.known, "sound_speed": np.array(1550.0)})
    for scan, given in ((of_file, {}), (two_speeds, {"sound_speed": 1550.0})):
        chosen = choose(scan, water_speed=1490.0, **SIZES, **given)
        assert (chosen.sound_speed, chosen.water_speed) == (1550.0, 1490.0)


def test_one_speed_is_said_to_be_asked_for(two_speeds, best_single_speed, monkeypatch):
    chosen = choose(two_speeds, band="none", two_speeds=False, **SIZES)
    assert (chosen.sound_speed, chosen.water_speed) == (best_single_speed, None)
    row = next(row for row in chosen.rows() if row[0] == "sound_speed")
    assert row[3].endswith("; one speed is asked for")
    monkeypatch.setattr("jaxtat.scans.choosing.may_have_two", lambda *_: False)
    silent = choose(two_speeds, band="none", **SIZES)
    assert dict(chosen.standard_errors) == dict(silent.standard_errors)
    assert chosen.grade("sound_speed") == silent.grade("sound_speed")


@pytest.mark.parametrize("name", ["water_speed", "sound_speed", "time_shift", "dead_time"])
def test_integrals_have_no_speeds_and_no_times(name):
    integrals = Scan("circular_integrals", np.ones((90, 40)), {"detectors": positions()[:, :2]})
    with pytest.raises(ValueError, match=f"{name.replace('_', '.')} is of pressure records"):
        choose(integrals, **{name: 1490.0})
