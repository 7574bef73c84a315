"""Speed of sound, model and contradictions of a scan, as `choose` tells them."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from made_scans import (
    BELLS,
    RADIUS,
    RATE,
    SPEED,
    TIMES,
    N,
    in_plane,
    positions,
    raw_counts,
    record,
    scan,
)

from jaxtat import detector_curve, phantoms
from jaxtat.cli import main
from jaxtat.io import Scan, load_scan
from jaxtat.io.datasets import sample_scan
from jaxtat.records import circular_integrals_to_pressure
from jaxtat.scans import choose, pipeline
from jaxtat.scans.acoustics import shares_by_speed, tell_acoustics
from jaxtat.steps import AccuracyWarning

pytestmark = pytest.mark.slow

NO_IMAGE = "no image explains this record"
LATE, EARLIER = "sound arrives later than", "sound arrives earlier than"
ARC, HALF = slice(None), slice(15, 75)  # 270 and 179 degrees
GIVEN = {"model": "in-plane", "region_radius": 0.011, "pixels": 33, "max_frequency": 3000.0}


def made(pressure=None, **known):
    facts = {"detectors": positions(), "sampling_rate": RATE}
    return Scan("pressure", record() if pressure is None else pressure, facts | known)


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """The scan that the package writes to try things on, of 1510 m/s."""
    path = tmp_path_factory.mktemp("sample") / "scan.npz"
    sample_scan(path)
    return load_scan(path)


def noisy(share, seed=0):
    noise = np.random.default_rng(seed).standard_normal(record().shape)
    return record() + share * np.sqrt(np.mean(record() ** 2)) * noise


@pytest.mark.parametrize("speed", [1440.0, 1610.0])
def test_the_speed_is_found_and_likely_from_most_sides(speed):
    rate = RATE * speed / SPEED
    chosen = choose(made(noisy(0.1), sampling_rate=rate, times=TIMES * RATE / rate), **GIVEN)
    assert chosen.sound_speed == pytest.approx(speed, rel=2e-3)
    assert chosen.grade("sound_speed") == "likely"
    assert dict(chosen.standard_errors)["sound_speed"] < 0.005 * speed


def test_a_quarter_of_a_circle_does_not_tell_the_speed():
    rows = slice(30, 60)
    chosen = choose(made(record()[rows], detectors=positions()[rows]), **GIVEN)
    assert (chosen.sound_speed, chosen.grade("sound_speed")) == (1500.0, "guessed")
    assert dict(chosen.reasons)["sound_speed"].startswith("water's: from 8")


def test_noise_alone_tells_no_speed_and_no_image_explains_it():
    noise = np.random.default_rng(0).standard_normal((N, len(TIMES)))
    with pytest.warns(AccuracyWarning, match=NO_IMAGE):
        chosen = choose(made(noise), **GIVEN)
    assert (chosen.sound_speed, chosen.grade("sound_speed")) == (1500.0, "guessed")


def test_the_share_by_speed_is_least_at_the_true_one():
    one = made()
    speeds = np.linspace(1430.0, 1570.0, 9)
    shares = shares_by_speed(one, choose(scan(record()), **GIVEN), one.frame(0), speeds)
    assert shares is not None and speeds[np.argmin(shares)] == SPEED
    assert ((shares > 0) & (shares < 1)).all()


def of_speed(sample, speed):
    return replace(sample, known=dict(sample.known) | {"sound_speed": np.asarray(speed)})


def test_a_speed_in_the_file_is_compared_with_that_of_the_best_image(sample):
    right = choose(of_speed(sample, 1510.0))
    assert (right.sound_speed, right.grade("sound_speed")) == (1510.0, "sure")
    wrong = of_speed(sample, 1470.0)
    found = choose(wrong)
    assert (found.sound_speed, found.grade("sound_speed")) == (1470.0, "guessed")
    said = re.match(r"from the file; but at (.*) m/s \d+%", dict(found.reasons)["sound_speed"])
    assert said and float(said[1]) == pytest.approx(1510.0, rel=0.003)
    assert choose(wrong, sound_speed=1470.0).grade("sound_speed") == "sure"


def test_a_map_of_speeds_is_said_to_be_one_and_never_sure(sample):
    chosen = choose(of_speed(sample, np.full((3, 4), 1510.0)))
    assert (chosen.sound_speed, chosen.grade("sound_speed")) == (1510.0, "sure")
    chosen = choose(of_speed(sample, np.repeat([[1490.0, 1530.0]], 6, axis=0)))
    assert (chosen.sound_speed, chosen.grade("sound_speed")) == (1510.0, "guessed")
    why = dict(chosen.reasons)["sound_speed"]
    assert "the mean of 6 x 2 speeds in the file, 1490 m/s to 1530 m/s" in why


def waves():
    """Two-dimensional waves of the bells, from exact integrals."""
    radii = np.arange(1e-3, 62e-3, 4e-4)
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"], [1.0, 0.7, 0.5])
    g = bells.circular_integrals(detector_curve(positions()[:, :2]), radii)
    return np.asarray(circular_integrals_to_pressure(g, radii, SPEED * TIMES))


def saved(pressure, rows, drift=0.0):
    """A file of numbers in the plane, with 2 % of noise, that does not tell its model."""
    largest, rng = np.abs(pressure).max(), np.random.default_rng(0)
    dirt = 0.02 * rng.standard_normal(pressure.shape) + drift * TIMES / TIMES[-1]
    known = {"detectors": positions()[rows, :2], "sampling_rate": RATE}
    return Scan("pressure", (pressure + largest * dirt)[rows], known)


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_a_body_round_about_the_middle_raises_no_alarm(noise):
    """All detectors have the same record, in whatever order the rows are."""
    bell = phantoms.Bells([[0.0, 0.0]], [8e-3])
    pressure = in_plane(bell, detector_curve(positions()[:, :2]))
    dirt = noise * np.abs(pressure).max() * np.random.default_rng(0).standard_normal(pressure.shape)
    choose(scan(pressure + dirt))


@pytest.mark.parametrize("model", ["2d", "in-plane"])
def test_the_best_image_tells_the_model(model, monkeypatch):
    """A record of elements focused into the plane drifts, which looks like a tail of waves.

    Images are made once, whatever model the record alone spoke for.
    """
    calls = []
    monkeypatch.setattr(
        pipeline, "tell_acoustics", lambda *of: calls.append(of) or tell_acoustics(*of)
    )
    one = saved(waves() if model == "2d" else record(), ARC, 0.05 * (model == "in-plane"))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* needs model in-plane")
        found = choose(one, two_speeds=False)
        asked = choose(one, model=model, sound_speed=found.sound_speed)
    assert len(calls) == 2
    assert (found.model, found.grade("model")) == (model, "likely")
    for name in ("band", "low_pass", "pixels", "dead_time"):
        assert getattr(found, name) == getattr(asked, name), name
    assert asked.grade("model") == "sure" and "model" not in found.user_set


@pytest.mark.filterwarnings("ignore::jaxtat.geometry.VisibilityWarning")
def test_from_half_a_circle_the_model_is_a_guess_and_a_note():
    with pytest.warns(AccuracyWarning, match="images do not tell. If .* needs model in-plane"):
        found = choose(saved(waves(), HALF), two_speeds=False)
    assert (found.model, found.grade("model")) == ("2d", "guessed")


def mixed(pressure):
    return pressure[np.random.default_rng(3).permutation(N)]


def by_cosines_of_degrees():
    """Two degrees apart, taken for radians."""
    theta = 2.0 * np.arange(N)
    return RADIUS * np.stack([np.cos(theta), np.sin(theta)], axis=1)


@pytest.mark.parametrize(
    "damaged",
    [
        lambda: made(detectors=by_cosines_of_degrees()),
        lambda: made(raw_counts(mixed(record()), noise=0.1)),
    ],
)
def test_a_contradiction_is_said_and_no_speed_is_told_by_it(damaged):
    with pytest.warns(AccuracyWarning, match=NO_IMAGE):
        chosen = choose(damaged(), **GIVEN)
    assert (chosen.sound_speed, chosen.grade("sound_speed")) == (1500.0, "guessed")
    assert NO_IMAGE in dict(chosen.reasons)["sound_speed"]


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        (lambda: made(detectors=100 * positions()), LATE),  # centimetres
        (lambda: made(sampling_rate=RATE / 2), LATE),
        (lambda: made(np.pad(record(), ((0, 0), (0, 230))), sampling_rate=2 * RATE), EARLIER),
        (lambda: made(record()[:, 40:]), EARLIER),  # a delay that the file does not tell
        (lambda: made(np.pad(record(), ((0, 0), (60, 0)))), LATE),
    ],
)
def test_sound_at_times_that_positions_contradict_is_said(damaged, said):
    found = damaged()
    with pytest.warns(AccuracyWarning, match=said):
        chosen = choose(found, model="in-plane")
    assert chosen.grade("sound_speed") == "guessed"


def test_a_wrong_sampling_rate_is_named():
    whole = np.pad(record(), ((0, 0), (0, 230)))
    with pytest.warns(AccuracyWarning, match="with half the sampling rate it is"):
        choose(made(whole, sampling_rate=2 * RATE), **GIVEN)


@pytest.mark.parametrize(("span", "speed"), [(90.0, 1420.0), (180.0, 1620.0), (356.0, 1620.0)])
def test_records_of_all_speeds_from_all_sides_raise_no_alarm(span, speed):
    """A body off the middle, detectors in any order, and other noise in each."""
    rng = np.random.default_rng(int(span + speed))
    points = positions(span=span)
    away = np.linalg.norm(points[:, :2] - [6e-3, -8e-3], axis=1)[:, None] - speed * TIMES
    pressure = -away * np.exp(-((away / 2e-3) ** 2))
    pressure += 0.1 * np.abs(pressure).max() * rng.standard_normal(pressure.shape)
    order = rng.permutation(N)
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        choose(made(pressure[order], detectors=points[order]), model="in-plane")


@pytest.mark.parametrize("data_file", ["msot_scan9.npz"], indirect=True)
def test_a_measured_scan_raises_no_alarm_but_damaged(data_file):
    """With the speed that tests/test_others_data.py finds."""
    measured = load_scan(data_file)
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        choose(measured, sound_speed=1477.0)
    rows = np.random.default_rng(0).permutation(measured.n_detectors)
    with pytest.warns(AccuracyWarning, match=NO_IMAGE):
        choose(Scan("pressure", measured.frame(0)[rows], measured.known), sound_speed=1477.0)
    known = dict(measured.known) | {"detectors": 100 * measured.known["detectors"]}
    with pytest.warns(AccuracyWarning, match=LATE):
        choose(Scan("pressure", measured.frame(0), known))


def test_the_command_says_it_in_a_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("scan.npz", pressure=mixed(record()), detectors=positions(), fs=RATE)
    assert main(["info", "scan.npz", "--region-radius", "0.011", "--sound-speed", "1500"]) == 3
    (note,) = capsys.readouterr().err.splitlines()
    assert note.startswith(f"jaxtat: note: {NO_IMAGE}") and "order of the rows" in note


def test_where_an_array_lies_does_not_matter():
    """A kilometre from the origin."""
    wanted, moved = choose(scan(record())), choose(scan(record(), detectors=positions() + 1e3))
    assert moved.pixels == wanted.pixels and moved.channels == wanted.channels
    np.testing.assert_allclose(moved.region_center, 1e3, rtol=1e-12)
    for name in ("region_radius", "max_frequency", "alpha", "first_radius"):
        assert getattr(moved, name) == pytest.approx(getattr(wanted, name), rel=1e-6)
