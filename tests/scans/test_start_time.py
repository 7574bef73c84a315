"""Records whose first sample is not at the time at which the laser fires."""

import numpy as np
import pytest
from made_scans import (
    BELLS,
    RADIUS,
    RATE,
    SPEED,
    TIMES,
    in_plane,
    positions,
    raw_counts,
    record,
)

from jaxtat import elliptic_arc, phantoms, reconstruct_file
from jaxtat.io import Scan, load_scan, save_ipasc
from jaxtat.scans import choose, integrals, reconstruct, setup_of, with_facts
from jaxtat.scans.laser_artefact import start_by_laser
from jaxtat.scans.start_time import Start
from jaxtat.steps import AccuracyWarning

pytestmark = pytest.mark.slow

GIVEN = {"region_radius": 0.011, "pixels": 33, "max_frequency": 3000.0, "alpha": 1e-3}
EARLY = 40  # samples before the laser fires
SHIFTED = TIMES[0] - EARLY / RATE


def made(pressure, **known):
    return Scan("pressure", pressure, {"detectors": positions(), "sampling_rate": RATE} | known)


def with_early_samples(pressure, noise=0.0):
    rng = np.random.default_rng(1)
    before = noise * np.abs(pressure).max() * rng.standard_normal((len(pressure), EARLY))
    return np.concatenate([before, pressure], axis=1)


def data(scan, **options):
    chosen = choose(scan, sound_speed=SPEED, band="none", dead_time=0.0, **GIVEN, **options)
    return np.asarray(integrals(scan, chosen, setup_of(scan, chosen), scan.frame(0)))


def test_samples_before_the_laser_fires_change_nothing():
    """By the option, by times in the file, and after a journey through a file."""
    wanted = data(made(record()))
    early = with_early_samples(record(), noise=1.0)
    by_option = with_facts(made(early), start_time=SHIFTED)
    times = SHIFTED + np.arange(early.shape[1]) / RATE
    by_file = Scan("pressure", early, {"detectors": positions(), "times": times})
    for scan in (by_option, by_file):
        np.testing.assert_allclose(data(scan), wanted, atol=1e-9 * np.abs(wanted).max())


def test_all_is_chosen_as_without_early_samples():
    """The artefact is where the laser fires, and what is before it is noise."""
    counts = raw_counts(record()).astype(float)
    rng = np.random.default_rng(2)
    quiet = counts[:, -1:] + 5 * rng.standard_normal((len(counts), EARLY))
    early = np.round(np.concatenate([quiet, counts], axis=1))
    wanted = choose(made(counts), sound_speed=SPEED)
    chosen = choose(with_facts(made(early), start_time=SHIFTED), sound_speed=SPEED)
    assert chosen.model == wanted.model and chosen.channels == wanted.channels
    assert chosen.dead_time == pytest.approx(wanted.dead_time, abs=1e-9)
    assert chosen.region_radius == pytest.approx(wanted.region_radius, rel=0.1)
    assert chosen.max_frequency == pytest.approx(wanted.max_frequency, rel=0.3)
    assert 0.3 < chosen.alpha / wanted.alpha < 3


def test_a_late_first_sample_gives_the_true_speed_once_it_is_said():
    noisy = record() + 0.01 * record().max() * np.random.default_rng(0).standard_normal((90, 230))
    late = with_facts(made(noisy[:, 8:]), start_time=8 / RATE)
    assert late.known["times"][0] == pytest.approx(8 / RATE)
    found = choose(late, model="in-plane")
    assert found.sound_speed == pytest.approx(SPEED, rel=2e-3)


def test_images_under_constraints_of_early_samples():
    """Their model is of the whole record, and nothing of it is before time 0."""
    options = GIVEN | {"model_based": True, "penalty": "ridge", "sound_speed": SPEED}
    del options["alpha"]
    plain = made(record())
    early = with_facts(made(with_early_samples(record())), start_time=SHIFTED)
    images = [
        reconstruct(scan, choose(scan, **options, band="none", dead_time=0.0)).image
        for scan in (plain, early)
    ]
    assert np.linalg.norm(images[1] - images[0]) < 1e-3 * np.linalg.norm(images[0])


def test_start_times_that_cannot_be_are_refused(tmp_path):
    with pytest.raises(ValueError, match="times end at"):
        choose(with_facts(made(record()), start_time=-1.0))
    with pytest.raises(ValueError, match="start_time"):
        with_facts(made(record()), start_time=np.nan)
    g = Scan("circular_integrals", np.ones((9, 20)), {"radii": np.arange(1.0, 21)})
    with pytest.raises(ValueError, match="start_time is of pressure records"):
        with_facts(g, start_time=1.0)


def test_the_start_time_stays_in_a_file(tmp_path):
    path = tmp_path / "scan.hdf5"
    save_ipasc(path, with_facts(made(record()), start_time=SHIFTED))
    assert load_scan(path).known["times"][0] == pytest.approx(SHIFTED)
    options = {"region_radius": 0.011, "pixels": 9, "sound_speed": SPEED, "band": "none"}
    options |= {"model_based": False}
    early = "sound arrives earlier than the geometry allows"  # as it does in this record
    with pytest.warns(AccuracyWarning, match=early):
        by_file = reconstruct_file(path, **options)
    other = tmp_path / "plain.hdf5"
    save_ipasc(other, made(record()))
    with pytest.warns(AccuracyWarning, match=early):
        by_option = reconstruct_file(other, start_time=SHIFTED, **options)
    np.testing.assert_allclose(by_file.image, by_option.image, rtol=1e-9)


@pytest.mark.parametrize("late", [0, 6])
def test_a_start_that_the_file_does_not_say_is_told_with_the_speed(late):
    """On an ellipse, and confirmed where it is as the file says."""
    curve = elliptic_arc((0.045, 0.035), 90, start=-1.0, stop=4.2)
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"], [1.0, 0.7, 0.5])
    where = np.insert(np.asarray(curve.points), 2, 0.0, axis=1)
    chosen = choose(made(in_plane(bells, curve)[:, late:], detectors=where), model="in-plane")
    assert chosen.time_shift == pytest.approx(late / RATE, abs=0.02 / RATE)
    assert chosen.sound_speed == pytest.approx(SPEED, rel=5e-4)
    assert chosen.grade("sound_speed") == "likely"
    assert chosen.grade("time_shift") == ("guessed" if late else "likely")
    why = dict(chosen.reasons)["time_shift"]
    assert why.startswith("the record starts 1.5" if late else "as the file says; images tell")


def with_artefact(pressure, first):
    """Of the laser, which fires at that sample: 5 times as loud as sound, gone within 1 us."""
    t = (np.arange(pressure.shape[1]) - first) / RATE
    ring = np.where(t < 0, 0.0, np.cos(4e6 * t) * np.exp(-((t / 0.5e-6) ** 2)))
    return pressure + 5 * np.abs(pressure).max() * ring


@pytest.mark.parametrize("early", [4, 9])
def test_the_artefact_of_the_laser_tells_how_early_a_record_starts(early):
    """From noise before it; half a circle would not tell a start by images."""
    noisy = with_early_samples(record(), noise=0.05)[:, EARLY - early :]
    chosen = choose(made(with_artefact(noisy, early)), model="in-plane", sound_speed=SPEED)
    assert chosen.time_shift == pytest.approx(-early / RATE, abs=1e-12)
    assert chosen.grade("time_shift") == "likely"
    assert dict(chosen.standard_errors)["time_shift"] == pytest.approx(0.5 / RATE)
    assert chosen.dead_time > 0


def test_no_artefact_tells_a_start_where_it_need_not_be_the_laser():
    """From the first sample on; unlike in the channels; a step; later; fainter than sound."""
    rng, times = np.random.default_rng(3), np.arange(230) / RATE
    noise, middle = 0.01 * rng.standard_normal((90, 230)), RADIUS / SPEED
    signs = rng.choice([-1.0, 1.0], (90, 1))
    step, muted = np.where(times >= times[9], 5.0, 0.0), np.where(times >= times[9], noise + 2, 0)
    others = (
        noise,
        np.zeros((90, 230)),
        with_artefact(noise, 0),
        with_artefact(noise, 1),
        noise + signs * (with_artefact(noise, 9) - noise),
        noise + step,
        muted,
        with_artefact(noise, 60),
        with_artefact(noise, 9) + 10 * (times > times[60]) * np.sin(3e6 * times) * signs,
    )
    assert [start_by_laser(record, times, middle) for record in others] == [None] * len(others)
    seen = start_by_laser(with_artefact(noise, 9), times, middle)
    assert seen is not None and seen.value == -times[9]


def test_times_of_the_file_count_more_than_an_artefact():
    late = with_artefact(record(), 9)
    chosen = choose(with_facts(made(late), start_time=0.0), model="in-plane", sound_speed=SPEED)
    assert chosen.time_shift == 0.0


def test_no_start_counts_with_which_sound_would_come_from_nowhere(monkeypatch):
    """As two speeds may look like one: here 8 us, more than sound takes to a detector."""
    early = Start(-8e-6, 1e-8, SPEED, 1.0)
    monkeypatch.setattr("jaxtat.scans.pipeline.start_and_speed", lambda scan, choices: early)
    chosen = choose(made(record()), two_speeds=False)
    assert chosen.time_shift == 0 and chosen.grade("time_shift") == "guessed"
    assert chosen.grade("region_radius") == "likely"


def test_from_half_a_circle_no_start_is_told():
    """A speed that goes with it does as well: both are guesses, and the file's start is kept."""
    half = slice(15, 75)
    of_half = made(record()[half, 3:], detectors=positions()[half])
    chosen = choose(of_half, model="in-plane", two_speeds=False)
    assert chosen.time_shift == 0.0 and chosen.grade("time_shift") == "guessed"
    assert chosen.grade("sound_speed") == "guessed"
    speed = chosen.sound_speed
    more = RADIUS / (RADIUS / speed - 1e-6) - speed
    assert (
        f"1 us more would make the speed {more:.3g} m/s more" in dict(chosen.reasons)["time_shift"]
    )
