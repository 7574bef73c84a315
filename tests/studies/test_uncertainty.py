"""Standard deviations of pixels: the dense matrix, sampling, scaling, derivatives, refusals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxtat import (
    ImageGrid,
    Setup,
    build_plan,
    circular_arc,
    cosine_filter,
    data_radii,
    disk,
    reconstruct,
)
from jaxtat.studies import pixel_standard_deviation


@pytest.fixture(scope="module")
def tiny():
    """With pixels in four blocks, of which three are cut."""
    curve, region = circular_arc(1.3, 0.8, 32), disk(1.0, 0.8)
    return Setup(curve, region, ImageGrid((11, 9)), data_radii(curve, region, 0.2))


@pytest.fixture(scope="module")
def tiny_plan(tiny):
    return build_plan(tiny, method="collocation")  # compiles fastest


@pytest.fixture(scope="module")
def matrix(tiny_plan):
    """L, (x1, x2, detectors, radii), column by column, from the images of unit data."""
    return columns(lambda g: reconstruct(tiny_plan, g), tiny_plan.curve, tiny_plan.radii)


def columns(work, curve, radii):
    shape = curve.n_detectors, radii.shape[0]
    units = np.eye(shape[0] * shape[1]).reshape(-1, *shape)
    images = np.moveaxis(np.asarray(work(units)), 0, -1)
    return images.reshape(*images.shape[:-1], *shape)


def spread(*arguments, **options):
    return np.asarray(pixel_standard_deviation(*arguments, **options))


@pytest.mark.parametrize("axes", [0, 1, 2])
def test_it_is_that_of_the_dense_matrix(tiny_plan, matrix, axes):
    sigma = np.random.default_rng(0).uniform(0.5, 2.0, matrix.shape[2 : 2 + axes])
    each = np.broadcast_to(sigma[:, None] if axes == 1 else sigma, matrix.shape[2:])
    expected = np.sqrt(np.sum((matrix * each) ** 2, axis=(2, 3)))
    found = spread(tiny_plan, sigma)
    inside = np.asarray(tiny_plan.region.contains(tiny_plan.grid.points))
    assert_allclose(found[inside], expected[inside], rtol=1e-9)
    assert np.isnan(found[~inside]).all()


def test_with_options_of_the_reconstruction_and_pixels_chosen(tiny_plan):
    options = {"low_pass": cosine_filter, "inversion": "fourier"}
    dense = columns(
        lambda g: reconstruct(tiny_plan, g, **options), tiny_plan.curve, tiny_plan.radii
    )
    where = np.zeros(tiny_plan.grid.shape, bool)
    where[[4, 10], [5, 0]] = True
    found = spread(tiny_plan, 0.3, where=where, **options)
    expected = 0.3 * np.sqrt(np.sum(dense**2, axis=(2, 3)))
    assert_allclose(found[where], expected[where], rtol=1e-9)
    assert np.isnan(found).sum() == where.size - 2
    assert np.isnan(spread(tiny_plan, 0.3, where=np.zeros_like(where))).all()


def test_a_coarser_grid_takes_some_of_the_pixels(tiny_plan):
    fine = spread(tiny_plan, 1.0)
    coarse = spread(tiny_plan, 1.0, grid=ImageGrid((6, 5)))
    assert_allclose(coarse, fine[::2, ::2], rtol=1e-9)


def test_images_of_noise_spread_as_much(tiny_plan):
    """The ratio of two standard deviations has one of 1/√(2 n) = 1.5 %: 5 of them for the worst of
    54 pixels, which normal variables exceed once in 30000 such maps, and 1 for the mean."""
    sigma = np.random.default_rng(1).uniform(0.5, 2.0, tiny_plan.curve.n_detectors)
    size = len(sigma) * len(tiny_plan.radii)  # images at a time, as for the dense matrix
    n = size * -(-2000 // size)
    noise = np.random.default_rng(2).standard_normal((n, len(sigma), len(tiny_plan.radii)))
    parts = np.split(noise * sigma[:, None], n // size)
    images = np.concatenate([np.asarray(reconstruct(tiny_plan, part)) for part in parts])
    ratio = (np.sqrt(np.mean(images**2, axis=0)) / spread(tiny_plan, sigma)).ravel()
    ratio = ratio[np.isfinite(ratio)]
    assert ratio.size == 54
    assert np.abs(ratio - 1).max() < 5 / np.sqrt(2 * n)
    assert abs(ratio.mean() - 1) < 1 / np.sqrt(2 * n)


def test_it_is_proportional_to_the_noise_and_variances_add(tiny_plan):
    rng = np.random.default_rng(3)
    one, other = rng.uniform(0, 1, (2, tiny_plan.curve.n_detectors, len(tiny_plan.radii)))
    both = spread(tiny_plan, np.hypot(one, other))
    assert_allclose(both**2, spread(tiny_plan, one) ** 2 + spread(tiny_plan, other) ** 2, rtol=1e-9)
    assert_allclose(spread(tiny_plan, 3 * one), 3 * spread(tiny_plan, one), rtol=1e-12)


def test_derivative_with_respect_to_sigma(tiny_plan, matrix, check_both_modes):
    """d std_i / d sigma_k = Σ_r L_ikr² sigma_k / std_i; where there is no noise it is 0."""
    sigma = np.random.default_rng(4).uniform(0.5, 2.0, tiny_plan.curve.n_detectors)
    square = np.sum(matrix[5, 4] ** 2, axis=-1)
    where = np.zeros(tiny_plan.grid.shape, bool)
    where[5, 4] = True

    @jax.jit
    def pixel(sigma):
        return pixel_standard_deviation(tiny_plan, sigma, where=where)[5, 4]

    value, slope = jax.value_and_grad(pixel)(jnp.asarray(sigma))
    assert_allclose(slope, square * sigma / float(value), rtol=1e-9)
    assert_allclose(jax.grad(pixel)(jnp.zeros_like(slope)), 0)
    check_both_modes(pixel, (sigma,), rtol=1e-6, atol=1e-6)


def test_the_bar_counts_pixels_if_it_is_asked_for(tiny_plan, capsys):
    pixel_standard_deviation(tiny_plan, 1.0)
    assert not capsys.readouterr().err
    pixel_standard_deviation(tiny_plan, 1.0, progress=True)
    n = int(tiny_plan.region.contains(tiny_plan.grid.points).sum())
    assert f"{n}/{n}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": -1.0}, "sigma goes down to -1, expected zero or more"),
        ({"sigma": np.ones(31)}, r"sigma has shape \(31,\), expected a number, \(32,\) or \(32, "),
        ({"sigma": np.nan}, "NaN"),
        ({"sigma": 1j}, "complex"),
        ({"inversion": "other"}, "inversion is 'other', expected one of fourier, fbp"),
        ({"where": np.ones((11, 9))}, "where has dtype float64"),
        ({"where": np.ones((9, 11), bool)}, r"shape \(9, 11\), expected booleans \(11, 9\)"),
    ],
)
def test_bad_arguments_are_refused(tiny_plan, change, message):
    with pytest.raises(ValueError, match=message):
        pixel_standard_deviation(tiny_plan, **({"sigma": 1.0} | change))


def test_a_traced_plan_gives_the_same(tiny_plan):
    """All pixels are worked out where nobody knows yet which are in the region."""
    found = eqx.filter_jit(pixel_standard_deviation)(tiny_plan, 1.0)
    assert_allclose(found, spread(tiny_plan, 1.0), rtol=1e-9)
