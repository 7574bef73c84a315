"""A body that is an ellipse, estimated from the record, and choices that go through it."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from made_scans import RATE, TIMES, clear_body, positions

from jaxtat import (
    DiskBody,
    ImageGrid,
    OutlineBody,
    Setup,
    detector_curve,
    disk,
    model_based,
    phantoms,
)
from jaxtat.cli import main
from jaxtat.io import Scan
from jaxtat.records import simulate_pressure
from jaxtat.scans import body_criterion, body_estimate, choose, estimate_ellipse, two_speeds
from jaxtat.scans.acoustics import sound_of
from jaxtat.scans.body_criterion import through_bodies

pytestmark = pytest.mark.slow

WATER, TISSUE, AXES, ANGLE, CENTER = 1480.0, 1580.0, (0.012, 0.0098), 89.0, (1e-3, -5e-4)
RADIUS = float(np.sqrt(AXES[0] * AXES[1]))
WAYS = np.array(
    [(0.1, 30), (0.75, 40), (0.7, 100), (0.8, 160), (0.75, 215), (0.7, 280), (0.8, 340)]
)
UNIT = WAYS[:, :1] * np.stack([np.cos(a := np.deg2rad(WAYS[:, 1])), np.sin(a)], axis=1)
TURN = np.deg2rad(ANGLE)
MIDDLES = CENTER + UNIT * AXES @ [[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]]
BELLS = phantoms.Bells(MIDDLES, np.full(7, 0.002), [0.7, 1.0, 0.8, 1.2, 0.9, 1.1, 0.6])
BODY = OutlineBody.ellipse(CENTER, AXES, TISSUE, WATER, angle=np.deg2rad(ANGLE))
ONE = {"model": "in-plane", "sound_speed": 1505.0, "region_radius": 0.0125, "pixels": 41}
GIVEN = {"sound_speed": TISSUE, "water_speed": WATER, "body_center": CENTER, "body_axes": AXES}
DISK = clear_body(DiskBody(CENTER, RADIUS, TISSUE, WATER))
FOUND = DISK._replace(
    body=BODY,
    standard_errors=DISK.standard_errors | {"half_axes": 1e-4, "angle": 3.0},
    half_axes=AXES,
    angle=ANGLE,
)


def scan_of(pressure, **known):
    return Scan("pressure", pressure, {"detectors": positions(), "sampling_rate": RATE} | known)


@pytest.fixture(scope="module")
def through_ellipse():
    """The record of the bells through the body, in finer pixels than the estimate has."""
    curve, grid = detector_curve(positions()[:, :2]), ImageGrid(65, AXES[0], CENTER)
    setup = Setup(curve, disk(AXES[0], center=CENTER), grid, medium=BODY)
    return np.asarray(simulate_pressure(setup, BELLS.image(grid), TIMES, model="in-plane"))


def criterion_of(pressure, **others):
    scan = scan_of(pressure)
    chosen = choose(scan, **ONE | others)
    sound = sound_of(scan, chosen, pressure)
    return sound, chosen


def test_slopes_are_the_derivatives_of_what_is_left(through_ellipse, monkeypatch):
    """At a disk, where axes and angle have none."""
    monkeypatch.setattr(body_criterion, "PIXELS_OF_ELLIPSES", 17)
    sound, chosen = criterion_of(through_ellipse)
    through = through_bodies(sound, chosen, np.array(CENTER), RADIUS, ellipses=True)
    numbers = through.numbers(DISK.body)
    here = through.least(numbers, 0.1, 60)
    for k, step in ((1, 1.5e-5), (4, 2e-3), (5, 2e-3), (6, 0.5)):
        ahead, behind = (
            through.least(numbers + by * np.eye(7)[k], 0.1, 0, here.image) for by in (step, -step)
        )
        slope = (ahead.left - behind.left).sum() / (4 * step)
        assert slope == pytest.approx(here.slopes[k], rel=0.02)


@pytest.mark.parametrize("clear", [True, False])
def test_the_ellipse_is_told_by_its_record(clear, through_ellipse, monkeypatch):
    """From a disk that is clear, or from what sounds; it is upright, where angles jump."""
    monkeypatch.setattr(body_criterion, "PIXELS_OF_ELLIPSES", 17)
    scan, start = scan_of(through_ellipse), np.array(CENTER) + 3e-4
    body = DiskBody(start, RADIUS, TISSUE - 8.0, WATER + 3.0)
    disk = DISK._replace(body=body, clear=clear)
    found = estimate_ellipse(scan, choose(scan, **ONE), through_ellipse, disk)
    assert found.half_axes is not None and found.angle is not None and found.clear
    np.testing.assert_allclose(found.half_axes, AXES, rtol=0.04)
    assert abs((found.angle - ANGLE + 90.0) % 180.0 - 90.0) < 6.0
    assert float(found.body.sound_speed) == pytest.approx(TISSUE, abs=15.0)
    assert float(found.body.water_speed) == pytest.approx(WATER, abs=8.0)
    assert set(found.standard_errors) == {*FOUND.standard_errors, "water_speed"}
    assert 0 < found.standard_errors["half_axes"] < 1e-3
    assert 0 < found.standard_errors["angle"] < 6.0


def test_pixels_hold_a_clear_disk(through_ellipse, monkeypatch):
    """Larger than what sounds; a disk off the middle is found in its numbers."""
    monkeypatch.setattr(body_criterion, "PIXELS_OF_ELLIPSES", 13)
    sound, chosen = criterion_of(through_ellipse)
    disk = DiskBody(np.array(CENTER) + 1e-3, 1.2 * AXES[0], TISSUE, WATER)
    search = body_estimate._search_for_ellipses(sound, chosen, DISK._replace(body=disk), None)
    through = search.through
    off = np.linalg.norm(np.asarray(disk.center) - through.center)
    assert body_criterion.SUPPORT * float(disk.radius) + off <= through.reach
    body = through.body(through.numbers(disk))
    for name in ("center", "equal_radius", "sound_speed", "water_speed"):
        np.testing.assert_allclose(getattr(body, name), getattr(disk, name), rtol=1e-9)


def test_the_search_begins_at_what_sounds(through_ellipse, monkeypatch):
    """Seven bells, of which one is in the middle: somewhat smaller than the body, and upright."""
    monkeypatch.setattr(body_criterion, "PIXELS_OF_ELLIPSES", 13)
    asked = criterion_of(through_ellipse, region_radius=None)
    search = body_estimate._search_for_ellipses(*asked, DISK._replace(clear=False), None)
    body = search.through.body(search.first)
    assert float(body.speed_ratio) == pytest.approx(1.0)
    np.testing.assert_allclose(body.center, CENTER, atol=2e-3)
    assert 0.7 * RADIUS < float(body.equal_radius) < 1.1 * RADIUS
    assert -0.2 < search.first[4] < -0.05 and abs(search.first[5]) < 0.05


@pytest.mark.parametrize(
    ("gain", "error", "clear", "shape"),
    [
        (0.08, 0.01, True, "disk"),
        (0.2, 0.08, True, "disk"),
        (np.nan, 0.01, True, "disk"),
        (0.2, 0.01, False, "disk"),
        (0.2, 0.01, True, "ellipse"),
    ],
)
def test_a_disk_stays_where_no_ellipse_explains_more(
    gain, error, clear, shape, through_ellipse, monkeypatch
):
    end, starts = (None, None), []
    stub = SimpleNamespace(
        through=SimpleNamespace(numbers=lambda _: None),
        at=lambda _: None,
        downhill=lambda *_, **__: end,
        lowest_of_starts=lambda *more: starts.append(more) or end,
        newton=lambda *_: SimpleNamespace(numbers=None, fit=None),
        one_speed=lambda _: end,
    )
    monkeypatch.setattr(body_estimate, "_search_for_ellipses", lambda *_: stub)
    monkeypatch.setattr(body_estimate, "_gain", lambda *_: (gain, error, 0.1, 0.1))
    monkeypatch.setattr(body_estimate, "_estimate", lambda *_: FOUND._replace(clear=clear))
    scan = scan_of(through_ellipse)
    found = estimate_ellipse(scan, choose(scan, **ONE), through_ellipse, DISK)
    assert (found.half_axes is None) == (shape == "disk")
    assert starts == [(end,)]  # the best disk is one of them


def test_choices_go_through_the_ellipse(through_ellipse, monkeypatch, tmp_path):
    """By the command, which repeats it; region and table are of the ellipse."""
    asked = []

    def told(scan, choices, frame, disk, water_speed):
        asked.append(disk)
        return FOUND

    monkeypatch.setattr(two_speeds, "estimate_body", lambda *_, **__: DISK)
    monkeypatch.setattr(two_speeds, "estimate_ellipse", told)
    monkeypatch.chdir(tmp_path)
    scan = scan_of(through_ellipse)
    np.savez("scan.npz", pressure=scan.data, **scan.known)
    line = "reconstruct scan.npz --body-shape ellipse --model in-plane --pixels"
    with pytest.raises(ValueError, match="body_shape estimates body_angle, which is given"):
        choose(scan, body_shape="ellipse", body_angle=3.0)
    scan = replace(scan, known=scan.known | {"sound_speed": np.array([1505.0])})
    np.savez("scan.npz", pressure=scan.data, **scan.known)
    assert main(f"{line} 41 --direct --quiet --json a.json --out a.h5".split()) == 0
    assert asked == [DISK]
    told_of = json.loads(Path("a.json").read_text())["choices"]
    assert told_of["body_axes"]["value"] == list(AXES) and told_of["body_angle"]["value"] == ANGLE
    assert told_of["body_angle"]["standard_error"] == 3.0 and "body_radius" not in told_of
    assert told_of["region_radius"]["value"] == pytest.approx(1.1 * AXES[0])
    monkeypatch.setattr(two_speeds, "estimate_body", None)  # it is not asked again
    again = "reconstruct scan.npz --repeat a.h5 --quiet --out b.npy"
    assert main(again.split()) == 0 and main(f"{again} --body-shape disk".split()) == 2


def test_fits_through_an_ellipse_in_32_bits(through_ellipse):
    """Factors of high orders magnified rounding: such images were zero."""
    curve, region = detector_curve(positions()[:, :2]), disk(AXES[0], center=CENTER)
    errors = []
    for medium in (BODY, DISK.body):
        setup = Setup(curve, region, ImageGrid(49, AXES[0], CENTER), medium=medium)
        given = {"model": "in-plane", "nonnegative": True, "dtype": "float32"}
        fit = model_based(setup, through_ellipse, times=TIMES, **given)
        truth = np.asarray(BELLS.image(setup.grid))
        errors.append(np.linalg.norm(np.asarray(fit.image) - truth) / np.linalg.norm(truth))
    assert errors[0] < 0.06 and errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (GIVEN | {"body_radius": 0.02}, "leave out the radius"),
        (GIVEN | {"body_axes": (0.01, 0.0)}, "two numbers above zero"),
        (GIVEN | {"body_axes": (0.2, 0.01)}, "longer of body_axes is"),
        (GIVEN | {"body_angle": np.nan}, "finite number of degrees"),
        (GIVEN | {"body_axes": 0.01}, r"body_axes has shape \(\), expected \(2\)"),
        (GIVEN | {"body_axes": None, "body_angle": 3.0}, "half axes are not"),
        ({"body_axes": AXES}, "speed around it is not"),
        ({"body_shape": "square"}, "expected one of disk, ellipse"),
        ({"body_shape": "ellipse", "two_speeds": False}, "body_shape is of two"),
        ({"body_shape": "ellipse", "body_angle": 3.0}, "body_angle, which is given"),
    ],
)
def test_what_does_not_go_together_is_refused(through_ellipse, given, reason):
    with pytest.raises(ValueError, match=reason):
        choose(scan_of(through_ellipse), **given)


def test_ellipses_are_of_the_plane(through_ellipse):
    points = np.random.default_rng(0).standard_normal((40, 3))
    points *= 0.04 / np.linalg.norm(points, axis=1, keepdims=True)
    in_space = scan_of(through_ellipse[:40], detectors=points)
    with pytest.raises(ValueError, match="tell a ball"):
        choose(in_space, body_shape="ellipse")
    with pytest.raises(ValueError, match="tell a ball"):
        estimate_ellipse(in_space, choose(in_space, sound_speed=1500.0), in_space.data, DISK)
