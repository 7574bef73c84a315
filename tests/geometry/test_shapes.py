"""Curves from formulas and from points in pieces: lengths, positions, normals, and refusals."""

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from scipy.special import ellipe, ellipeinc

from jaxtat import circular_arc, detector_curve, disk, elliptic_arc, polygon, polyline
from jaxtat.geometry import join_curves, parametric_curve, union_of_regions, visibility
from jaxtat.geometry.seen_lines import connected_pieces

N = 60


def test_an_ellipse_is_cut_into_equal_lengths():
    """Against elliptic integrals: from the end of the first axis, E(t) with the second inside."""
    a, b = 1.6, 1.25
    curve = elliptic_arc((a, b), N, start=np.pi / 2, stop=3 * np.pi / 2)
    quarter = a * ellipe(1 - b**2 / a**2)
    assert np.isclose(curve.weights.sum(), 2 * quarter, rtol=1e-6)
    t = np.arctan2(curve.points[:, 1] / b, curve.points[:, 0] / a) % (2 * np.pi)
    # length from t = π/2, where x_1 = 0: a E(t - π/2 | m)
    length = a * ellipeinc(t - np.pi / 2, 1 - b**2 / a**2)
    np.testing.assert_allclose(length, (np.arange(N) + 0.5) * 2 * quarter / N, atol=1e-5)
    gradient = np.asarray(curve.points) / np.array([a, b]) ** 2
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(curve.normals, gradient, atol=1e-12)


def test_a_circle_is_an_ellipse_and_a_parametric_curve():
    arc = circular_arc(1.3, -1.3 * np.cos(1.0), N, center=(0.2, -0.1))
    ellipse = elliptic_arc((1.3, 1.3), N, start=np.pi - 1, stop=np.pi + 1, center=(0.2, -0.1))

    def position(t):
        return 1.3 * jnp.stack([jnp.cos(t), jnp.sin(t)]) + jnp.array([0.2, -0.1])

    found = parametric_curve(position, np.pi + 1, np.pi - 1, N)  # backwards
    for name in ("points", "weights", "normals"):
        wanted = np.asarray(getattr(arc, name))
        np.testing.assert_allclose(getattr(ellipse, name), wanted, atol=1e-9)
        np.testing.assert_allclose(getattr(found, name), wanted[::-1], atol=1e-9)
    assert elliptic_arc((1.3, 1.3), N).closed and not ellipse.closed


def test_a_polyline_keeps_clear_of_its_corners():
    """Weights of each side add up to its length, exactly."""
    corners = [(1.2, 1.2), (-1.2, 1.2), (-1.2, -1.0), (0.8, -1.0)]
    curve = polyline(corners, N)
    counts = [round(N * length / 6.6) for length in (2.4, 2.2, 2.0)]
    assert sum(counts) == N == curve.n_detectors
    sides = np.split(np.asarray(curve.weights), np.cumsum(counts)[:-1])
    np.testing.assert_allclose([side.sum() for side in sides], [2.4, 2.2, 2.0], rtol=1e-12)
    np.testing.assert_allclose(curve.normals[0], [0, 1], atol=1e-12)
    np.testing.assert_allclose(curve.normals[-1], [0, -1], atol=1e-12)
    ring = polyline(corners, (6, 5, 4, 7), closed=True)
    assert ring.closed and ring.n_detectors == 22
    assert np.isclose(ring.weights.sum(), 6.6 + np.hypot(0.4, 2.2))


def test_separate_pieces_from_points():
    """Two arcs one after the other, in one array: nobody stands for the gaps between them."""
    arcs = [circular_arc(1.3, -0.3364, N // 2, angle=angle) for angle in (0.0, np.pi)]
    both = join_curves(*arcs)
    assert not both.closed
    found = detector_curve(both.points)
    np.testing.assert_allclose(found.weights, both.weights, rtol=1e-9)
    # an L whose corner is no gap, measured: the pieces have to be told
    corner = polyline([(-0.8, 1.2), (-0.8, -0.8), (1.2, -0.8)], N)
    told = detector_curve(corner.points, pieces=(N // 2, N // 2))
    np.testing.assert_allclose(told.weights, corner.weights, rtol=1e-12)
    np.testing.assert_allclose(told.normals, corner.normals, atol=1e-12)
    taken_as_one = detector_curve(corner.points)
    assert np.abs(taken_as_one.weights / corner.weights - 1).max() > 0.05  # at the corner
    assert np.isclose(taken_as_one.weights.sum(), 4.0, rtol=1e-2)


def test_normals_of_several_pieces_point_away_from_the_middle_of_all():
    """Of an L in any place and either sense: a straight piece alone has no inner side."""
    for vertices in ([(0.3, 1.7), (0.3, 0.1), (1.9, 0.1)], [(0.3, 0.1), (0.3, 1.7), (1.9, 1.7)]):
        corner = polyline(vertices, N)
        told = detector_curve(corner.points, pieces=(N // 2, N // 2))
        first, second = polyline(vertices[:2], N // 2), polyline(vertices[:0:-1], N // 2)
        inner = np.sum(corner.normals * (np.asarray(corner.points) - 0.9), axis=1)
        assert inner.min() > 0
        np.testing.assert_allclose(told.normals, corner.normals, atol=1e-12)
        joined = join_curves(first, second).normals
        np.testing.assert_allclose(joined, corner.normals, atol=1e-12)


def test_densities_may_differ_from_piece_to_piece():
    """No gap opens where they change, also of a ring whose first detectors are the dense ones."""
    ring = polyline([(-1, -1), (1, -1), (1, 1), (-1, 1)], (90, 10, 10, 10), closed=True)
    assert detector_curve(ring.points, closed=True).closed
    assert len(connected_pieces(ring)) == 1
    assert np.isclose(detector_curve(ring.points, closed=True).weights.sum(), 8, rtol=0.03)
    arcs = circular_arc(1.3, -0.3364, 160), circular_arc(1.3, -0.3364, 30, angle=np.pi)
    assert [len(piece) - 2 for piece in connected_pieces(join_curves(*arcs))] == [160, 30]
    found = detector_curve(join_curves(*arcs).points, closed=False)
    np.testing.assert_allclose(found.weights, join_curves(*arcs).weights, rtol=1e-9)
    region = disk(0.3, n_boundary=200)
    dense = join_curves(arcs[0], circular_arc(1.3, -0.3364, 160, angle=np.pi))
    seen = [float(visibility(c, region).invisible_fraction) for c in (join_curves(*arcs), dense)]
    assert seen[1] > 0.01
    np.testing.assert_allclose(*seen, atol=2e-3)


def test_scattered_positions_get_the_weights_of_the_curve_they_scatter_about():
    arc = circular_arc(1.3, 0.0, 200)
    off = 1 + 0.01 * np.random.default_rng(0).standard_normal(200)  # 0.6 of their spacing
    points = np.asarray(arc.points) * off[:, None]
    with pytest.raises(ValueError, match=r"turns back at .* smooth=5"):
        detector_curve(points * off[:, None] ** 3, closed=False)
    curve = detector_curve(points, closed=False, smooth=14)
    np.testing.assert_array_equal(curve.points, points)
    assert np.isclose(curve.weights.sum(), 1.3 * np.pi, rtol=0.01)
    assert np.abs(curve.weights / arc.weights - 1)[10:-10].max() < 0.05
    assert np.sum(curve.normals * arc.normals, axis=1).min() > 0.99
    exact = detector_curve(arc.points, smooth=4)  # parabolas bend nearly as the circle does
    np.testing.assert_allclose(exact.weights, arc.weights, rtol=2e-3)


def test_given_weights_are_checked_against_the_order():
    arc = circular_arc(1.3, 0.0, N)
    weights = np.asarray(arc.weights) * np.linspace(0.98, 1.02, N)
    np.testing.assert_array_equal(detector_curve(arc.points, weights=weights).weights, weights)
    with pytest.raises(ValueError, match=r"add up to 40.8407, but .* is 4.08407 long"):
        detector_curve(arc.points, weights=10 * weights)


def test_a_position_may_be_a_pair():
    found = parametric_curve(lambda t: (jnp.cos(t), jnp.sin(t)), 0.0, 1.0, N)
    angles = (np.arange(N) + 0.5) / N
    np.testing.assert_allclose(
        found.points, np.stack([np.cos(angles), np.sin(angles)], 1), atol=1e-9
    )


def circle(t):
    return jnp.stack([jnp.cos(t), jnp.sin(t)])


EIGHT = 1.2 * np.stack([np.sin(t := np.linspace(0.5, 6.5, N)), np.sin(2 * t)], axis=1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: detector_curve(EIGHT, closed=False), "the curve crosses itself: behind detectors"),
        (lambda: polyline([(0, 0), (1, 1), (1, 0), (0, 1)], 21), "crosses itself"),
        (lambda: join_curves(polyline([(-1, 0), (1, 0)], 9), polyline([(0, -1), (0, 1)], 8)),
         "crosses itself"),
        (lambda: polyline([(0, 0), (1, 0)], 10, closed=True), "detectors 0 and 9 are at the same"),
        (lambda: polyline([(0, 0), (1, 0)], (5, 6), closed=True), "crosses itself"),
        (lambda: polyline([(0, 0), (1, 0), (0.3, 0)], 10), "crosses itself"),
        (lambda: polyline([(0, 0), (1, 1), (0.3, 0.3)], (6, 4)), "crosses itself"),
        (lambda: join_curves(polyline([(-1, 0), (1, 0)], 9), polyline([(0, -1), (0, 1)], 9)),
         "detectors 4 and 13 are at the same position"),
        (lambda: parametric_curve(circle, 0.0, 4 * np.pi, N, closed=True), "0 and 30 are at"),
        (lambda: parametric_curve(lambda t: jnp.stack([t, t, t]), 0.0, 1.0, N), r"shape \(3,\)"),
        (lambda: join_curves(), "got no curves"),
        (lambda: polyline([(0, 0), (0, 0), (1, 0)], (4, 5)), "same position"),
        (lambda: polyline([(0, 0)], 9), "got 1 vertex"),
        (lambda: polyline([(0, 0), (0, 0), (1, 0)], 9), "same position"),
        (lambda: polyline([(0, 0), (0.01, 0), (1, 1)], 9), "leaves 0 for the shortest"),
        (lambda: polyline([(0, 0), (1, 0)], (4, 5)), "has 2 numbers, expected one for each of 1"),
        (lambda: elliptic_arc((1.0, 0.0), 9), "semi_axes"),
        (lambda: elliptic_arc((1.0, 1.0), 9, stop=7.0), "at most one turn"),
        (lambda: elliptic_arc((1.0, 1.0), 1), "n_detectors is 1"),
        (lambda: detector_curve(EIGHT, pieces=(30, 31)), "makes 61, expected 60"),
        (lambda: detector_curve(EIGHT, pieces=(30, 30), closed=True), "is open"),
        (lambda: detector_curve(EIGHT, smooth=40), "expected less than half of 60"),
    ],
)  # fmt: skip
def test_impossible_curves_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: polyline([(0, 0), (1, 0)], 9.0), "n_detectors is 9.0, expected a whole number"),
        (lambda: polygon([(0, 0), (1, 0), (0, 1)], n_boundary=99.0), "n_boundary is 99.0, expect"),
        (lambda: detector_curve(EIGHT, pieces=10), "pieces is 10, expected one number"),
        (lambda: join_curves([1, 2]), "got a list for a curve: expected each curve as an argument"),
        (lambda: union_of_regions([1, 2]), "got a list for a region"),
    ],
)  # fmt: skip
def test_arguments_of_another_kind_are_refused_for_those_who_check_no_types(
    make, message, monkeypatch
):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(ValueError, match=message):
        make()


def test_a_number_of_detectors_may_be_an_array(monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    assert polyline([(0, 0), (1, 0)], jax.device_put(9)).n_detectors == 9


def test_derivatives_of_curves_from_formulas(check_both_modes):
    def ellipse(a, b, stop, angle):
        found = elliptic_arc(jnp.stack([a, b]), 5, stop=stop, angle=angle)
        return found.points, found.weights, found.normals

    check_both_modes(ellipse, (1.6, 1.2, 2.5, 0.3))

    def half(start, stop):  # the middle detector lies on a node of the table
        return elliptic_arc((1.6, 1.2), 5, start=start, stop=stop).points

    ends = np.pi / 2, 3 * np.pi / 2
    check_both_modes(half, ends, step=1e-4, rtol=1e-6, atol=1e-6)

    def measured(points):
        found = detector_curve(points, closed=False, smooth=2)
        return found.weights, found.normals

    arc = np.asarray(circular_arc(1.3, 0.0, 8).points)
    check_both_modes(measured, (arc,))
    with pytest.raises(ValueError, match="one number for each piece"):
        jax.jit(lambda v: polyline(v, 9).points)(jnp.ones((3, 2)))
