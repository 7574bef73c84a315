"""Broken channels made on purpose, and records that are whole."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import circular_arc, phantoms
from jaxtat.records import channel_quality

TIMES = np.arange(1, 401) / 160  # paths from 0 to 2.5
BROKEN = {"constant": 2, "zero": 5, "top": 9, "hiss": 13, "clipped": 20, "stuck": 31, "loud": 44}


@cache
def exact_record():
    """(60, 400): in-plane pressure of two bells, d(g/r)/dr, zero before sound arrives."""
    bells = phantoms.Bells([[0.3, 0.2], [-0.5, 0.1]], [0.35, 0.15])
    g = np.asarray(bells.circular_integrals(circular_arc(1.3, 1.0, 60), TIMES))
    return np.gradient(g / TIMES, TIMES, axis=1)


def counts(record, rng, noise=3.0):
    """As a converter gives it: whole counts, its own offset in every channel, noise, drift."""
    scale = 2000 / np.abs(record).max()
    offset = 32768 + 500 * rng.standard_normal((len(record), 1))
    noisy = scale * record + offset + noise * rng.standard_normal(record.shape)
    return np.round(noisy + 40 * TIMES)


def numbers(mask):
    return np.flatnonzero(np.asarray(mask)).tolist()


def test_exact_data_raise_no_alarm():
    record = exact_record()
    quality = channel_quality(record, TIMES)
    assert np.all(quality.good), str(quality)
    assert str(quality) == "60 detectors: all good"
    assert np.max(quality.noise) < 1e-3 * np.min(quality.signal)


@pytest.mark.parametrize("count", [1.0, 1e3])
def test_coarse_counts_raise_no_alarm(count):
    """Down to a converter of which the whole signal takes four counts."""
    whole = counts(exact_record(), np.random.default_rng(2))
    assert np.all(channel_quality(np.round(whole / count), TIMES).good)


@pytest.mark.parametrize("rest", [slice(280, 400), slice(20, 110)])
def test_channels_that_are_exactly_silent_are_not_saturated(rest):
    """A third of a simulated record rests at its baseline where the others hold faint sound."""
    rng = np.random.default_rng(8)
    loud = np.abs(exact_record()).max()
    faint = 1e-4 * loud * np.sin(40 * TIMES + rng.uniform(0, 6, (60, 1)))
    record = exact_record() + faint
    record[::3, rest] = 0.0
    quality = channel_quality(record + rng.normal(7, 1, (60, 1)), TIMES)
    assert np.all(quality.good), str(quality)


def test_zeros_in_a_noisy_record_are_silence_and_another_level_is_not():
    rng = np.random.default_rng(9)
    loud = np.abs(exact_record()).max()
    record = exact_record() + 0.01 * loud * (TIMES + rng.standard_normal((60, 400)))
    record[5, 300:] = record[9, 20:60] = 0.0
    record[14, 300:] = 0.3 * loud
    assert numbers(channel_quality(record, TIMES).saturated) == [14]


def test_each_kind_of_broken_channel_is_found_and_no_other():
    rng = np.random.default_rng(0)
    record = counts(exact_record(), rng)
    record[BROKEN["constant"]] = 31234
    record[BROKEN["zero"]] = 0
    record[BROKEN["top"]] = 65535
    record[BROKEN["hiss"]] = np.round(32768 + 3 * rng.standard_normal(400))
    clipped = record[BROKEN["clipped"]]
    middle, limit = np.median(clipped), np.ptp(clipped) / 4
    record[BROKEN["clipped"]] = np.clip(clipped, np.round(middle - limit), np.round(middle + limit))
    record[BROKEN["stuck"], 250:] = record[BROKEN["stuck"], 249] + 7
    record[BROKEN["loud"]] += np.round(20 * 3.0 * rng.standard_normal(400))
    quality = channel_quality(record, TIMES)
    assert numbers(quality.dead) == [2, 5, 9, 13]
    assert numbers(quality.saturated) == [20, 31]
    assert numbers(quality.noisy) == [44]
    assert np.array_equal(
        quality.weights, np.where(np.isin(np.arange(60), list(BROKEN.values())), 0, 1)
    )
    assert str(quality) == "60 detectors: 4 dead (2, 5, 9, 13); 2 saturated (20, 31); 1 noisy (44)"


def drifting_counts(record, height, noise, rng, limits=None):
    """Whole counts with drift and noise, clipped beforehand to shares of every channel's signal."""
    x = height * record / np.abs(record).max() + noise * rng.standard_normal(record.shape)
    x += 32768 + rng.normal(0, 200, (60, 1)) + rng.normal(0, 100, (60, 1)) * TIMES / TIMES[-1]
    for row, share in (limits or {}).items():
        middle, half = x[row].mean(), share * np.ptp(x[row]) / 2
        x[row] = np.clip(x[row], middle - half, middle + half)
    return np.round(x)


@pytest.mark.parametrize(
    ("height", "noise"),
    [(300, 0.0), (300, 0.4), (300, 1.5), (2000, 0.2), (2000, 0.7), (20000, 0.0), (20000, 0.4)],
)
def test_quiet_records_of_whole_counts_raise_no_alarm(height, noise):
    """They rest on a staircase of drift, and at the crests of waves; one of 60 may be doubtful."""
    rng = np.random.default_rng(6)
    found = channel_quality(drifting_counts(exact_record(), height, noise, rng), TIMES)
    assert np.sum(~np.asarray(found.good)) <= 1, str(found)


@pytest.mark.parametrize(
    ("height", "noise"), [(300, 0.0), (300, 0.9), (2000, 0.4), (2000, 3.0), (20000, 0.0)]
)
def test_clipped_channels_of_whole_counts_are_found(height, noise):
    rng = np.random.default_rng(7)
    limits = dict(zip(range(3, 60, 6), np.tile([0.7, 0.5, 0.3, 0.2, 0.15], 2), strict=True))
    record = drifting_counts(exact_record(), height, noise, rng, limits)
    found = numbers(channel_quality(record, TIMES).saturated)
    assert len(set(limits) - set(found)) <= 1 and len(set(found) - set(limits)) <= 1, found


def test_noise_is_that_of_the_record():
    rng = np.random.default_rng(3)
    record, sigma = exact_record(), np.linspace(0.01, 0.02, 60) * 0.1
    quality = channel_quality(record + sigma[:, None] * rng.standard_normal(record.shape), TIMES)
    ratio = np.asarray(quality.noise) / sigma
    assert abs(ratio.mean() - 1) < 0.1 and ratio.min() > 0.6 and ratio.max() < 1.5


def test_frames_are_judged_together_and_without_the_artefact_at_their_start():
    record = counts(exact_record(), np.random.default_rng(4))
    record[:, :30] = 65535
    record[::2, 10:20] = 0
    frames = np.stack([record, record])
    assert np.all(channel_quality(frames, TIMES, dead_time=0.19).good)
    frames[1, 7] += 5000 * np.random.default_rng(5).standard_normal(400)
    assert numbers(channel_quality(frames, TIMES, dead_time=0.19).noisy) == [7]


def test_noise_and_signal_have_derivatives(check_both_modes):
    record = jnp.asarray(np.random.default_rng(7).standard_normal((3, 80)))

    @jax.jit
    def found(record):
        quality = channel_quality(record, np.arange(80.0))
        return quality.noise, quality.signal

    check_both_modes(found, (record,))
    silent = jax.jit(jax.grad(lambda record: sum(map(jnp.sum, found(record)))))(np.zeros((3, 80)))
    assert np.isfinite(silent).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pressure": np.zeros((3, 99))}, "pressure has shape"),
        ({"pressure": np.full((3, 400), np.nan)}, "NaN"),
        ({"dead_time": 2.3}, "33 samples are left after dead_time"),
        ({"dead": 0.0}, "dead is 0"),
        ({"noisy": -1.0}, "noisy is -1"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    arguments = {"pressure": np.zeros((3, 400)), "times": TIMES} | change
    with pytest.raises(ValueError, match=message):
        channel_quality(**arguments)


@pytest.mark.parametrize("data_file", ["msot_scan9.npz"], indirect=True)
def test_a_tenth_of_a_measured_scan_broken_is_found(data_file):
    file = np.load(data_file)
    raw, times = file["raw"].astype(float), np.arange(2030) / float(file["fs"])
    clean = channel_quality(raw, times, dead_time=5e-6)
    noise = np.asarray(clean.noise)
    assert np.all(clean.good)
    # how far the thresholds are from the worst good channel
    assert noise.max() < 1.5 * np.median(noise) and np.asarray(clean.signal).min() > 1000
    rng = np.random.default_rng(0)
    record, shuffled = raw.copy(), rng.permutation(256)
    still, zero, top, hiss, rails, loud = np.split(shuffled[:78], np.arange(13, 78, 13))
    record[still], record[zero], record[top] = 34000, 0, 65535
    record[hiss] = np.round(34000 + noise[hiss, None] * rng.standard_normal((13, 2030)))
    middle = np.median(raw[rails], axis=1, keepdims=True)
    spread = raw[rails, 200:].std(axis=1, keepdims=True)
    record[rails] = np.clip(raw[rails], middle - 2 * spread, middle + 2 * spread)
    record[loud] += np.round(20 * noise[loud, None] * rng.standard_normal((13, 2030)))
    found = channel_quality(record, times, dead_time=5e-6)
    assert numbers(found.dead) == sorted([*still, *zero, *top, *hiss])
    assert numbers(found.saturated) == sorted(rails)
    assert numbers(found.noisy) == sorted(loud)
