"""What a record shows, against records of which it is known."""

import numpy as np
import pytest

from jaxtat.records.signal_power import (
    artefact_end,
    highest_frequency,
    record_power,
)

RNG = np.random.default_rng(0)
TIMES = np.arange(2000) / 40e6


def pulses(arrivals, width=0.4e-6):
    t = (TIMES - np.asarray(arrivals)[:, None]) / width
    return t * np.exp(-(t**2))


def test_offset_and_drift_have_no_power_and_noise_its_variance():
    lines = 500 + RNG.normal(0, 100, (30, 1)) + RNG.normal(0, 50, (30, 1)) * TIMES * 1e5
    quiet = record_power(lines, TIMES, detrend=True)
    assert quiet.power.max() < 1e-18 * 500**2
    noisy = record_power(lines + 3 * RNG.standard_normal((30, 2000)), TIMES, detrend=True)
    assert np.isclose(noisy.power.mean(), 9 * (20 - 2) / 20, rtol=0.02)  # a line takes two of 20
    assert record_power(lines, TIMES, detrend=False).power.max() > 400**2


@pytest.mark.parametrize("length", [0.5e-6, 2e-6, 5e-6])
def test_the_artefact_ends_when_it_has_died_away(length):
    record = pulses(np.full(40, 30e-6)) + 0.01 * RNG.standard_normal((40, 2000))
    loud = record + 20 * np.cos(3e7 * TIMES) * (length > TIMES)
    middle = 27e-6
    end = artefact_end(record_power(loud, TIMES, True), middle)
    assert length <= end <= length + 1.6e-6  # pieces are half a microsecond long
    assert artefact_end(record_power(record, TIMES, True), middle) == 0.0
    assert artefact_end(record_power(0 * record, TIMES, True), middle) == 0.0


def test_the_artefact_ends_also_where_no_noise_follows():
    """What is left of it is more than nothing for long, and no sound."""
    dying = 20 * np.cos(3e7 * TIMES) * np.exp(-((TIMES / 0.7e-6) ** 2))
    record = pulses(np.full(40, 30e-6)) + dying
    assert 2e-6 < artefact_end(record_power(record, TIMES, True), 27e-6) < 6e-6


@pytest.mark.parametrize("limit", [2e6, 5e6, 12e6])
def test_the_highest_frequency_is_where_the_spectrum_leaves_the_noise(limit):
    spectrum = np.fft.rfft(RNG.standard_normal((60, 1400)))
    spectrum[:, np.fft.rfftfreq(1400, 1 / 40e6) > limit] = 0.0
    sound = np.hanning(1400) * np.fft.irfft(spectrum, 1400)
    record = np.pad(sound, ((0, 0), (600, 0)))
    record += 0.03 * RNG.standard_normal((60, 2000))
    found = highest_frequency(record, TIMES, slice(0, 550))
    assert np.isclose(found, limit, rtol=0.05)


def test_waves_half_as_strong_as_the_noise_count_and_chance_does_not():
    """Whose power is that of the noise up to a frequency, of many detectors and of few."""
    noise = RNG.standard_normal((200, 2000))
    spectrum = np.fft.rfft(RNG.standard_normal((200, 1400)))
    spectrum[:, np.fft.rfftfreq(1400, 1 / 40e6) > 5e6] = 0.0
    sound = np.pad(np.fft.irfft(spectrum, 1400), ((0, 0), (600, 0)))
    sound += 100 * np.pad(np.hanning(400), (1000, 600))  # and what is low, of which there is much
    assert np.isclose(highest_frequency(sound + noise, TIMES, slice(0, 550)), 5e6, rtol=0.05)
    for n in (4, 12, 200):
        low = np.pad(100 * np.hanning(400), (1000, 600)) + noise[:n]
        assert highest_frequency(low, TIMES, slice(0, 550)) < 1e6, n
