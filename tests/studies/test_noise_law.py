"""Predicted noise against exact standard deviations of actual reconstructions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxtat import (
    ImageGrid,
    RelativeTikhonov,
    Setup,
    build_plan,
    circular_arc,
    cosine_filter,
    data_radii,
    detector_curve,
    disk,
    elliptic_arc,
)
from jaxtat.studies import pixel_standard_deviation, predict_noise


@pytest.mark.parametrize("low_pass", [None, cosine_filter])
def test_the_law_tells_the_noise_of_a_reconstruction(low_pass):
    """An ellipse and half a disk, in the middle of what is seen; one sigma for each detector."""
    curve = elliptic_arc((1.6, 1.25), 160, start=np.pi / 2, stop=3 * np.pi / 2)
    region, grid = disk(1.0, 0.0, n_boundary=320), ImageGrid(41)
    radii = data_radii(curve, region, grid.spacing[0])
    plan = build_plan(Setup(curve, region, grid, radii), RelativeTikhonov(0.1))
    few = ImageGrid(4, 0.2, (-0.45, 0.1))
    sigma = np.linspace(0.5, 1.5, 160)
    exact = pixel_standard_deviation(plan, sigma, grid=few, low_pass=low_pass, progress=False)
    law = predict_noise(curve, few, sigma, radial_step=grid.spacing[0], low_pass=low_pass)
    ratio = np.asarray(law / exact)
    assert np.all(np.abs(ratio - 1) < 0.1)


def test_it_follows_units_and_numbers():
    arc, grid = circular_arc(1.3, 0.5, 50), ImageGrid(4, 0.3)
    one = np.asarray(predict_noise(arc, grid, 1.0, radial_step=0.02))
    far = np.asarray(predict_noise(arc, grid, 3.0, radial_step=0.02, max_frequency=np.pi / 0.04))
    np.testing.assert_allclose(far, one * 3 / 2**1.5, rtol=1e-4)
    mm = circular_arc(1.3e3, 0.5e3, 50), ImageGrid(4, 0.3e3)
    np.testing.assert_allclose(predict_noise(*mm, 1.0, radial_step=20.0), one / 1e3, rtol=1e-9)
    damped = np.asarray(predict_noise(arc, grid, 1.0, radial_step=0.02, kappa=1.0))
    assert np.all(damped < one)


def test_on_a_detector_it_is_infinite():
    line = detector_curve([[-0.6, 0.0], [-0.3, 0.0], [0.0, 0.0], [0.3, 0.0], [0.6, 0.0]])
    found = np.asarray(predict_noise(line, ImageGrid(5, 0.6), 1.0))
    assert np.isinf(found[:, 2]).all() and np.isfinite(np.delete(found, 2, axis=1)).all()


def test_derivatives():
    grid = ImageGrid(4, 0.3)

    def deviation(points, sigma, kappa):
        curve = detector_curve(points, closed=False)
        return predict_noise(curve, grid, sigma, radial_step=0.1, kappa=kappa, width=0.5)

    points = np.asarray(circular_arc(1.3, 0.0, 12).points)
    check_grads(jax.jit(deviation), (points, 1.0, 0.2), order=1, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": -1.0}, "zero or more"),
        ({"sigma": jnp.ones(3)}, "sigma has shape"),
        ({"radial_step": 0.0}, "radial_step is 0"),
        ({"max_frequency": np.nan}, "max_frequency is nan"),
    ],
)
def test_impossible_arguments_are_refused(change, message):
    given = {"sigma": 1.0, "radial_step": 0.1} | change
    with pytest.raises(ValueError, match=message):
        predict_noise(circular_arc(1.3, 0.0, 12), ImageGrid(4, 0.3), **given)
