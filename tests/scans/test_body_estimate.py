"""A body of another speed of sound, estimated from the record, and choices that go through it."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from made_scans import BELLS, RATE, SPEED, TIMES, clear_body, positions, record

from jaxtat import DiskBody, ImageGrid, OutlineBody, Setup, detector_curve, disk, phantoms
from jaxtat.cli import hints, main
from jaxtat.io import Scan
from jaxtat.records import simulate_pressure, water_speed
from jaxtat.scans import (
    body_criterion,
    choose,
    estimate_body,
    pipeline,
    shares_by_speed,
    trials,
    two_speeds,
)
from jaxtat.scans.acoustics import sound_of
from jaxtat.scans.body_criterion import BodyFit, Through, through_bodies
from jaxtat.scans.body_search import BodySearch, NearLeast
from jaxtat.scans.start_time import Start

pytestmark = pytest.mark.slow

WATER, TISSUE, RADIUS, CENTER = 1480.0, 1580.0, 0.011, (1e-3, -5e-4)
BODY = DiskBody(CENTER, RADIUS, TISSUE, WATER)
ONE = {"model": "in-plane", "sound_speed": 1505.0, "region_radius": 0.0115, "pixels": 41}
FOUND = clear_body(BODY)


def scan_of(pressure, **known):
    return Scan("pressure", pressure, {"detectors": positions(), "sampling_rate": RATE} | known)


@pytest.fixture(scope="module")
def through_body():
    """The record of the bells through the body, in finer pixels than the estimate has."""
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"], [1.0, 0.7, 0.5])
    curve, grid = detector_curve(positions()[:, :2]), ImageGrid(65, RADIUS, CENTER)
    setup = Setup(curve, disk(RADIUS, center=CENTER), grid, medium=BODY)
    made = simulate_pressure(setup, bells.image(grid), TIMES, model="in-plane")
    return np.asarray(made)


def estimated(pressure, monkeypatch, speed, water=WATER):
    monkeypatch.setattr(body_criterion, "PIXELS", 27)
    scan = scan_of(pressure)
    chosen = choose(scan, **ONE | {"sound_speed": speed})
    return estimate_body(scan, chosen, pressure, water_speed=water)


def test_the_body_is_told_by_its_record(through_body, monkeypatch):
    found = estimated(through_body, monkeypatch, 1505.0)
    assert found.clear and found.grade == "likely" and found.share < 0.6 * found.share_of_one
    assert float(found.body.sound_speed) == pytest.approx(TISSUE, abs=15.0)
    assert float(found.body.radius) == pytest.approx(RADIUS, rel=0.1)
    assert np.linalg.norm(np.asarray(found.body.center) - CENTER) < 1e-3
    assert 0 < found.standard_errors["sound_speed"] < 15.0
    assert WATER < found.one_speed < TISSUE and "water_speed" not in found.standard_errors


def test_body_and_water_are_told_together(through_body, monkeypatch):
    found = estimated(through_body, monkeypatch, 1505.0, water=None)
    assert found.clear and set(found.standard_errors) == {*FOUND.standard_errors, "water_speed"}
    assert float(found.body.water_speed) == pytest.approx(WATER, abs=15.0)
    assert float(found.body.sound_speed) == pytest.approx(TISSUE, abs=30.0)
    assert np.linalg.norm(np.asarray(found.body.center) - CENTER) < 1e-3


class Hill:
    """A criterion of a body that rises in all directions from a point, its slopes a bit wrong."""

    reach = 1.0

    def __init__(self, point, wrong):
        self.point, self.wrong = point, wrong

    def least(self, numbers, weight, steps, image=None):
        away = numbers - self.point
        value = float(np.sum(away**2) + np.sum(np.abs(away)))
        return BodyFit(value, np.full(4, value), 0.5, 2 * away + self.wrong, np.zeros(1))


@pytest.mark.parametrize(
    ("begin", "wrong"), [(0.0, 1.0), (3.0, 0.0)], ids=["wrong slopes", "right ones"]
)
def test_newtons_step_is_taken_where_the_criterion_falls(begin, wrong):
    ones, good = np.ones(5), np.ones(4, bool)
    search = BodySearch(Hill(ones, wrong), ones, ones, 1.0, 1.0, good, 5, ())
    start = np.ones(5) + begin
    near = search.newton(start, search.at(start))
    np.testing.assert_allclose(near.numbers, np.ones(5), atol=1e-12)
    assert near.fit.value == pytest.approx(0.0, abs=1e-12)


def test_ways_begin_at_the_two_best_of_all_starts():
    """Contrasts, and others that are named."""
    ones, good = np.array([1.0, 1.0, 0.0, 0.0, 1.0]), np.ones(4, bool)
    hill = Hill(np.array([1.2, 1.0, 0.0, 0.0, 1.0]), 0.0)
    hill.distance = 1.0
    search = BodySearch(hill, ones, ones, 1.0, 1.0, good, 5, ())
    near = hill.point + 1e-3
    starts = search.starts((near, search.at(near)))
    assert len(starts) == 2 and starts[0][0] is near
    assert all(np.any(one != near) for one, _ in search.starts())


def test_a_record_of_one_speed_has_no_clear_body(monkeypatch):
    """Also where the water's speed is said to be another one."""
    found = estimated(record(), monkeypatch, SPEED)
    assert not found.clear and found.grade == "guessed"
    assert found.share > 0.95 * found.share_of_one
    assert found.one_speed == pytest.approx(SPEED, rel=2e-3)


def test_nobody_asked_for_a_body_that_one_speed_does_without(through_body, monkeypatch):
    """Low frequencies tell at once that a record of one speed has none, and that another may."""
    monkeypatch.setattr(body_criterion, "PIXELS", 27)
    lowest = []
    search = BodySearch.lowest_of_starts

    def watched(self):
        lowest.append(self)
        return search(self)

    monkeypatch.setattr(BodySearch, "lowest_of_starts", watched)
    one, given = scan_of(record()), ONE | {"sound_speed": SPEED}
    found = estimate_body(one, choose(one, **given), record(), asked=False)
    assert not lowest and not found.clear and found.share == found.share_of_one
    assert found.standard_errors == {} and "of low frequencies" in str(found)
    two = scan_of(through_body)
    assert estimate_body(two, choose(two, **ONE), through_body, asked=False).clear and lowest


@pytest.mark.parametrize(
    "told", [estimate_body, partial(shares_by_speed, speeds=np.array([SPEED]))]
)
def test_frames_that_cannot_be_are_refused(told):
    """NaN in a row that is used, and rows that are missing."""
    pressure = record()
    scan = scan_of(pressure)
    chosen = choose(scan, **ONE | {"sound_speed": SPEED})
    damaged = pressure.copy()
    damaged[0, 9] = np.nan
    with pytest.raises(ValueError, match="frame holds 1 NaN"):
        told(scan, chosen, damaged)
    with pytest.raises(ValueError, match=r"frame has shape .*, expected"):
        told(scan, chosen, pressure[:5])


def test_sound_from_the_middle_takes_the_time_of_the_numbers():
    """T of the body's own speed, which is kept within bounds."""
    through = Through(None, None, 0.04, np.zeros(2), 0.011, 0)
    arrival = 0.04 / WATER - RADIUS * (1 / WATER - 1 / TISSUE)
    body = through.body(np.array([arrival, RADIUS, *CENTER, WATER]))
    assert float(body.sound_speed) == pytest.approx(TISSUE)
    far = through.body(np.array([0.9 * arrival, RADIUS, *CENTER, WATER]))
    assert float(far.speed_ratio) == pytest.approx(body_criterion.RATIOS[1])


@pytest.fixture
def criterion(through_body, monkeypatch):
    """That of the record through the body, and numbers that are a little off the body's."""
    monkeypatch.setattr(body_criterion, "PIXELS", 33)
    scan = scan_of(through_body)
    chosen = choose(scan, **ONE)
    sound = sound_of(scan, chosen, through_body)
    through = through_bodies(sound, chosen, np.zeros(2), 0.0115)
    radius, water = 1.05 * RADIUS, 1.003 * WATER
    arrival = through.distance / WATER - RADIUS * (1 / WATER - 1 / TISSUE)
    return through, np.array([arrival, radius, 0.0, 0.0, water])


@pytest.mark.parametrize("held", [True, False], ids=["one image", "the best image"])
def test_slopes_are_the_derivatives_of_what_is_left(criterion, held):
    """Of half of it, by one image, and of V, whose image changes too."""
    through, numbers = criterion
    here = through.least(numbers, 0.1, 400)
    for k, step in enumerate((1e-9, 1.5e-5, 3e-5, 3e-5, 0.5)):
        ahead, behind = (
            through.least(numbers + by * np.eye(5)[k], 0.1, 0 if held else 400, here.image)
            for by in (step, -step)
        )
        if held:
            slope = (ahead.left - behind.left).sum() / (4 * step)
        else:
            slope = (ahead.value - behind.value) / (2 * step)
        assert slope == pytest.approx(here.slopes[k], rel=0.02 if held else 0.05)


@pytest.mark.parametrize(
    "made", [DiskBody, lambda *four: OutlineBody.stretched_disk(*four[:2], (0.0, 0.0), *four[2:])]
)
def test_what_may_sound_fades_at_the_rim(made):
    """From 1 to 0 between the rim and 1.2 radii; a pixel in the middle has derivatives."""
    ways = jnp.array([0.0, 0.5, 0.99, 1.05, 1.1, 1.15, 1.21])[:, None] * jnp.array([0.8, -0.6])

    def shares(center, radius):
        return body_criterion._shares(made(center, radius, TISSUE, WATER), jnp.array(CENTER) + ways)

    center, radius = jnp.array(CENTER), jnp.array(1.0)
    np.testing.assert_allclose(shares(center, radius), [1, 1, 1, 0.75, 0.5, 0.25, 0], atol=1e-6)
    check_grads(shares, (center, radius), 1, atol=1e-6, rtol=1e-6)


def near_of(gradient, hessian, of_left=None):
    return NearLeast(np.zeros(5), None, np.asarray(gradient, float), np.asarray(hessian), of_left)


def test_the_least_of_a_paraboloid_takes_one_step():
    rng = np.random.default_rng(0)
    wanted, root = np.array([0.5, -1.0, 0.3]), rng.standard_normal((3, 3))
    hessian = root @ root.T + np.eye(3)
    np.testing.assert_allclose(near_of(-hessian @ wanted, hessian).step(), wanted, rtol=1e-12)
    flat = near_of([1.0, 1.0, 1.0], np.diag([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(flat.step(), [-1.0, 0.0, 0.0], atol=1e-12)


def test_the_least_without_some_detectors_is_that_of_the_others():
    """Each detector's part of V a paraboloid about a point of its own, all of one shape."""
    rng = np.random.default_rng(1)
    points, root = 0.1 * rng.standard_normal((6, 3)), rng.standard_normal((3, 3))
    hessian = root @ root.T + np.eye(3)
    middle = points.mean(axis=0)
    near = near_of(np.zeros(3), hessian, hessian @ (middle - points).T / 6)
    moved = near.without(np.array([0, 3]), 6)
    np.testing.assert_allclose(middle + moved, points[[1, 2, 4, 5]].mean(axis=0), rtol=1e-10)


def test_high_frequencies_fade_of_data_and_model_alike(criterion):
    through, _ = criterion
    low, energy = through.low_passed(0.25)
    n, most = through.n_frequencies, through.misfit.fourier.shape[1]
    assert 10 < n <= most and not through.misfit.whitening[:, n:most].any()
    kept = np.exp(-((np.arange(most) / n / 0.25) ** 2))
    for name in ("data", "whitening"):
        before, after = (np.asarray(getattr(x.misfit, name)) for x in (through, low))
        np.testing.assert_allclose(after, before * np.tile(kept, 2), rtol=1e-6, atol=1e-9)
    left = np.sum(np.asarray(low.misfit.data, float) ** 2)
    assert energy == pytest.approx(left / np.sum(np.asarray(through.misfit.data, float) ** 2))


@pytest.fixture
def told(monkeypatch):
    """Function that has the record tell a body, and the list of the water speeds it was asked."""
    asked = []

    def tell(found):
        def answer(scan, choices, frame, water_speed=None, **_):
            asked.append(water_speed)
            return found

        monkeypatch.setattr("jaxtat.scans.two_speeds.estimate_body", answer)
        return asked

    return tell


def test_choices_go_through_a_clear_body(through_body, told):
    asked = told(FOUND)
    given = {"model": "in-plane", "two_speeds": True, "water_temperature": 20.0}
    scan = scan_of(through_body, sound_speed=1505.0)
    chosen = choose(scan, **given)
    assert asked == [pytest.approx(float(water_speed(20.0)))]
    assert (chosen.sound_speed, chosen.body_radius) == (TISSUE, RADIUS)
    assert chosen.region_center == chosen.body_center == CENTER
    assert chosen.grade("sound_speed") == "likely" and chosen.grade("water_speed") == "sure"
    assert "5.0% left unexplained, 10.0% by one speed" in chosen.table()
    assert dict(chosen.standard_errors)["body_radius"] == 1e-4 and chosen.medium is not None


def test_one_speed_stays_where_two_are_not_clear(through_body, told):
    scan = scan_of(through_body, sound_speed=1505.0)
    one = choose(scan, model="in-plane")
    for found, why in ((FOUND._replace(clear=False), "not clearly less"), (None, "too short")):
        told(found)
        chosen = choose(scan, model="in-plane", two_speeds=True, water_speed=1500.0)
        assert chosen.medium is None and chosen.sound_speed == one.sound_speed
        assert why in dict(chosen.reasons)["sound_speed"]


def test_the_command_estimates_two_speeds_and_repeats_them(
    through_body, told, tmp_path, monkeypatch
):
    told(FOUND)
    monkeypatch.chdir(tmp_path)
    scan = scan_of(through_body, sound_speed=1505.0)
    np.savez("scan.npz", pressure=scan.data, **scan.known)
    line = "reconstruct scan.npz --two-speeds --water-temperature 20 --model in-plane --direct"
    assert main(f"{line} --pixels 41 --quiet --json a.json --out a.h5".split()) == 0
    assert json.loads(Path("a.json").read_text())["choices"]["body_radius"]["value"] == RADIUS
    told(None)  # it is not asked again
    again = "reconstruct scan.npz --repeat a.h5 --quiet --out b.npy"
    assert main(again.split()) == 0 and main(f"{again} --two-speeds".split()) == 2


def test_a_speed_is_tried_through_the_body_that_was_found(through_body, told, monkeypatch):
    told(FOUND)
    monkeypatch.setattr("jaxtat.scans.parameter_sweep.reconstruct", lambda scan, choices: choices)
    given = {"model": "in-plane", "two_speeds": True, "pixels": 41}
    scan = scan_of(through_body, sound_speed=1505.0)
    chosen = choose(scan, **given)
    (one,) = trials(scan, chosen, given, "sound_speed", [1560.0])
    assert (one.sound_speed, one.body_radius) == (1560.0, RADIUS)


def start_of(shift, error):
    """What images tell of a record's start."""
    return lambda *_: Start(shift, error, SPEED, 0.1)


@pytest.fixture
def start_told(monkeypatch):
    """Function that sets what images tell of a record's start."""

    def tell(start):
        for room in (pipeline, two_speeds):
            monkeypatch.setattr(room, "start_and_speed", start)

    return tell


@pytest.mark.parametrize(
    ("start", "known", "asks"),
    [
        (start_of(0.0, 1e-8), {}, False),
        (start_of(1.5e-6, 1e-6), {}, False),
        (lambda *_: None, {}, True),
        (start_of(0.0, 1e-8), {"times": TIMES}, False),
        (start_of(1e-6, 1e-8), {"times": TIMES}, True),
        (lambda *_: None, {"times": TIMES}, True),
    ],
    ids=[
        "told",
        "near",
        "not told",
        "as the file says",
        "not as the file says",
        "file's, not told",
    ],
)
def test_a_body_is_looked_for_where_the_start_is_not_told(start, known, asks, told, start_told):
    start_told(start)
    asked = told(None)
    chosen = choose(scan_of(record(), **known), pixels=41)
    assert asked == ([None] if asks else []) and chosen.water_speed is None
    assert ("too short" in dict(chosen.reasons)["sound_speed"]) == asks


def test_with_another_start_a_body_is_looked_for_by_both(told, start_told, monkeypatch):
    monkeypatch.setattr(two_speeds, "_most_is_explained", lambda *_: True)
    start_told(start_of(1e-7, 1e-9))
    asked = told(None)
    assert choose(scan_of(record()), pixels=41).time_shift == 1e-7 and asked == [None, None]


def test_no_body_is_looked_for_where_most_is_unexplained(told, start_told, monkeypatch):
    monkeypatch.setattr(two_speeds, "UNEXPLAINED", 0.0)
    start_told(lambda *_: None)
    asked = told(FOUND)
    assert choose(scan_of(record()), pixels=41).medium is None and not asked


@pytest.mark.parametrize("clear", [True, False])
def test_a_body_that_nobody_asked_for_is_taken_where_it_is_clear(clear, told, start_told, caplog):
    start_told(lambda *_: None)
    told(FOUND._replace(clear=clear))
    scan = scan_of(record())
    one = choose(scan, pixels=41, two_speeds=False)
    with caplog.at_level("INFO", logger="jaxtat.scans"):
        chosen = choose(scan, pixels=41)
    assert "a body of another speed is looked for" in caplog.text
    assert (chosen.medium is not None) == clear
    assert chosen.sound_speed == (TISSUE if clear else one.sound_speed)


def test_one_speed_stays_where_the_region_that_is_given_is_no_bodys(told, start_told):
    start_told(lambda *_: None)
    told(FOUND)
    chosen = choose(scan_of(record()), pixels=41, region_radius=1.4 * RADIUS)
    assert chosen.medium is None and chosen.region_radius == 1.4 * RADIUS
    assert "a body smaller than the region" in dict(chosen.reasons)["sound_speed"]
    assert choose(scan_of(record()), pixels=41, region_radius=1.1 * RADIUS).medium is not None


@pytest.mark.parametrize(
    "given",
    [{"sound_speed": SPEED}, {"two_speeds": False}, {"radii": np.linspace(2e-2, 6e-2, 99)}],
    ids=["a speed", "one speed", "radii"],
)
def test_no_body_is_looked_for_where_a_speed_is_given(given, told, start_told):
    start_told(lambda *_: None)
    asked = told(FOUND)
    assert choose(scan_of(record()), pixels=41, **given).medium is None and not asked


def test_the_command_tells_of_the_search_and_plans_do_without(
    told, start_told, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    start_told(lambda *_: None)
    asked = told(FOUND._replace(clear=False))
    np.savez("scan.npz", pressure=record(), **scan_of(record()).known)
    assert main(["info", "scan.npz", "--pixels", "41"]) == 0 and asked == [None]
    assert "a body of another speed is looked for" in capsys.readouterr().err
    line = "reconstruct scan.npz --pixels 41 --direct --quiet --out a.npy"
    assert main(line.split()) == 0 and len(asked) == 2
    assert "a body of another speed" not in capsys.readouterr().err
    assert main(f"{line} --K 4".split()) == 0 and len(asked) == 2


def test_regions_that_are_suggested_are_those_of_a_body(through_body, told):
    told(FOUND)
    scan = scan_of(through_body)
    chosen = choose(scan, model="in-plane", two_speeds=True)
    tried = hints._values(scan, chosen, "region_radius")
    assert max(tried) <= 1.25 * RADIUS < 1.4 * chosen.region_radius and len(tried) > 1


@pytest.mark.parametrize("start", [0.0, 4e-7])
def test_the_files_start_is_tried_where_one_speed_tells_another(start, monkeypatch):
    """The body is clear with one of two starts, and that is taken."""

    def of_start(scan, choices, frame, water_speed, asked):
        clear = choices.time_shift == start
        return FOUND._replace(clear=clear, share=0.05 if clear else 0.2)

    monkeypatch.setattr(two_speeds, "estimate_body", of_start)
    scan = scan_of(record())
    late = replace(choose(scan, **ONE), time_shift=4e-7)
    chosen, found = two_speeds._with_body(scan, ONE, late)
    assert found.clear and chosen.time_shift == start
    assert "time_shift" not in chosen.user_set


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"two_speeds": True, "sound_speed": 1550.0}, "two_speeds estimates sound_speed"),
        ({"two_speeds": True, "body_radius": 0.01}, "two_speeds estimates body_radius"),
        ({"water_speed": 1490.0, "water_temperature": 20.0}, "expected one of them"),
        ({"water_temperature": 293.0}, "0 to 95"),
    ],
)
def test_what_contradicts_two_speeds_is_refused(given, reason):
    with pytest.raises(ValueError, match=reason):
        choose(scan_of(record()), **given)


def test_two_speeds_are_of_pressure():
    integrals = Scan("circular_integrals", np.ones((90, 40)), {"detectors": positions()[:, :2]})
    with pytest.raises(ValueError, match="units of positions and times are not known"):
        choose(integrals, water_temperature=20.0)
    with pytest.raises(ValueError, match="two_speeds is of pressure records: leave it out"):
        choose(integrals, two_speeds=True)
