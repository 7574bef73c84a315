"""Records that the positions of their detectors contradict."""

import warnings

import numpy as np
import pytest
from made_scans import RADIUS, RATE, SPEED, TIMES, N, positions, raw_counts, record, scan

from jaxtat.cli import main
from jaxtat.io import Scan, load_scan
from jaxtat.scans import choose, estimate_sound_speed
from jaxtat.steps import AccuracyWarning

LATE, EARLIER = "sound arrives later than", "sound arrives earlier than"
MIXED = "detectors beside each other hear sound that is no more alike"


def made(pressure=None, **known):
    facts = {"detectors": positions(), "sampling_rate": RATE}
    return Scan("pressure", record() if pressure is None else pressure, facts | known)


def mixed(pressure):
    return pressure[np.random.default_rng(3).permutation(N)]


def by_cosines_of_degrees():
    """Two degrees apart, taken for radians."""
    theta = 2.0 * np.arange(N)
    return RADIUS * np.stack([np.cos(theta), np.sin(theta)], axis=1)


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        (lambda: made(detectors=100 * positions()), LATE),  # centimetres
        (lambda: made(sampling_rate=RATE / 2), LATE),
        (lambda: made(np.pad(record(), ((0, 0), (0, 230))), sampling_rate=2 * RATE), EARLIER),
        (lambda: made(record()[:, 40:]), EARLIER),  # a delay that the file does not tell
        (lambda: made(np.pad(record(), ((0, 0), (60, 0)))), LATE),
        (lambda: made(mixed(record())), MIXED),
        (lambda: made(detectors=by_cosines_of_degrees()), MIXED),
        (lambda: made(raw_counts(mixed(record()), noise=0.1)), MIXED),
    ],
)
def test_a_contradiction_is_said_and_no_speed_is_told_by_it(damaged, said):
    found = damaged()
    with pytest.warns(AccuracyWarning, match=said):
        chosen = choose(found, model="in-plane")
    estimated = estimate_sound_speed(found, chosen)
    assert estimated.sound_speed == chosen.sound_speed
    assert estimated.grade("sound_speed") == "guessed"


@pytest.mark.parametrize("speed", [1420.0, SPEED, 1620.0])
@pytest.mark.parametrize("span", [90.0, 180.0, 270.0, 356.0])
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
    measured = load_scan(data_file)
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        choose(measured)
    rows = np.random.default_rng(0).permutation(measured.n_detectors)
    with pytest.warns(AccuracyWarning, match=MIXED):
        choose(Scan("pressure", measured.frame(0)[rows], measured.known))
    known = dict(measured.known) | {"detectors": 100 * measured.known["detectors"]}
    with pytest.warns(AccuracyWarning, match=LATE):
        choose(Scan("pressure", measured.frame(0), known))


@pytest.mark.parametrize("span", [90.0, 240.0])
def test_noise_alone_contradicts_nothing(span):
    noise = np.random.default_rng(0).standard_normal((N, len(TIMES)))
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        choose(made(noise, detectors=positions(span=span), sound_speed=SPEED))


def test_the_command_says_it_in_a_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("scan.npz", pressure=mixed(record()), detectors=positions(), fs=RATE)
    assert main(["info", "scan.npz"]) == 0
    (note,) = capsys.readouterr().err.splitlines()
    assert note.startswith(f"jaxtat: note: {MIXED}") and "radians" in note


def test_where_an_array_lies_does_not_matter():
    """A kilometre from the origin."""
    wanted, moved = choose(scan(record())), choose(scan(record(), detectors=positions() + 1e3))
    assert moved.pixels == wanted.pixels and moved.channels == wanted.channels
    np.testing.assert_allclose(moved.region_center, 1e3, rtol=1e-12)
    for name in ("region_radius", "max_frequency", "alpha", "first_radius"):
        assert getattr(moved, name) == pytest.approx(getattr(wanted, name), rel=1e-6)
