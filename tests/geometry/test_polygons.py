"""Regions with straight sides and of several components."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.path import Path

from jaxtat import circular_arc, disk, polygon
from jaxtat.geometry import rectangle, require_outside, union_of_regions, visibility

NOTCHED = np.array([(-0.8, -0.5), (0.7, -0.6), (0.1, 0.0), (0.8, 0.6), (-0.7, 0.5)])  # not convex


@pytest.fixture(scope="module")
def notched():
    return polygon(NOTCHED, n_boundary=200)


def test_inside_is_what_another_library_says(notched):
    points = np.random.default_rng(0).uniform(-1, 1, (2000, 2))
    found = np.asarray(notched.contains(jax.device_put(points)))
    assert np.array_equal(found, Path(NOTCHED).contains_points(points))


def test_rows_through_vertices_and_beside_them():
    """A ray that passes a vertex passes one side there, and on a row of the grid whichever rounding
    puts the vertex above or below it."""
    vertices = np.array([(0.2, 0.9), (-0.8, 0.5), (-0.9, -0.3), (-0.8, -0.6), (0.1, -1)])
    rows = np.linspace(-1.2, 1.2, 41)
    rows = np.concatenate([rows, vertices[:, 1]])
    rows = np.concatenate([rows, np.nextafter(rows, 2), np.nextafter(rows, -2)])
    points = np.stack(np.meshgrid(np.linspace(-1.21, 1.21, 40), rows, indexing="ij"), axis=-1)
    found = np.asarray(polygon(vertices, n_boundary=200).contains(jax.device_put(points))).ravel()
    # convex: on the left of every side
    ahead = np.roll(vertices, -1, axis=0) - vertices
    local = points.reshape(-1, 1, 2) - vertices
    left = (ahead[:, 0] * local[..., 1] - ahead[:, 1] * local[..., 0]).min(axis=1)
    certain = np.abs(left) > 1e-12
    assert np.array_equal(found[certain], left[certain] > 0) and certain.mean() > 0.99


def test_level_is_the_distance_to_the_boundary(notched):
    points = np.random.default_rng(1).uniform(-1, 1, (2000, 2))
    nearest = np.linalg.norm(points[:, None] - np.asarray(notched.points), axis=-1).min(axis=1)
    level = np.abs(np.asarray(notched.level(jax.device_put(points))))
    step = float(notched.weights.max())
    assert np.all(level <= nearest + 1e-12) and np.all(level >= nearest - step)
    assert np.abs(np.asarray(notched.level(notched.points))).max() < 1e-12


@pytest.mark.parametrize("vertices", [NOTCHED, NOTCHED[::-1]], ids=["anticlockwise", "clockwise"])
def test_boundary_integrals_obey_the_divergence_theorem(vertices):
    """∫ x·n dl is twice the area, ∫ n dl nothing."""
    region = polygon(vertices, n_boundary=200)
    x, y = NOTCHED.T
    area = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2
    points, weights, normals = map(np.asarray, (region.points, region.weights, region.normals))
    flux = np.sum(weights * np.sum(points * normals, axis=1))
    np.testing.assert_allclose(flux, 2 * area, rtol=1e-12)
    np.testing.assert_allclose(weights @ normals, 0, atol=1e-12)
    assert region.points.shape == (200, 2)


def test_a_rectangle_is_turned_and_moved():
    region = rectangle((0.8, 0.3), n_boundary=220, center=(2.0, 1.0), angle=np.pi / 2)
    np.testing.assert_allclose(np.ptp(region.vertices, axis=0), [0.6, 1.6], rtol=1e-12)
    np.testing.assert_allclose(region.center, [2.0, 1.0], rtol=1e-12)
    np.testing.assert_allclose(region.reach, np.hypot(0.8, 0.3), rtol=1e-12)


def test_components_of_a_union():
    left, right = (rectangle((0.2, 0.4), n_boundary=120, center=(x, 0.0)) for x in (-0.6, 0.6))
    both = union_of_regions(left, union_of_regions(right))
    assert [part is one for part, one in zip(both.components, (left, right), strict=True)] == [
        True,
        True,
    ]
    assert both.contains(jnp.array([[-0.6, 0.1], [0.0, 0.0], [0.6, -0.3]])).tolist() == [
        True,
        False,
        True,
    ]
    far = np.linalg.norm(np.asarray(left.vertices), axis=1).max()
    assert far <= float(both.reach) < far + 0.01
    with pytest.raises(ValueError, match="20 of 40 detectors lie inside or on"):
        require_outside(
            circular_arc(0.6, 0.6, 40).points, union_of_regions(left, both.components[1])
        )


def test_lines_between_components_ask_for_nothing():
    """Half a circle sees the left of two disks, and not a line more."""
    curve = circular_arc(1.3, -0.5, 300)
    near, far = (disk(0.2, n_boundary=200, center=(x, 0.0)) for x in (-0.8, 0.8))
    assert visibility(curve, near).invisible_fraction == 0
    alone = float(visibility(curve, far).invisible_fraction)
    both = float(visibility(curve, union_of_regions(near, far)).invisible_fraction)
    # Lines through the near disk are all seen. Those through both are as many as the belt that
    # crosses between the disks is longer than the one around them.
    between = 2 * (np.sqrt(1.6**2 - 0.4**2) - 1.6) + 0.8 * np.arcsin(0.25)
    every = 2 * np.pi * 0.2
    np.testing.assert_allclose(both / alone, every / (2 * every - between), rtol=2e-3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: polygon(NOTCHED[:2], n_boundary=100), "got 2 vertices"),
        (
            lambda: polygon(NOTCHED[[0, 3, 1, 2, 4]], n_boundary=100),
            "sides 0 and 3 of the polygon cross",
        ),
        (lambda: polygon([(0, 0), (1, 1), (2, 2)], n_boundary=100), "cover each other"),
        (lambda: polygon([(0, 0), (1, 1 + 1e-10), (2, 2)], n_boundary=100), "no area"),
        (
            lambda: polygon([(0, 0), (1, 0), (1, 2), (1, 1), (0, 1)], n_boundary=100),
            "sides 1 and 2 .* cover",
        ),
        (lambda: polygon(NOTCHED[[0, 0, 1, 2]], n_boundary=(4, 4, 4, 4)), "same position"),
        (lambda: polygon(NOTCHED, n_boundary=20), "expected at least 4 on each"),
        (lambda: polygon(NOTCHED[[0, 0, 1, 2]], n_boundary=100), "same position"),
        (lambda: rectangle((0.0, 1.0), n_boundary=100), "half_widths"),
        (lambda: union_of_regions(), "got no regions"),
        (
            lambda: union_of_regions(
                polygon(NOTCHED, n_boundary=200), rectangle((0.2, 0.2), n_boundary=80)
            ),
            "regions 0 and 1 overlap",
        ),
    ],
)
def test_impossible_regions_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_derivatives_of_polygons(check_both_modes):
    def parts(vertices):
        region = polygon(vertices, n_boundary=(4, 4, 4))
        return region.points, region.weights, region.normals, region.center, region.reach

    triangle = np.array([(-0.6, -0.5), (0.8, -0.6), (-0.5, 0.7)])
    check_both_modes(parts, (triangle,))
