"""Regions, grids, radii and visibility."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat import ImageGrid, circular_arc, data_radii, detector_curve, disk
from jaxtat.geometry import require_outside, require_radii, uncovered, visibility

unit = st.floats(-3.0, 3.0)


@given(
    st.floats(0.01, 50.0), st.floats(-0.9, 1.5), st.sampled_from([40, 90, 300]), unit, unit, unit
)
@settings(deadline=None, max_examples=40)
def test_boundary_integrals_obey_the_divergence_theorem(radius, cut, n, c1, c2, angle):
    region = disk(radius, cut * radius, n_boundary=n, center=(c1, c2), angle=angle)
    # ∫ n dl = 0 and ∫ x·n dl = 2 |Omega|, by the midpoint rule on arc and chord
    total = np.asarray(region.weights @ region.normals)
    scale = float(region.weights.sum())
    assert np.all(np.abs(total) < 10 * scale / n**2)
    local = np.asarray(region.points) - [c1, c2]
    area = np.sum(local * np.asarray(region.normals) * np.asarray(region.weights)[:, None]) / 2
    half = np.arccos(min(cut, 1.0))
    exact = radius**2 * (np.pi - half + np.sin(half) * np.cos(half))
    assert abs(area / exact - 1) < 20 / n**2 + 1e-12
    assert np.allclose(np.abs(region.level(region.points)), 0, atol=1e-9 * (radius + 5))


@given(unit, unit, unit)
@settings(deadline=None, max_examples=20)
def test_contains_turns_and_moves_with_the_region(c1, c2, angle):
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (200, 2))
    plain = disk(1.0, 0.3, n_boundary=40).contains(jnp.asarray(points))
    assert np.array_equal(plain, (np.linalg.norm(points, axis=1) < 1) & (points[:, 0] < 0.3))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = disk(1.0, 0.3, n_boundary=40, center=(c1, c2), angle=angle)
    assert np.array_equal(plain, moved.contains(jnp.asarray(points @ turn.T + [c1, c2])))


def test_derivatives_of_regions(check_both_modes):
    def fields(radius, cut, center, angle):
        region = disk(radius, cut, n_boundary=30, center=center, angle=angle)
        return region.points, region.weights, region.normals

    arguments = (jnp.array(1.0), jnp.array(0.2), jnp.array([0.2, 0.1]), jnp.array(0.3))
    check_both_modes(fields, arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1.0, 0.0, 7), "n_boundary is 7"),
        ((0.0, 0.0, 100), "radius is 0"),
        ((1.0, -1.0, 100), "is empty"),
        ((1.0, np.inf, 100), "infinite"),
    ],
)
def test_bad_regions_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        disk(*arguments[:2], n_boundary=arguments[2])


def test_detectors_inside_or_on_the_region_are_refused():
    region = disk(1.0, n_boundary=100)
    require_outside(circular_arc(1.01, 0.0, 10).points, region)
    for radius in (0.5, 1.0):
        with pytest.raises(ValueError, match="10 of 10 detectors lie inside or on the region"):
            require_outside(circular_arc(radius, 0.0, 10).points, region)


def test_grid_nodes_and_their_order():
    grid = ImageGrid((5, 9), half_width=(1.0, 2.0), center=(0.5, -1.0))
    assert grid.points.shape == (5, 9, 2)
    assert np.allclose(grid.x1, 0.5 + np.linspace(-1, 1, 5))
    assert np.allclose(grid.x2, -1.0 + np.linspace(-2, 2, 9))
    assert np.allclose(grid.points[3, 7], [grid.x1[3], grid.x2[7]])
    assert np.allclose(grid.spacing, [0.5, 0.5])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [((3,), "at least 4"), ((9, 0.0), "half_width is"), ((9, 1.0, (0.0,)), "center has shape")],
)
def test_bad_grids_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        ImageGrid(*arguments)


def require_cover(curve, region, radii):
    """What a `Setup` looks at."""
    require_radii(radii)
    missing = uncovered(curve, region, radii)
    if missing:
        raise ValueError(missing)


def test_radii_of_the_paper():
    curve, region = circular_arc(1.3, 1.0, 500), disk(1.0, n_boundary=1000)
    radii = data_radii(curve, region, 1 / 64)
    assert np.allclose(radii, 0.3 + np.arange(129) / 64, atol=1e-4)
    require_cover(curve, region, radii)


@pytest.mark.parametrize(
    ("radii", "message"),
    [
        (np.linspace(0.5, 2.3, 50), "radii run from 0.5 to 2.3, but circles"),
        (np.linspace(0.3, 2.0, 50), "from 0.3"),
        (np.linspace(300, 2300, 50), "same unit of length"),
        (np.linspace(0.0, 2.3, 50), "positive values in increasing order"),
        (np.linspace(2.3, 0.3, 50), "positive values in increasing order"),
        (np.linspace(0.3, 2.3, 3), "got 3 radii"),
        (np.r_[np.linspace(0.3, 1, 40), np.linspace(2, 2.3, 20)], "a hole from 1 to 2"),
    ],
)
def test_radii_that_do_not_cover_the_region_are_refused(radii, message):
    curve, region = circular_arc(1.3, 1.0, 50), disk(1.0, n_boundary=100)
    with pytest.raises(ValueError, match=message):
        require_cover(curve, region, jnp.asarray(radii))


def test_visibility_of_a_traced_geometry_is_refused():
    region = disk(1.0, n_boundary=100)
    with pytest.raises(ValueError, match="traced, expected known ones"):
        jax.jit(lambda r: visibility(circular_arc(r, 1.0, 50), region).angles)(1.3)


def test_a_dead_piece_of_the_curve_is_not_visible():
    whole = circular_arc(1.3, 0.0, 300)
    alive = np.r_[0:130, 170:300]
    curve = detector_curve(np.asarray(whole.points)[alive])
    assert not curve.closed
    assert np.isclose(curve.weights.max(), whole.weights[0], rtol=1e-6)  # a gap is nobody's arc
    region = disk(0.9, 0.0, n_boundary=600)
    assert visibility(whole, region).invisible_fraction == 0
    # brute force: both points where a line meets the circle, against the two live arcs
    angle = (np.arange(720) + 0.5) * np.pi / 720
    shadow = np.asarray(region.points) @ np.stack([np.cos(angle), np.sin(angle)])
    low, high = shadow.min(axis=0), shadow.max(axis=0)
    s = low + (high - low) * (np.arange(2000)[:, None] + 0.5) / 2000
    hits = np.stack([angle + np.arccos(s / 1.3), angle - np.arccos(s / 1.3)]) % (2 * np.pi)
    ends = np.pi / 2 + np.array([0, 130, 170, 300]) * np.pi / 300
    live = ((hits > ends[0]) & (hits < ends[1])) | ((hits > ends[2]) & (hits < ends[3]))
    exact = ((1 - live.any(axis=0)) * (high - low)).sum() / (high - low).sum() / 2000
    assert abs(float(visibility(curve, region).invisible_fraction) - exact) < 3e-3
    assert exact > 0.1


def test_visibility_of_the_papers_geometries_and_of_a_poking_region():
    for right in (1.0, 0.0):
        seen = visibility(circular_arc(1.3, right, 500), disk(1.0, right, n_boundary=1000))
        assert seen.invisible_fraction == 0
    # a whole disk before a half circle: lines x·w = s with s > 1.3 |sin| miss the curve, of the
    # 2 wide shadow: ∫ max(0, 1 - 1.3 |sin|) over half a turn, over 2 π
    seen = visibility(circular_arc(1.3, 0.0, 2000), disk(1.0, n_boundary=2000), 3600)
    angle = np.linspace(0, np.pi, 200001)
    exact = np.maximum(0, 1 - 1.3 * np.sin(angle)).mean() / 2
    assert abs(float(seen.invisible_fraction) / exact - 1) < 5e-3
    assert "miss the curve" in str(seen)
