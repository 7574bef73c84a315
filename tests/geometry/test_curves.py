"""Acquisition curves against exact arcs, in any position, order and spacing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat import circular_arc, detector_curve
from jaxtat.geometry import SampledCurve, fit_circle, keep_detectors, near_circle, turned_views
from jaxtat.geometry.measured_curves import behind_gap

unit = st.floats(-3.0, 3.0)


def points_on_arc(radius, center, angles):
    return np.asarray(center) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


@given(
    st.floats(0.01, 50.0), st.floats(-0.95, 0.99), st.sampled_from([3, 17, 60]), unit, unit, unit
)
@settings(deadline=None, max_examples=40)
def test_arc_lies_on_its_circle_and_opens_where_it_should(radius, cut, n, c1, c2, angle):
    curve = circular_arc(radius, cut * radius, n, center=(c1, c2), angle=angle)
    local = np.asarray(curve.points) - np.array([c1, c2])
    assert np.allclose(np.linalg.norm(local, axis=1), radius, rtol=1e-9)
    assert np.allclose(local, radius * np.asarray(curve.normals), atol=1e-9 * (radius + 5))
    assert np.all(local @ [np.cos(angle), np.sin(angle)] < cut * radius + 1e-9 * radius)
    assert np.isclose(curve.weights.sum(), radius * 2 * (np.pi - np.arccos(cut)), rtol=1e-12)


def test_full_circle_is_closed_and_whole():
    curve = circular_arc(1.3, 1.3, 100)
    assert curve.closed
    assert np.isclose(curve.weights.sum(), 2 * np.pi * 1.3, rtol=1e-14)
    assert not circular_arc(1.3, 1.29, 100).closed


@given(
    st.floats(0.01, 50.0),
    st.sampled_from([12, 25, 60]),
    st.floats(0.2, 5.0),
    unit,
    unit,
    st.randoms(),
)
@settings(deadline=None, max_examples=40)
def test_measured_positions_at_any_spacing_give_exact_weights_and_normals(
    radius, n, span, c1, c2, random
):
    steps = np.array([random.uniform(0.5, 1.5) for _ in range(n - 1)])
    angles = random.uniform(0, 6) + np.concatenate([[0], np.cumsum(steps) / steps.sum() * span])
    points = points_on_arc(radius, (c1, c2), angles)
    curve = detector_curve(points, closed=False)
    gaps = radius * np.diff(angles)
    halves = (np.append(gaps[0], gaps) + np.append(gaps, gaps[-1])) / 2
    assert np.allclose(curve.weights, halves, rtol=1e-9)
    outward = points_on_arc(1.0, (0, 0), angles)
    assert np.allclose(curve.normals, outward, atol=1e-9)


@pytest.mark.parametrize("cut", [-0.5, 0.0, 1.0, 1.3])
def test_positions_of_an_arc_give_the_arc_back(cut):
    arc = circular_arc(1.3, cut, 256, center=(0.4, -2.0), angle=2.2)
    measured = detector_curve(arc.points)
    assert measured.closed == arc.closed
    assert np.allclose(measured.weights, arc.weights, rtol=1e-9)
    assert np.allclose(measured.normals, arc.normals, atol=1e-9)


def test_clockwise_order_gives_the_same_curve_backwards():
    arc = circular_arc(1.3, 0.5, 64)
    backwards = detector_curve(arc.points[::-1])
    assert np.allclose(backwards.weights, arc.weights, rtol=1e-9)
    assert np.allclose(backwards.normals, arc.normals[::-1], atol=1e-9)


def test_constants_stay_known_inside_jit():
    jitted = jax.jit(lambda angle: circular_arc(1.3, 2.0, 8, angle=angle).points)
    assert np.allclose(jitted(0.1), circular_arc(1.3, 2.0, 8, angle=0.1).points)
    traced = jax.jit(lambda radius: circular_arc(radius, 2.0, 8).points)
    assert np.allclose(traced(1.3), circular_arc(1.3, 2.0, 8).points)


def test_coarse_and_broken_arcs_are_in_order():
    for right, n in ((1.3, 3), (0.0, 4), (0.0, 3)):
        points = circular_arc(1.3, right, n).points
        assert detector_curve(points, closed=right == 1.3).n_detectors == n
    angles = np.radians(np.r_[30:150:1.0, 185:330:1.0])
    assert not detector_curve(points_on_arc(1.3, (0, 0), angles)).closed


def test_collinear_points_have_no_circle():
    with pytest.raises(ValueError, match="straight line"):
        fit_circle(np.stack([np.linspace(0, 1, 9), np.zeros(9)], axis=1))


def known(points):
    arrays = points, np.ones(len(points)), points
    return SampledCurve(*jax.device_put(arrays), False)


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_what_counts_as_on_a_circle(turn):
    """Five per cent of the radius, or of the height of a shallow arc."""
    scatter = np.random.default_rng(0).uniform(-1, 1, 100)
    for size in (1e-4, 1e-3, 1e-2):  # a line, with jitter
        line = np.linspace(-2, 2, 100) + 1j * size * scatter
        line = line * np.exp(1j * turn)
        assert not near_circle(known(np.stack([line.real, line.imag], axis=1)))
    middle = turn + np.linspace(-1, 1, 100) * np.radians(10)
    height = 5 * (1 - np.cos(np.radians(10)))
    for off, circle in ((0.0, True), (0.02, True), (0.5, False)):
        radius = (5 + off * height * scatter)[:, None]
        assert near_circle(known(points_on_arc(radius, (1, 2), middle))) == circle
    ring = 2 * np.pi * np.arange(100) / 100
    for off, circle in ((0.04, True), (0.07, False)):
        radius = (1 + off * np.cos(5 * ring))[:, None]
        assert near_circle(known(points_on_arc(radius, (1, 2), ring))) == circle


def test_a_gap_is_one_by_the_steps_beside_it():
    def gaps(*steps, closed=False):
        return np.flatnonzero(behind_gap(np.array(steps, float), closed)).tolist()

    ones = [1.0] * 5
    assert gaps(*ones, 4, *ones) == [10] and gaps(*ones, 5, *ones) == [5, 10]
    assert gaps(*ones, 5, *ones, closed=True) == [5] and gaps(*ones, 5, closed=True) == [5]
    assert gaps(*ones, 9, 9, *ones) == [5, 6, 11], "one detector alone"
    assert gaps(9, *ones, 1) == [0, 6], "the first detector alone"
    assert gaps(*ones, 5.5, 10, 10, 10, 1) == [9], "another density"
    assert gaps(*ones, 30, 10, 10, 10, 1) == [9] and gaps(*ones, 50, 10, 10, 10, 1) == [5, 9]
    assert gaps(1, 9) == [1] and gaps(1, 1, 9) == [2]


def test_a_detector_alone_between_gaps_owns_what_others_own():
    ring = circular_arc(1.0, 1.0, 60)
    missing = [20, 21, 22, 23, 24, 26, 27, 28, 29, 30]
    found = keep_detectors(ring, ~np.isin(np.arange(60), missing))
    np.testing.assert_allclose(found.weights, 2 * np.pi / 60, rtol=1e-12)


def test_straight_array_has_straight_weights():
    x = np.linspace(-1, 1, 21)
    curve = detector_curve(np.stack([x, np.zeros(21)], axis=1))
    assert np.allclose(curve.weights, 0.1, rtol=1e-12)
    assert np.allclose(np.abs(np.asarray(curve.normals)), [0, 1], atol=1e-12)


def test_ellipse_weights_converge_with_fourth_order():
    from scipy.special import ellipe

    def length_error(n):
        t = 2 * np.pi * np.arange(n) / n
        curve = detector_curve(np.stack([1.5 * np.cos(t), np.sin(t)], axis=1))
        return abs(float(curve.weights.sum()) - 4 * 1.5 * ellipe(1 - 1 / 1.5**2))

    assert length_error(40) < 2e-4
    assert length_error(80) < length_error(40) / 12


def test_planar_arrays_may_come_with_a_constant_third_coordinate():
    arc = np.asarray(circular_arc(1.3, 0.5, 64).points)
    for axis in range(3):
        spatial = np.insert(arc, axis, 0.7, axis=1)
        assert np.allclose(detector_curve(spatial).points, arc)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p[[0, 2, 1, *range(3, 64)]], "not in order: the curve turns back"),
        (lambda p: np.roll(p, 20, axis=0), "widest opening lies between detectors 19 and 20"),
        (lambda p: p[np.random.default_rng(0).permutation(64)], "not in order"),
        (lambda p: p[[0, 0, *range(1, 64)]], "detectors 0 and 1 are at the same position"),
        (lambda p: p[:1], "got 1 detector"),
        (lambda p: p[:, :1], "shape"),
        (lambda p: np.where(p > 1.2, np.nan, p), "NaN or infinite"),
        (lambda p: p + 0j, "complex"),
        (lambda p: np.insert(p, 2, p[:, 0] * p[:, 1], axis=1), "do not lie in a coordinate plane"),
    ],
)
def test_bad_positions_are_refused(change, message):
    points = np.asarray(circular_arc(1.3, 0.5, 64).points)
    with pytest.raises(ValueError, match=message):
        detector_curve(change(points))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1.3, 0.0, 1), "got 1 detector"),
        ((-1.3, 0.0, 10), "radius is -1.3"),
        ((1.3, -1.4, 10), "is empty"),
        ((np.nan, 0.0, 10), "NaN"),
        (("wide", 0.0, 10), "no array of real numbers"),
    ],
)
def test_bad_arcs_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        circular_arc(*arguments)


@given(st.floats(0.1, 50.0), unit, unit, st.floats(0.5, 6.2), st.floats(0.0, 6.2))
@settings(deadline=None, max_examples=30)
def test_fit_circle_finds_the_circle_of_an_arc(radius, c1, c2, span, start):
    points = points_on_arc(radius, (c1, c2), start + np.linspace(0, span, 50))
    circle = fit_circle(points)
    assert np.allclose(circle.radius, radius, rtol=1e-7)
    assert np.allclose(circle.center, [c1, c2], atol=1e-7 * radius)


def test_derivatives_of_curves(check_both_modes):
    arc = circular_arc(1.3, 0.5, 12)

    def arc_fields(radius, cut, center, angle):
        curve = circular_arc(radius, cut, 12, center=center, angle=angle)
        return curve.points, curve.weights, curve.normals

    def measured_fields(points):
        curve = detector_curve(points, closed=False)
        return curve.weights, curve.normals, fit_circle(points).radius

    arguments = (jnp.array(1.3), jnp.array(0.4), jnp.array([0.2, 0.1]), jnp.array(0.3))
    check_both_modes(arc_fields, arguments, rtol=1e-6)
    check_both_modes(measured_fields, (arc.points,), rtol=1e-6)


def test_straight_arrays_have_finite_derivatives():
    points = np.stack([np.linspace(-1, 1, 9), np.zeros(9)], axis=1)
    assert np.isfinite(detector_curve(points, closed=False).normals).all()
    gradient = jax.jit(jax.grad(lambda p: detector_curve(p, closed=False).weights.sum()))(points)
    assert np.isfinite(gradient).all()


def test_traced_positions_need_to_be_told_whether_closed():
    with pytest.raises(ValueError, match="closed must be given"):
        jax.jit(lambda p: detector_curve(p).weights)(circular_arc(1.3, 0.5, 12).points)


def test_turned_views_are_the_array_turned_about_the_origin():
    arc = circular_arc(1.3, 0.4, 7, center=(0.1, -0.2), angle=0.3)
    turns = np.array([0.0, 0.7, 2 * np.pi])
    views = turned_views(arc, turns)
    assert views.n_detectors == 21
    for part, turn in enumerate(turns):
        own = slice(7 * part, 7 * part + 7)
        phase = np.exp(1j * turn)
        for found, array in ((views.points, arc.points), (views.normals, arc.normals)):
            turned = (np.asarray(array) @ [1, 1j]) * phase
            assert np.allclose(np.asarray(found)[own] @ [1, 1j], turned, atol=1e-14)
    # two of the views are the same place, and together count as one there
    assert np.allclose(views.weights, np.tile(np.asarray(arc.weights) / 3, 3))
    with pytest.raises(ValueError, match="number of views"):
        turned_views(arc, np.zeros(0))


def test_derivatives_of_turned_views(check_both_modes):
    def fields(center, turns):
        views = turned_views(circular_arc(1.3, 0.4, 5, center=center), turns)
        return views.points, views.normals, views.weights

    check_both_modes(fields, (jnp.array([0.1, 0.2]), jnp.array([0.3, 1.0])), order=2)


def test_detectors_left_out_share_their_arc_with_those_beside_them():
    curve = circular_arc(1.3, 1.0, 40)
    step = float(curve.weights[0])
    keep = ~np.isin(np.arange(40), [0, 7, 20, 21, 22])
    found = keep_detectors(curve, keep)
    expected = np.ones(40)
    expected[[6, 8]] = 1.5
    expected[[19, 23]] = 2.5  # three missing are shared
    assert np.allclose(found.weights, step * expected[keep], rtol=1e-12)
    assert np.array_equal(found.points, np.asarray(curve.points)[keep])
    assert np.allclose(found.normals, np.asarray(curve.normals)[keep], atol=1e-12)
    # the first was left out: the arc is shorter
    assert abs(float(found.weights.sum()) - 39 * step) < 1e-12


def test_a_wide_opening_among_detectors_is_nobodys():
    theta = 2 * np.pi * np.arange(60) / 60
    ring = detector_curve(np.stack([np.cos(theta), np.sin(theta)], axis=1))
    assert ring.closed
    keep = ~np.isin(np.arange(60), [30, 31, 32, 33])
    found = keep_detectors(ring, keep)
    assert np.allclose(found.weights, 2 * np.pi / 60, rtol=1e-12)
    across = keep_detectors(ring, ~np.isin(np.arange(60), [0, 59]))  # over the seam
    assert abs(float(across.weights.sum()) - 2 * np.pi) < 1e-12


@pytest.mark.parametrize(
    ("keep", "message"),
    [
        (np.ones(39, bool), r"expected booleans \(40,\)"),
        (np.ones(40), "dtype float64"),
        (np.arange(40) < 2, r"got 2 detector\(s\)"),
    ],
)
def test_masks_that_do_not_fit_are_refused(keep, message):
    with pytest.raises(ValueError, match=message):
        keep_detectors(circular_arc(1.3, 1.0, 40), keep)


def test_a_traced_mask_is_refused():
    curve = circular_arc(1.3, 1.0, 40)
    with pytest.raises(ValueError, match="keep is traced"):
        jax.jit(lambda keep: keep_detectors(curve, keep).weights)(np.ones(40, bool))
