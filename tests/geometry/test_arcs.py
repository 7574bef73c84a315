"""The arc that detectors lie on, wherever it opens, and their order along it."""

import numpy as np
import pytest

from jaxtat.geometry import detector_curve, fit_arc, order_along_curve

TURNS = pytest.mark.parametrize("turn", [0.0, 37.0, 90.0, 171.0, 180.0, 233.0, 300.0])


def on_arc(degrees, radius=0.04, center=(0.003, -0.001)):
    theta = np.radians(degrees)
    return np.array(center) + radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)


@TURNS
@pytest.mark.parametrize("span", [120.0, 180.0, 270.0, 330.0])
def test_circle_span_and_opening_wherever_the_arc_opens(turn, span):
    points = on_arc(turn + np.linspace(-span / 2, span / 2, 91))
    for those in (points, points[::-1]):  # either way round
        arc = fit_arc(those)
        assert np.allclose(arc.center, (0.003, -0.001), atol=1e-14)
        assert np.isclose(arc.radius, 0.04, rtol=1e-12)
        assert arc.deviation < 1e-14
        assert np.isclose(np.degrees(arc.span), span)
        assert np.isclose(np.degrees(arc.step), span / 90)
        away = (np.degrees(arc.opening) - (turn + 180) + 180) % 360 - 180
        assert abs(away) < 1e-9
        assert np.isclose(arc.chord, -0.04 * np.cos(np.radians(span / 2)), atol=1e-15)
        assert not arc.closed


def test_a_ring_has_no_opening():
    arc = fit_arc(on_arc(np.arange(0.0, 360.0, 3.0)))
    assert arc.closed
    assert np.isinf(arc.chord)
    assert arc.span == 2 * np.pi


def test_detectors_off_the_circle_are_told_by_how_far():
    rng = np.random.default_rng(0)
    points = on_arc(np.linspace(0, 270, 200)) + 1e-4 * rng.standard_normal((200, 2))
    assert 0.8e-4 < fit_arc(points).deviation < 1.2e-4  # one of two directions counts


@TURNS
@pytest.mark.parametrize("kind", ["shuffled", "rolled", "swapped"])
def test_order_along_an_arc(turn, kind):
    rng = np.random.default_rng(int(turn))
    points = on_arc(turn + np.linspace(0.0, 270.0, 64))
    mixed = {
        "shuffled": rng.permutation(64),
        "rolled": np.roll(np.arange(64), 20),
        "swapped": np.r_[1, 0, 2:64],
    }[kind]
    order = order_along_curve(points[mixed])
    assert np.array_equal(mixed[order], np.arange(64))
    detector_curve(points[mixed][order])  # which refuses another order


def test_what_is_in_order_stays_as_it_is():
    arc = on_arc(np.linspace(10.0, 280.0, 50))
    for points in (arc, arc[::-1], np.roll(on_arc(np.arange(0.0, 360.0, 5.0)), 9, axis=0)):
        assert np.array_equal(order_along_curve(points), np.arange(len(points)))
    # an L, which no angle about a centre would sort
    side = np.linspace(0.1, 1.0, 10)
    corner = np.r_[np.stack([side[::-1], 0 * side], 1), np.stack([0 * side, side], 1)]
    assert np.array_equal(order_along_curve(corner), np.arange(20))


def test_a_shuffled_ring_is_sorted_all_the_way_round():
    mixed = np.random.default_rng(3).permutation(72)
    points = on_arc(np.arange(0.0, 360.0, 5.0))[mixed]
    steps = np.diff(mixed[order_along_curve(points)]) % 72
    assert (steps == 1).all()


def test_a_shuffled_part_of_an_ellipse_is_sorted():
    theta = np.radians(np.linspace(-60.0, 240.0, 76))
    mixed = np.random.default_rng(5).permutation(76)
    points = np.stack([45 * np.cos(theta), 38 * np.sin(theta)], axis=1)[mixed]
    assert np.array_equal(mixed[order_along_curve(points)], np.arange(76))


def test_what_cannot_be_sorted_is_refused():
    side = np.linspace(0.1, 1.0, 10)
    corner = np.r_[np.stack([side[::-1], 0 * side], 1), np.stack([0 * side, side], 1)]
    mixed = np.random.default_rng(0).permutation(20)
    with pytest.raises(ValueError, match="not in order"):
        order_along_curve(corner[mixed])
    line = np.stack([mixed.astype(float), 0 * mixed], axis=1)
    with pytest.raises(ValueError, match="not in order"):
        order_along_curve(line)
    twice = on_arc(np.r_[0.0, 50.0, 10.0, 50.0, 80.0, 120.0])
    with pytest.raises(ValueError, match="same position"):
        order_along_curve(twice)
