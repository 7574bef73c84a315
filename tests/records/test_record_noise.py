"""Noise of the quiet part, and its variance in the data by matrices and by drawing."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.special import j0, y0

from jaxtat import ImageGrid, NoiseLevel, Setup, circular_arc, disk, phantoms, reconstruct
from jaxtat.records import (
    RecordNoise,
    condition_record,
    first_arrival,
    noise_of_record,
    pressure_to_circular_integrals,
    record_noise_level,
    supported,
)

TIMES = np.linspace(0, 2.4, 241)
RADII = np.linspace(0.3, 2.3, 65)
FREQUENCIES = np.array([2.0, 10.0, 40.0])
FILTER = np.array([0.5, 1.0, 0.3, -0.2])  # colours the noise
CURVE = circular_arc(1.3, 1.0, 12)
SMOOTH = partial(condition_record, times=TIMES, band=(0.5, 20.0), baseline=False)


def autocovariance(n):
    """Of white noise behind FILTER, at lags 0..n-1."""
    full = np.correlate(FILTER, FILTER, mode="full")[len(FILTER) - 1 :]
    return np.pad(full, (0, n - len(full)))


def spectrum_of_filter(n):
    """(S, variance): of mean 1 over n + 1 frequencies up to half the sampling rate."""
    power = np.abs(np.fft.rfft(FILTER, 2 * n)) ** 2
    variance = FILTER @ FILTER
    return power / variance, variance


def test_variance_of_coloured_noise_is_that_of_its_covariance_matrix():
    rows = np.random.default_rng(0).standard_normal((5, 241))
    spectrum, variance = spectrum_of_filter(241)
    variance_of = jax.jit(lambda noise, rows: noise.variance(rows))
    noise = RecordNoise(jnp.ones(1), jnp.asarray(spectrum))
    exact = np.einsum("it,tu,iu->i", rows, toeplitz(autocovariance(241)), rows)
    assert np.allclose(variance * np.asarray(variance_of(noise, rows)), exact, rtol=1e-12)
    white = RecordNoise(jnp.ones(1), jnp.ones(1))
    assert np.allclose(variance_of(white, rows), np.sum(rows**2, axis=1), rtol=1e-12)


def quiet_record(seed=1):
    """(80, 400): coloured noise of growing size; two channels hum; sound from sample 300 on."""
    rng = np.random.default_rng(seed)
    sigma = np.linspace(1.0, 2.0, 80)
    white = rng.standard_normal((80, 403))
    noise = np.stack([np.convolve(line, FILTER, mode="valid") for line in white])
    record = 512 + sigma[:, None] * noise
    record[[3, 50]] += 100 * np.sin(np.arange(400) / 3)
    record[:, 300:] += 1000 * rng.standard_normal((80, 100))
    return record, sigma * np.linalg.norm(FILTER)


def test_the_quiet_part_tells_size_and_colour():
    record, sigma = quiet_record()
    noise = noise_of_record(record, np.arange(400.0), until=300, dead_time=20)
    good = np.delete(np.arange(80), [3, 50])
    ratio = np.asarray(noise.sigma)[good] / sigma[good]
    assert abs(ratio.mean() - 1) < 0.02 and ratio.std() < 0.1
    assert (np.asarray(noise.sigma)[[3, 50]] > 10 * sigma[[3, 50]]).all()
    spectrum = np.asarray(noise.spectrum)
    exact = np.interp(
        np.linspace(0, 1, len(spectrum)), np.linspace(0, 1, 242), spectrum_of_filter(241)[0]
    )
    assert np.sqrt(np.mean((spectrum - exact) ** 2)) < 0.25  # of 1; the median of 80 periodograms
    assert abs(np.mean(spectrum[:30]) - np.mean(exact[:30])) < 0.1
    # what comes after the quiet part does not matter, nor does an offset
    later = np.where(np.arange(400) < 300, record + 7, 0.0)
    again = noise_of_record(later, np.arange(400.0), until=300, dead_time=20)
    assert np.allclose(again.sigma, noise.sigma, rtol=1e-9)


def test_a_silent_record_has_no_noise():
    noise = noise_of_record(np.zeros((4, 100)), np.arange(100.0), until=50)
    assert not np.asarray(noise.sigma).any() and np.array_equal(
        noise.spectrum, np.ones(len(noise.spectrum))
    )
    with pytest.raises(ValueError, match="the noise is zero"):
        record_noise_level(noise, circular_arc(1.3, 1.0, 4), TIMES, RADII, FREQUENCIES)


def kernels():
    weights = np.convolve(np.diff(RADII) / 2, [1, 1])
    argument = FREQUENCIES[:, None] * RADII
    return np.stack([j0(argument), y0(argument)], axis=1) * weights


def level(noise, model, conditioning):
    found = record_noise_level(
        noise, CURVE, TIMES, RADII, FREQUENCIES, model=model, conditioning=conditioning
    )
    white = np.mean(np.asarray(CURVE.weights)) * np.mean(np.sum(kernels() ** 2, axis=-1), axis=1)
    return np.asarray(found.sigma) ** 2 * white  # as NoiseLevel uses it


@pytest.mark.parametrize(
    ("model", "filtered"), [("in-plane", False), ("in-plane", True), ("2d", False)]
)
def test_noise_power_of_the_radial_transform_by_drawing(model, filtered):
    """400 coloured records of 12 detectors: 4800 values of G_J and G_Y at each frequency."""
    rng = np.random.default_rng(2)
    sigma = np.linspace(0.5, 1.5, 12)
    white = rng.standard_normal((400, 12, 244))
    drawn = sum(h * white[..., 3 - m : 244 - m] for m, h in enumerate(FILTER))
    drawn *= sigma[:, None] / np.linalg.norm(FILTER)
    record = SMOOTH(drawn) if filtered else drawn
    g = pressure_to_circular_integrals(record, TIMES, RADII, model=model)
    power = np.mean(np.einsum("fir,dkr->fidk", kernels(), np.asarray(g)) ** 2, axis=(1, 2))
    measured = np.mean(power * np.asarray(CURVE.weights), axis=1)
    noise = RecordNoise(jnp.asarray(sigma), jnp.asarray(spectrum_of_filter(241)[0]))
    predicted = level(noise, model, SMOOTH if filtered else None)
    assert np.abs(measured / predicted - 1).max() < 0.06  # about three times 1/√(2400)
    assert predicted[0] > 3 * predicted[2]  # far from white in g


def test_white_noise_by_the_matrix_of_the_whole_map():
    to_g = pressure_to_circular_integrals(np.eye(241), TIMES, RADII, model="in-plane")
    rows = np.einsum("fir,tr->fit", kernels(), np.asarray(to_g))
    exact = np.mean(CURVE.weights) * np.mean(np.sum(rows**2, axis=-1), axis=1)
    noise = RecordNoise(jnp.ones(1), jnp.ones(1))
    assert np.allclose(level(noise, "in-plane", None), exact, rtol=1e-9)


def test_the_level_has_derivatives_in_the_record(check_both_modes):
    record = jnp.asarray(np.random.default_rng(3).standard_normal((12, 40)))

    def sigma(record):
        noise = noise_of_record(record, TIMES[:40], until=0.5)
        return record_noise_level(noise, CURVE, TIMES, RADII, FREQUENCIES, model="in-plane").sigma

    check_both_modes(sigma, (record,), rtol=1e-4)


def test_an_image_by_the_noise_of_its_record_is_best():
    """Better than by more or less of it, and far better than by as much white noise in g."""
    curve, region, grid = circular_arc(1.3, 1.0, 72), disk(1.0), ImageGrid(33)
    times = np.arange(149) / 64
    radii = times[19:]  # sound arrives after 0.3
    bells = phantoms.Bells([[0.3, 0.3], [-0.4, 0.2], [-0.2, -0.5]], [0.4, 0.3, 0.25])
    g = np.asarray(bells.circular_integrals(curve, radii))
    exact = np.pad(np.gradient(g / radii, radii, axis=1), ((0, 0), (19, 0)))
    rng = np.random.default_rng(4)
    noisy = exact + 0.5 * exact.std() * rng.standard_normal(exact.shape)
    both = np.stack([exact, noisy])
    data = np.asarray(pressure_to_circular_integrals(both, times, radii, model="in-plane"))
    limit = float(supported(curve, region, times).frequency_of_detectors)
    setup = Setup(curve, region, grid, radii, max_frequency=2 * limit)
    noise = noise_of_record(noisy, times, until=first_arrival(curve, region))
    level = record_noise_level(noise, curve, times, radii, setup.frequencies, model="in-plane")
    inside, truth = np.asarray(region.contains(grid.points)), np.asarray(bells.image(grid))

    def error(sigma):
        image = reconstruct(setup, data[1], NoiseLevel(sigma), inversion="fourier")
        return np.linalg.norm((np.asarray(image) - truth)[inside]) / np.linalg.norm(truth[inside])

    sigma = np.asarray(level.sigma)
    own = error(sigma)
    others = [error(factor * sigma) for factor in (0.3, 3.0)]
    white = error(np.full(len(setup.frequencies), np.std(data[1] - data[0])))
    assert own < min(others)
    assert own < 0.5 * white


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"until": 10.0}, "10 samples lie between"),
        ({"dead_time": 50.0}, "no quiet part"),
        ({"pressure": np.zeros((3, 99))}, "pressure has shape"),
        ({"times": np.arange(100.0) ** 2}, "expected equal"),
    ],
)
def test_records_without_a_quiet_part_are_refused(change, message):
    arguments = {"pressure": np.zeros((3, 100)), "times": np.arange(100.0), "until": 40.0} | change
    with pytest.raises(ValueError, match=message):
        noise_of_record(**arguments)


def test_noise_of_other_detectors_is_refused():
    noise = RecordNoise(jnp.ones(7), jnp.ones(1))
    with pytest.raises(ValueError, match="sigma has shape"):
        record_noise_level(noise, CURVE, TIMES, RADII, FREQUENCIES)
