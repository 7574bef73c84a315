"""Where sound comes from, against bodies and echoes of which it is known."""

import numpy as np
import pytest

from jaxtat.records.signal_power import RecordPower, muted_until, record_power
from jaxtat.records.source_extent import Heard, arriving_from, heard, sounding_disk, sounding_place

RNG = np.random.default_rng(0)
SPEED, RADIUS, BODY = 1500.0, 0.04, 0.01
MIDDLE = np.array([3e-3, -2e-3])
TIMES = np.arange(2000) / 40e6
PAUSE = 0.3 * RADIUS / SPEED


def detectors(degrees, n=80):
    theta = np.radians(np.linspace(-degrees / 2, degrees / 2, n))
    return RADIUS * np.stack([np.cos(theta), np.sin(theta)], axis=1)


def exact(degrees, speed):
    """When the body is heard, if sound is so fast."""
    d = np.linalg.norm(detectors(degrees) - MIDDLE, axis=1)
    told = np.ones(len(d), bool)
    return Heard((d - BODY) / speed, (d + BODY) / speed, told, told)


def rattle(first, last):
    """Loud from the one time to the other in every detector."""
    t = TIMES * np.ones((len(first), 1))
    inside = (t >= first[:, None]) & (t <= last[:, None])
    return inside * np.sin(2 * np.pi * 2.3e6 * t)


def listened(record, begin=0.0):
    power = record_power(record, TIMES[: record.shape[1]], detrend=True, overlap=4)
    return heard(power.after(begin), PAUSE)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_detectors_begin_and_cease_to_hear_when_there_is_sound(noise):
    first = np.linspace(18e-6, 22e-6, 80)
    record = rattle(first, first + 12e-6) + noise * RNG.standard_normal((80, 2000))
    found = listened(record)
    assert found.begins.all() and found.ceases.all() and found.tells
    assert np.abs(found.first - first).max() < 0.5e-6  # a piece
    assert np.abs(found.last - first - 12e-6).max() < 0.5e-6


def test_what_comes_after_a_pause_is_an_echo():
    first = np.full(80, 18e-6)
    record = rattle(first, first + 12e-6) + 0.5 * rattle(first + 22e-6, first + 30e-6)
    found = listened(record + 0.01 * RNG.standard_normal(record.shape))
    assert np.abs(found.last - 30e-6).max() < 0.5e-6
    near = rattle(first, first + 12e-6) + rattle(first + 18e-6, first + 20e-6)
    assert listened(near).last.min() > 37e-6  # too short a pause


def test_between_exact_zeros_noise_and_faint_echoes_are_no_sound():
    """As where a scanner writes zeros until the first sound and after the last."""
    wanted = exact(200, SPEED)
    echo = rattle(wanted.last + 2 * PAUSE, wanted.last + 2.5 * PAUSE)
    record = rattle(wanted.first, wanted.last) + 0.1 * echo
    record = record + 0.05 * RNG.standard_normal(record.shape)
    after = (wanted.last + 2.5 * PAUSE)[:, None]
    record[(wanted.first[:, None] > TIMES) | (after < TIMES)] = 0.0
    found = listened(record)
    assert np.abs(found.first - wanted.first).max() < 1e-6 and found.tells
    assert np.abs(found.last - wanted.last).max() < 1e-6


def test_noise_tells_nothing():
    assert not listened(RNG.standard_normal((80, 2000))).tells


def test_a_record_that_begins_or_ends_within_the_sound_tells_the_other_side():
    first = np.full(80, 18e-6)
    record = rattle(first, first + 12e-6) + 0.01 * RNG.standard_normal((80, 2000))
    late, early = listened(record, begin=21e-6), listened(record[:, :1000])
    assert not late.begins.any() and late.ceases.all() and late.tells
    assert early.begins.all() and not early.ceases.any() and early.tells


def test_a_muted_start_ends_behind_its_step():
    record = 500.0 + RNG.standard_normal((80, 2000))
    record[:, :703] = 0.0
    end = muted_until(record_power(record, TIMES, detrend=True))
    assert TIMES[703] < end <= TIMES[723]


@pytest.mark.parametrize("degrees", [90, 125, 180, 360])
def test_both_times_tell_the_size_at_a_wrong_speed(degrees):
    """5 % off, by which onsets alone would be 2 mm off."""
    found = sounding_disk(detectors(degrees), exact(degrees, 1575), SPEED, speed_known=False)
    assert found.radius == pytest.approx(BODY, rel=0.06)
    assert np.linalg.norm(found.middle - MIDDLE) < 2.5e-3
    if degrees >= 180:
        assert found.speed == pytest.approx(1.05, abs=0.01)


def test_a_known_speed_is_kept():
    found = sounding_disk(detectors(180), exact(180, SPEED), SPEED, speed_known=True)
    assert found.speed == 1.0
    assert found.radius == pytest.approx(BODY, rel=1e-3)
    np.testing.assert_allclose(found.middle, MIDDLE, atol=1e-5)


def test_the_disk_bears_detectors_that_hear_something_else():
    when = exact(270, SPEED)
    when.first[RNG.permutation(80)[:30]] -= RNG.uniform(2e-6, 1e-5, 30)
    when.last[RNG.permutation(80)[:20]] += RNG.uniform(2e-6, 1e-5, 20)
    found = sounding_disk(detectors(270), when, SPEED, speed_known=False)
    np.testing.assert_allclose(found.middle, MIDDLE, atol=3e-4)
    assert found.radius == pytest.approx(BODY, rel=0.03)


def test_a_detector_is_averaged_with_its_neighbours():
    """A single one that hears something fainter and earlier does not decide."""
    power = np.full((80, 100), 1e-3)
    power[:, 40:60] = 1.0
    power[7, 5] = 0.03
    found = heard(RecordPower(np.arange(100.0), power), 12.0)
    assert found.first.tolist() == [40.0] * 80


def test_the_deviation_of_the_times_is_that_of_the_detectors():
    """Each is 1 mm off one way or the other, in turn: no disk explains that."""
    when = exact(270, SPEED)
    off = 1e-3 / SPEED * (-1.0) ** np.arange(80)
    assert sounding_disk(detectors(270), when, SPEED, speed_known=True).deviation < 1e-5
    found = sounding_disk(
        detectors(270), when._replace(first=when.first + off), SPEED, speed_known=True
    )
    assert found.deviation == pytest.approx(0.5e-3, rel=0.2)  # of one half of the times it is 0
    assert found.reach == pytest.approx(BODY + np.linalg.norm(MIDDLE), rel=0.1)


WALL = np.array([0.0, 24e-3])


def with_a_wall(loud):
    """The body's rattle, and that of a wall 1 mm thick, as loud as is asked for."""
    when, d = exact(360, SPEED), np.linalg.norm(detectors(360) - WALL, axis=1)
    return rattle(when.first, when.last) + loud * rattle((d - 5e-4) / SPEED, (d + 5e-4) / SPEED)


def test_the_largest_place_is_the_body_though_a_wall_is_louder():
    power = record_power(with_a_wall(3.0), TIMES, detrend=True, overlap=4)
    place = sounding_place(detectors(360), power, SPEED)
    assert place is not None
    distances, step = np.linalg.norm(place - MIDDLE, axis=1), 0.95 * RADIUS / 25
    assert distances.max() < BODY + 2 * step
    assert len(place) * step**2 > np.pi * BODY**2
    within = arriving_from(place, detectors(360), power.times, SPEED)
    when = heard(power, PAUSE, within)
    assert when.begins.all() and when.ceases.all()
    found = sounding_disk(detectors(360), when, SPEED, speed_known=True)
    assert found.reach == pytest.approx(BODY + np.linalg.norm(MIDDLE), rel=0.1)


def test_of_two_bodies_alike_none_is_the_largest():
    record = 0.0
    for side in (-1, 1):
        d = np.linalg.norm(detectors(360) - [side * 14e-3, 0.0], axis=1)
        record = record + rattle((d - 4e-3) / SPEED, (d + 4e-3) / SPEED)
    power = record_power(record, TIMES, detrend=True, overlap=4)
    assert sounding_place(detectors(360), power, SPEED) is None
