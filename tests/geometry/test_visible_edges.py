"""Which edges are seen: the angle under which an arc appears, brute force, convergence."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from jaxtat import ImageGrid, circular_arc, detector_curve, polyline
from jaxtat.geometry import VISIBLE, SampledCurve, edge_weight, join_curves, visible_disk
from jaxtat.geometry.seen_lines import connected_pieces
from jaxtat.geometry.visible_edges import visibility_map

N_ANGLES = 360
ANGLES = np.arange(360) * np.pi / 360
GRID = ImageGrid((9, 7), (0.26, 0.18), (0.6, -0.1))  # no pixel nearer than 0.55 to an end


def directions_seen(points, radius, right, level, eps):
    """Share of the lines through points in |x| < radius that meet the arc z_1 < right.

    A line through x meets a connected curve if and only if it lies in the angle under which the
    curve appears from x. This arc appears, on its own side, under the angle between its ends. That
    is exact, and what W >= level sees differs to first order in eps: near an end W is
    Φ(u)/cos alpha at the distance u eps of the line from the end, which moves the limit by
    u eps / |x - end|.
    """
    half = np.arccos(right / radius)
    ends = radius * np.array([[np.cos(half), np.sin(half)], [np.cos(half), -np.sin(half)]])
    towards = ends - points[..., None, :]  # upper, lower
    distance = np.linalg.norm(towards, axis=-1)
    theta = np.arctan2(towards[..., 1], towards[..., 0])
    appears = (theta[..., 1] - theta[..., 0]) % (2 * np.pi)  # anticlockwise over the left side
    cosine = np.abs(np.sum(towards * ends, axis=-1)) / (distance * radius)
    moved = appears - np.sum(norm.ppf(level * cosine) * eps / distance, axis=-1)
    return np.minimum(appears, np.pi) / np.pi, moved / np.pi


@pytest.mark.parametrize(("right", "level"), [(0.7, 0.5), (-0.6, VISIBLE)])
def test_map_of_an_arc_is_the_angle_under_which_it_appears(right, level):
    """Each of the two limits may be off by a sample, and by (eps/0.55)² = 3e-3 or less."""
    curve = circular_arc(1.3, right, 400)
    eps = 3 * float(curve.weights[0])
    exact, moved = directions_seen(np.asarray(GRID.points), 1.3, right, level, eps)
    found = np.asarray(visibility_map(curve, GRID, least=level, n_angles=N_ANGLES))
    assert found.shape == (9, 7)
    part = exact < 0.97  # nearer to 1 the limits of both ends meet
    assert part.sum() > 2
    assert_allclose(found[part], moved[part], atol=2 / N_ANGLES + (eps / 0.55) ** 2)
    assert_allclose(found, exact, atol=1.5 * eps)
    assert (found[moved > 1.02] == 1).all()
    if level == VISIBLE and right < 0.5:
        assert np.abs(exact - moved)[part].max() > 5e-3, "the ends count"


def test_a_full_circle_sees_everything_and_far_away_little():
    full = circular_arc(1.3, 1.3, 400)
    assert (np.asarray(visibility_map(full, GRID, n_angles=90)) == 1).all()
    far = ImageGrid((9, 7), 0.1, (5.0, 0.0))  # where a whole circle appears under 2 asin(R/d)
    d, eps = np.linalg.norm(np.asarray(far.points), axis=-1), 3 * 2.6 * np.pi / 400
    found = np.asarray(visibility_map(full, far, n_angles=N_ANGLES))
    least, most = (2 * np.arcsin((1.3 + beyond) / d) / np.pi for beyond in (0, 3 * eps))
    assert (found > least - 2 / N_ANGLES).all()
    assert (found < most + 2 / N_ANGLES).all()


def piece(*corners, n=300):
    """Positions along a polygon at uneven steps, and the length that each stands for."""
    corners = np.array(corners)
    reached = np.append(0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    bounds = np.append(0, np.cumsum(np.random.default_rng(n).uniform(0.5, 1.5, n)))
    bounds *= reached[-1] / bounds[-1]
    middle = (bounds[1:] + bounds[:-1]) / 2
    points = np.stack([np.interp(middle, reached, corners[:, i]) for i in range(2)], axis=1)
    return points, np.diff(bounds)


def test_any_curve_against_crossings_counted_one_by_one():
    """An L and a tooth on the other side. Lines that pass a corner or an end within two widths are
    left to the tests with exact limits."""
    pieces = [
        piece((-1.5, 1.2), (-1.5, -1.2), (-0.5, -1.2)),
        piece((1.0, 0.5), (1.6, 0.1), (1.0, -0.4), n=150),
    ]
    points, weights = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    curve = SampledCurve(*jax.device_put((points, weights, np.zeros_like(points))), False)
    eps, seen_from = 0.03, np.random.default_rng(0).uniform(-0.8, 0.8, (40, 2))
    across = np.stack([-np.sin(ANGLES), np.cos(ANGLES)])
    met, near = np.zeros((40, 360), bool), np.zeros((40, 360), bool)
    for positions, _ in pieces:
        side = (positions[:, None] - seen_from) @ across  # (detectors, points, angles)
        met |= (side[1:] * side[:-1] <= 0).any(axis=0)
        near |= np.minimum(abs(side.min(axis=0)), abs(side.max(axis=0))) < 2 * eps
    found = np.asarray(edge_weight(curve, seen_from, ANGLES, width=eps)) >= VISIBLE
    assert near.mean() < 0.25
    assert 0.1 < met.mean() < 0.9
    assert (found == met)[~near].all()


def test_the_map_counts_the_edges_of_every_pixel():
    """With the table of offsets and without, but for directions on the limit."""
    curve = circular_arc(1.3, 0.0, 200)
    weights = np.asarray(edge_weight(curve, GRID.points, ANGLES))
    assert weights.shape == (9, 7, 360)
    certain = np.abs(weights - VISIBLE).min(axis=-1) > 5e-3
    share = (weights >= VISIBLE).mean(axis=-1)
    found = np.asarray(visibility_map(curve, GRID))
    assert certain.mean() > 0.5
    assert_allclose(found[certain], share[certain], rtol=1e-12)
    assert_allclose(found, share, atol=2 / 360)


@pytest.mark.parametrize("counts", [(50, 50, 50), (90, 30, 30)], ids=["even", "uneven"])
def test_the_disk_seen_by_three_arcs(counts):
    """Arcs of 100 degrees with openings of 20 between them. Lines that miss all go from opening to
    opening: the nearest join corners 140 degrees apart, and leave a triangle about the middle."""
    arcs = [
        circular_arc(1.3, 1.3 * np.cos(np.radians(130)), n, angle=2 * np.pi * k / 3)
        for k, n in enumerate(counts)
    ]
    curve, inner = join_curves(*arcs), 1.3 * np.cos(np.radians(70))
    # two pixels, and the distance from an end at which W is enough
    short = 2 * 2.6 / 32 + 0.7 * 3 * np.radians(2) * 1.3
    middle, radius = visible_disk(curve, n=33)
    assert np.linalg.norm(middle) < 0.1
    assert inner - short < radius < inner
    if counts[0] == 90:
        center, radius = visible_disk(curve, center=(0.1, 0.0), n=33)
        off = max(0.1 * np.cos(a.angle + np.pi) for a in arcs)
        assert np.array_equal(center, [0.1, 0.0])
        assert inner - off - short < radius < inner - off


def test_no_disk_is_seen_by_a_straight_array():
    assert visible_disk(polyline([(-1, -1), (1, -1)], 40), n=17) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"least": 0.0}, "least is 0.0, expected a value above zero"),
        ({"n_angles": 0}, "n_angles is 0"),
        ({"width": -1.0}, "width is -1.0"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        visibility_map(circular_arc(1.3, 0.0, 20), GRID, **change)


def test_points_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"points has shape \(3,\)"):
        edge_weight(circular_arc(1.3, 0.0, 20), [0.0, 1.0, 2.0], ANGLES)


def test_the_map_may_be_traced():
    """Its table of offsets is then as fine as the standard width wants it, and so the share."""
    curve = circular_arc(1.3, 0.0, 20)
    width = 3 * float(curve.weights[0])
    traced = jax.jit(lambda w: visibility_map(curve, GRID, width=w))(width)
    assert_allclose(traced, visibility_map(curve, GRID, width=width), atol=1 / 360)


def test_scattered_positions_are_one_curve():
    """Among them three short steps in a row, beside a long one, are no gap."""
    arc = np.asarray(circular_arc(1.3, 1.0, 500).points)
    off = 1 + 0.02 * np.random.default_rng(5).standard_normal((500, 1))
    curve = detector_curve(arc * off, closed=False, smooth=12)
    assert len(connected_pieces(curve)) == 1
