"""How far fitted images are off: against maps whose errors are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxtat.fitting import fitted_deviation
from jaxtat.fitting.bootstrap import _details, _steepness

SHAPE = 20, 24
INSIDE = np.hypot(*np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 24), indexing="ij")) < 0.9
IMAGE = np.where(INSIDE, 1.0 + np.random.default_rng(0).uniform(size=SHAPE), 0.0)


def same(images):
    return images


def test_of_a_fit_that_is_right_what_is_unexplained_is_left():
    """Signs of rows do not change its size, and details go in and come out."""
    data = IMAGE + np.random.default_rng(1).standard_normal(SHAPE)
    found = fitted_deviation(same, same, IMAGE, data, INSIDE)
    assert_allclose(found[INSIDE], np.abs(data - IMAGE)[INSIDE], rtol=1e-12)
    assert np.isnan(found[~INSIDE]).all()


def test_signs_are_of_whole_rows_and_each_sample_has_its_own():
    seen = []

    def fit(data):
        seen.append(np.asarray(data))
        return data

    data = IMAGE + np.random.default_rng(1).standard_normal(SHAPE)
    none = np.zeros(SHAPE)
    fitted_deviation(fit, lambda images: 0 * images, none, data, INSIDE, samples=6)
    ratios = seen[0] / data
    assert set(np.unique(np.round(ratios, 9))) == {-1.0, 1.0}
    assert (np.ptp(ratios, axis=2) < 1e-9).all()
    assert len(np.unique(np.round(ratios[..., 0]), axis=0)) > 4


def test_a_fit_that_is_too_weak_is_off_by_what_is_missing():
    def weak(data):
        return 0.9 * data

    found = fitted_deviation(weak, same, IMAGE, IMAGE, INSIDE, samples=200, nonnegative=False)
    details = _details(
        jax.random.split(jax.random.key(0))[0], jnp.asarray(IMAGE), jnp.asarray(INSIDE), 200
    )
    wanted = 0.1 * np.sqrt(np.mean((IMAGE + np.asarray(details)) ** 2, axis=0))
    assert_allclose(found[INSIDE], wanted[INSIDE], rtol=1e-12)
    flat = np.where(INSIDE, 2.0, 0.0)  # but for its rim
    alone = fitted_deviation(weak, same, 0 * flat, 0 * flat, INSIDE)
    assert_allclose(alone[INSIDE], 0.0, atol=1e-15)


def test_details_are_as_strong_as_those_of_the_image_and_coarse_ones_prevail():
    n = 64
    x = np.linspace(-1, 1, n)
    image = jnp.asarray((np.hypot(x[:, None], x) < 0.5) * 1.0)
    everywhere = jnp.ones((n, n), bool)
    fields = _details(jax.random.key(3), image, everywhere, 100)
    mean = jnp.mean(_steepness(fields))
    assert_allclose(mean, jnp.mean(_steepness(image[None])), rtol=1e-12)
    power = np.mean(np.abs(np.fft.fft2(fields * np.outer(np.hanning(n), np.hanning(n)))) ** 2, 0)
    slope = np.log(power[3, 0] / power[12, 0]) / np.log(4.0)
    assert abs(slope - 3.0) < 0.5


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="image has shape"):
        fitted_deviation(same, same, IMAGE[1:], IMAGE, INSIDE)
    with pytest.raises(ValueError, match=r"model\(image\) has shape"):
        fitted_deviation(same, same, IMAGE, IMAGE[1:], INSIDE)
    with pytest.raises(ValueError, match=r"fit\(data\) has shape"):
        fitted_deviation(lambda data: data[:, 1:], same, IMAGE, IMAGE, INSIDE)


def test_of_what_is_seen_in_larger_pixels_errors_are_those_of_means():
    def seen(images):
        return images.reshape(-1, 10, 2, 12, 2).mean(axis=(2, 4))

    data = IMAGE + np.random.default_rng(1).standard_normal((20, 1)) * np.ones(SHAPE)
    found = fitted_deviation(same, same, IMAGE, data, INSIDE, seen=seen, samples=64)
    rows = (data - IMAGE)[:, 0].reshape(10, 2)
    whole = seen(INSIDE[None] * 1.0)[0] == 1
    assert (np.isfinite(found) == whole).all()
    # of two rows with signs of their own: half of the time the sum, else the difference
    middle = np.sqrt((rows**2).sum(axis=1)) / 2
    ratio = np.asarray(found)[2:-2, 6] / middle[2:-2]
    assert abs(ratio - 1).max() < 0.4
