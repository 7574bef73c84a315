"""Transverse weight against exact crossings: circles, straight arrays, arcs and their ends."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.stats import norm

from jaxtat import circular_arc, detector_curve
from jaxtat.geometry import SampledCurve, join_curves, transverse_weight

N, ANGLES = 800, np.arange(24) * np.pi / 24  # one size of curve, and of lines: (24, 15)


def test_of_a_circle_it_is_two_over_the_cosine_of_incidence():
    """2/√(1 - s²) at offset s R; the Gaussian adds eps²/2 of its second derivative, (1 + 2 s²) /
    (1 - s²)^(5/2) for a unit circle. What is allowed is of fourth order."""
    curve, s = circular_arc(1.0, 1.0, N), np.linspace(-0.7, 0.7, 15)
    eps = 3 * 2 * np.pi / N
    exact = 2 / np.sqrt(1 - s**2) + eps**2 * (1 + 2 * s**2) / (1 - s**2) ** 2.5
    found = transverse_weight(curve, ANGLES[:, None], s)
    assert found.shape == (24, 15)
    assert_allclose(found, np.broadcast_to(exact, found.shape), rtol=1e-4)
    plain = np.abs(np.asarray(found) - 2 / np.sqrt(1 - s**2)).max()
    assert plain > 5e-3, "the correction is much larger than what is allowed"


@given(st.floats(0.05, 20.0), st.floats(-0.9, 1.0), st.floats(0.0, 3.1), st.floats(-2.0, 2.0))
@settings(deadline=None, max_examples=20)
def test_its_integral_over_offsets_is_the_length_of_the_curve(radius, cut, angle, shift):
    """By the trapezoid rule with steps below the Gaussian's width, exact but for rounding; of the
    Gaussians at the ends of the interval 8 widths are in it."""
    curve = circular_arc(radius, cut * radius, N, center=(shift, -shift), angle=0.7)
    length = float(curve.weights.sum())
    along = shift * (np.cos(angle) - np.sin(angle))
    width = 0.015 * radius
    offsets = along + (radius + 8 * width) * np.linspace(-1, 1, 360)
    found = np.asarray(transverse_weight(curve, angle, offsets.reshape(24, 15), width=width))
    assert_allclose(found.sum() * (offsets[1] - offsets[0]), length, rtol=1e-9)


def test_a_straight_array_and_its_ends():
    """The normal distribution at both ends, over cos alpha, but for the sum over detectors: that
    is off by h²/24 of the Gaussian's slope at the ends, which is at most 0.242/eps²: 1.8e-5."""
    x = np.linspace(-1, 1, N)
    h, eps = x[1] - x[0], 0.06
    arrays = np.stack([x, 0 * x], axis=1), np.full(N, h), np.zeros((N, 2))
    curve, ends = SampledCurve(*jax.device_put(arrays), False), 1 + h / 2
    cosine, s = np.cos(ANGLES[:9, None]), np.linspace(-1.3, 1.3, 15)
    angles = np.resize(ANGLES[:9], 24)[:, None]  # not those along the array
    exact = norm.cdf((ends * cosine - s) / eps) - norm.cdf((-ends * cosine - s) / eps)
    found = transverse_weight(curve, angles, s, width=eps)
    assert_allclose(found[:9], exact / cosine, atol=2e-5)


def test_it_asks_for_no_order_and_no_normals():
    arc = circular_arc(1.3, 0.4, N)
    shuffled = np.random.default_rng(0).permutation(N)
    points, weights = np.asarray(arc.points)[shuffled], np.asarray(arc.weights)[shuffled]
    other = SampledCurve(*jax.device_put((points, weights, 0 * points)), False)
    lines = ANGLES[:, None], np.linspace(-1.3, 1.3, 15)
    assert_allclose(transverse_weight(other, *lines), transverse_weight(arc, *lines), atol=1e-12)


@pytest.mark.parametrize("sparse", [N // 2, N // 16])
def test_lines_across_two_arcs_of_different_density(sparse):
    """Each is met at normal incidence, 1 + eps²/(2 R²) as above, however sparse one of them is.

    eps is three times the steps of most detectors, and at least 1.5 times those of the arc.
    """
    arcs = circular_arc(1.3, -0.4, N - sparse), circular_arc(1.3, -0.4, sparse, angle=np.pi)
    across = np.pi / 2 + np.linspace(-0.3, 0.3, 360).reshape(24, 15)
    found = transverse_weight(join_curves(*arcs), across, 0.0)
    dense, own = (float(arc.weights[0]) / 1.3 for arc in arcs)
    eps = np.array([3 * dense, max(3 * dense, 1.5 * own)])
    assert_allclose(found, 2 + np.sum(eps**2) / 2, atol=3 * np.sum(eps**4))


def test_uneven_steps_do_not_show():
    """Steps between a half and one and a half, on a line: 1 but for the sum over detectors."""
    x = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, N))
    curve = detector_curve(np.stack([x, 0 * x], axis=1), closed=False)
    found = transverse_weight(curve, 0.0, np.linspace(20, 700, 360).reshape(24, 15))
    assert_allclose(found, 1, atol=0.01)


def test_the_width_is_taken():
    """One detector alone is the Gaussian itself."""
    points = np.tile([0.3, 0.4], (N, 1))
    one = SampledCurve(*jax.device_put((points, 2.0 * (np.arange(N) == 7), points)), False)
    s = np.broadcast_to(np.linspace(0.3, 0.7, 15), (24, 15))
    found = transverse_weight(one, np.arctan2(0.4, 0.3), s, width=0.1)
    assert_allclose(found, 2 * norm.pdf((s - 0.5) / 0.1) / 0.1, rtol=1e-12)


def test_derivatives(check_both_modes):
    @jax.jit
    def weight(points, weights, angle, offset, width):
        points, weights = jnp.asarray(points), jnp.asarray(weights)
        curve = SampledCurve(points, weights, jnp.zeros_like(points), False)
        return transverse_weight(curve, angle, offset, width=width)

    arc = circular_arc(1.0, 0.3, 9)
    numbers = (jnp.array(0.4), jnp.array([0.1, 0.8]), jnp.array(0.3))
    check_both_modes(weight, (arc.points, arc.weights, *numbers))

    @jax.jit
    def by_itself(points):  # of a regular array, where all arc lengths are equal
        return transverse_weight(detector_curve(points, closed=False), 0.4, numbers[1])

    # the differences themselves are off by the square of eps: 2e-7 at 1e-4
    check_both_modes(by_itself, (arc.points,), step=2e-5, rtol=1e-7, atol=1e-7)


def test_a_new_geometry_is_no_new_program():
    counted = []

    @jax.jit
    def weight(radius):
        counted.append(1)
        return transverse_weight(circular_arc(radius, 0.3, 9), 0.4, 0.1)

    assert weight(1.3) != weight(1.2)
    assert len(counted) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"offsets": np.zeros(5)}, r"angles has shape \(24,\) and offsets \(5,\)"),
        ({"offsets": np.nan}, "NaN"),
        ({"angles": 1j}, "complex"),
        ({"width": 0.0}, "width is 0.0, expected a value above zero"),
        ({"width": np.ones(2)}, r"width has shape \(2,\)"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    given = {"angles": ANGLES, "offsets": 0.0} | change
    with pytest.raises(ValueError, match=message):
        transverse_weight(circular_arc(1.3, 0.3, 9), **given)
