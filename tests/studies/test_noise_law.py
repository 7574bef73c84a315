"""Predicted noise against exact standard deviations of actual reconstructions."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    RelativeTikhonov,
    Setup,
    build_plan,
    circular_arc,
    cosine_filter,
    detector_curve,
    disk,
    elliptic_arc,
)
from jaxtat.studies import pixel_standard_deviation, predict_noise


@pytest.mark.slow
def test_the_law_tells_the_noise_of_a_reconstruction():
    """An ellipse and half a disk, in the middle of what is seen; one sigma for each detector."""
    curve = elliptic_arc((1.6, 1.25), 160, start=np.pi / 2, stop=3 * np.pi / 2)
    setup = Setup(curve, disk(1.0, 0.0), ImageGrid(41))
    plan = build_plan(setup, RelativeTikhonov(0.1))
    few = ImageGrid(4, 0.2, (-0.45, 0.1))
    sigma = np.linspace(0.5, 1.5, 160)
    for low_pass in (None, cosine_filter):
        exact = pixel_standard_deviation(plan, sigma, grid=few, low_pass=low_pass)
        law = predict_noise(setup, sigma, grid=few, low_pass=low_pass)
        np.testing.assert_allclose(law, exact, rtol=0.1)


def setup_of(arc, unit=1.0, coarser=1):
    radii = unit * (0.6 + 0.02 * np.arange(71))
    highest = np.pi / (0.02 * unit * coarser)
    return Setup(arc, disk(0.6 * unit), ImageGrid(4, 0.3 * unit), radii, max_frequency=highest)


def test_it_follows_units_and_numbers():
    arc = circular_arc(1.3, 0.7, 50)
    setup = setup_of(arc)
    one = np.asarray(predict_noise(setup, 1.0))
    far = np.asarray(predict_noise(setup_of(arc, coarser=2), 3.0))
    np.testing.assert_allclose(far, one * 3 / 2**1.5, rtol=1e-4)
    mm = setup_of(circular_arc(1.3e3, 0.7e3, 50), 1e3)
    np.testing.assert_allclose(predict_noise(mm, 1.0), one / 1e3, rtol=1e-9)
    assert np.all(np.asarray(predict_noise(setup, 1.0, kappa=1.0)) < one)


def test_on_a_detector_it_is_infinite(arc):
    grid = ImageGrid(5, 0.6, arc.curve.points[7])
    found = np.asarray(predict_noise(arc, 1.0, grid=grid))
    assert np.isinf(found[2, 2]) and np.isfinite(found).sum() == 24


def test_derivatives(check_both_modes):
    measured = detector_curve(circular_arc(1.3, 0.2, 12).points, closed=False)
    setup = Setup(measured, disk(1.0, 0.0), ImageGrid(4, 0.3), 0.3 + 0.1 * np.arange(22))

    def deviation(points, sigma, kappa):
        moved = setup.replace(curve=detector_curve(points, closed=False))
        return predict_noise(moved, sigma, kappa=kappa, width=0.5)

    points = np.asarray(measured.points)
    check_both_modes(deviation, (points, 1.0, 0.2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": -1.0}, "zero or more"),
        ({"sigma": jnp.ones(3)}, "sigma has shape"),
        ({"kappa": -0.1}, "zero or more"),
        ({"width": 0.0}, "width is 0"),
    ],
)
def test_impossible_arguments_are_refused(arc, change, message):
    with pytest.raises(ValueError, match=message):
        predict_noise(arc, **({"sigma": 1.0} | change))
