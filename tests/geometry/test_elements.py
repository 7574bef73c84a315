"""Elements of finite size: where their nodes are, means over them, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxtat import circular_arc, detector_curve, elliptic_arc, polyline
from jaxtat.geometry import CircularArc, join_curves, keep_detectors, parametric_curve, turned_views
from jaxtat.geometry.elements import MOST_NODES, element_factor, enough_nodes, gauss_rule

PLACE = {"center": (0.3, -0.2), "angle": 0.7}
ORDERS = np.arange(60)
factor_of = jax.jit(element_factor)


def mean_by_midpoints(function, half):
    """∫ function(s) ds / 2 half over |s| < half, by brute force."""
    s = half * ((np.arange(200_000) + 0.5) / 100_000 - 1)
    return np.mean(function(s))


@pytest.mark.parametrize("m", [0, 1, 17, 59])
def test_factor_is_the_mean_of_a_wave_over_the_element(m):
    angle = 0.13
    wanted = mean_by_midpoints(lambda s: np.cos(m * (0.4 + s)), angle / 2) / np.cos(m * 0.4)
    assert_allclose(np.asarray(factor_of(ORDERS, angle))[m], wanted, rtol=1e-8)


@pytest.mark.parametrize("width", [0.0, 0.15, np.linspace(0.0, 0.15, 6)])
def test_nodes_on_an_arc_average_as_the_factor_does(width):
    arc = circular_arc(1.3, 0.4, 6, **PLACE, element_width=width)
    points, weights = map(np.asarray, arc.element_nodes(12))
    local = points - np.asarray(arc.center)
    assert_allclose(np.hypot(*local.T), 1.3, rtol=1e-14)
    theta = np.asarray(arc.angle) + np.pi + np.asarray(arc.angles)
    mean = np.exp(1j * ORDERS[:, None, None] * np.arctan2(local[..., 1], local[..., 0])) @ weights
    assert arc.element_angle is not None
    factor = factor_of(ORDERS, np.reshape(arc.element_angle, (-1,)))
    assert_allclose(mean, factor * np.exp(1j * ORDERS[:, None] * theta), atol=1e-12)


def test_elements_of_other_curves_are_straight_along_the_tangent():
    curve = elliptic_arc((1.6, 1.2), 9, stop=4.0, element_width=0.2, **PLACE)
    points, weights = map(np.asarray, curve.element_nodes(5))
    offset = points - np.asarray(curve.points)[:, None]
    assert_allclose(np.einsum("kni,ki->kn", offset, curve.normals), 0.0, atol=1e-15)
    assert_allclose(
        np.linalg.norm(offset, axis=-1), 0.1 * np.abs(gauss_rule(5)[0])[None] * np.ones((9, 1))
    )
    assert_allclose(weights.sum(), 1.0, rtol=1e-15)


def test_point_detectors_are_their_own_nodes():
    curve = circular_arc(1.3, 0.4, 6)
    points, weights = curve.element_nodes()
    assert np.array_equal(points, curve.points[:, None]) and weights.tolist() == [1.0]
    assert curve.mean_over_elements(lambda z: z) is not None
    assert np.array_equal(curve.mean_over_elements(jnp.sin), jnp.sin(curve.points))


def test_mean_over_elements_is_the_mean():
    curve = circular_arc(1.3, 0.4, 6, element_width=0.3)
    found = curve.mean_over_elements(lambda z: jnp.exp(z[:, 0] * z[:, 1]))
    theta = np.asarray(np.pi + curve.angles)[:, None]
    theta = theta + 0.15 / 1.3 * ((np.arange(100_000) + 0.5) / 50_000 - 1)
    wanted = np.exp(1.69 * np.cos(theta) * np.sin(theta)).mean(axis=1)
    assert_allclose(found, wanted, rtol=1e-9)


def test_mean_over_elements_has_derivatives_in_the_width_also_at_zero():
    @jax.jit
    def mean(width):
        arc = circular_arc(1.3, 0.4, 4, element_width=width)
        nodes = arc.mean_over_elements(lambda z: z[:, 0] ** 3)
        return jnp.sum(nodes + element_factor(jnp.arange(1, 5), arc.element_angle))

    step = 1e-4
    wanted = (float(mean(0.2 + step)) - float(mean(0.2 - step))) / (2 * step)
    both = jax.jit(lambda width: (jax.jacfwd(mean)(width), jax.jacrev(mean)(width)))
    assert_allclose(both(0.2), [wanted, wanted], atol=1e-8)
    assert np.abs(both(0.0)).max() < 1e-16  # even in the width


@pytest.mark.parametrize("waves", [0.3, 3.0, 9.0, 20.0])
def test_enough_nodes_are_enough_and_half_of_them_are_not(waves):
    n = enough_nodes(2.0, waves)
    s = np.linspace(0, waves, 50)[:, None]
    exact = np.sinc(s[:, 0] / np.pi)

    def error(n):
        nodes, weights = gauss_rule(n)
        return np.abs(np.cos(s * nodes) @ weights - exact).max()

    assert error(n) < 5e-6
    assert waves < 1 or error(n // 2) > 5e-6


def test_widths_stay_with_their_detectors():
    widths = np.linspace(0.01, 0.05, 12)
    arc = circular_arc(1.3, 0.4, 12, element_width=widths)
    keep = np.arange(12) != 4
    assert np.array_equal(keep_detectors(arc, keep).element_width, widths[keep])
    assert np.array_equal(turned_views(arc, [0.0, 1.0]).element_width, np.tile(widths, 2))
    alike = circular_arc(1.3, 0.4, 12, element_width=0.02)
    assert keep_detectors(alike, keep).element_width == 0.02
    assert turned_views(alike, [0.0, 1.0]).element_width == 0.02
    left, right = (circular_arc(1.3, -0.3, 5, angle=a) for a in (0.0, np.pi))
    assert join_curves(left, right).element_width is None
    wide = circular_arc(1.3, -0.3, 5, angle=np.pi, element_width=0.1)
    assert join_curves(left, wide).element_width.tolist() == [0.0] * 5 + [0.1] * 5


def makers():
    theta = np.linspace(0.5, 3.0, 12)
    circle = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    return {
        "arc": lambda width: circular_arc(1.3, 0.4, 12, element_width=width),
        "measured": lambda width: detector_curve(circle, element_width=width),
        "weighted": lambda w: detector_curve(circle, weights=[2.5 / 11] * 12, element_width=w),
        "ellipse": lambda width: elliptic_arc((1.6, 1.2), 12, stop=3.0, element_width=width),
        "line": lambda width: polyline([(0, 0), (2, 0), (2, 1)], 12, element_width=width),
        "spiral": lambda width: parametric_curve(
            lambda t: t * jnp.array([jnp.cos(t), jnp.sin(t)]), 1.0, 3.0, 12, element_width=width
        ),
    }


@pytest.mark.parametrize("make", makers().values(), ids=makers())
def test_every_curve_takes_widths_and_refuses_what_cannot_be(make):
    assert make(None).element_width is None
    assert make(0.1).element_width == 0.1
    assert make(np.full(12, 0.1)).element_width.shape == (12,)
    with pytest.raises(ValueError, match=r"element_width is -0.1, expected a length, 0 or above"):
        make(-0.1)
    with pytest.raises(ValueError, match=r"element_width is nan"):
        make(np.nan)
    with pytest.raises(ValueError, match=r"shape \(11,\), expected one number, or .* 12 detectors"):
        make(np.full(11, 0.1))
    with pytest.raises(ValueError, match=r"element_width is 400, longer than the whole curve"):
        make(400.0)


def test_elements_of_too_many_wavelengths_are_refused():
    assert enough_nodes(None, 1e9) == 1
    assert enough_nodes(1.0, 3.0 * (MOST_NODES - 4)) == MOST_NODES
    with pytest.raises(ValueError, match=r"elements of 1 are 47.7 wavelengths wide .* max_freq"):
        enough_nodes(1.0, 300.0)


def test_a_traced_width_keeps_the_arc():
    found = jax.jit(lambda w: circular_arc(1.3, 0.4, 12, element_width=w))(0.1)
    assert isinstance(found, CircularArc) and found.element_width == 0.1
