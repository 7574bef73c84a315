"""Integrals over spheres of a volume: exact phantoms, brute force, adjoint, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import VolumeGrid
from jaxtat.base.interpolation import KEYS, LINEAR
from jaxtat.forward.spheres import (
    _sphere_nodes,
    _taps,
    integrate_over_spheres,
    integrate_over_spheres_adjoint,
)
from jaxtat.spherical import (
    Bells,
    DetectorPoints,
    back_projection,
    spherical_cap,
)

GRID = VolumeGrid((7, 8, 9), half_width=(0.9, 1.0, 1.1), center=(0.1, 0.0, -0.1))
POINTS = DetectorPoints([[0.0, 0.1, -1.6], [1.5, 0.2, 0.4], [0.2, 0.1, 0.0]])
RADII = jax.device_put(np.array([0.5, 1.4, 2.2]))
N_POINTS = 20


def weight_of(table, t):
    """The kernel that a table holds, at distance t from its node."""
    # the point is a fraction behind the node -floor(-t) before it; rows are for 1 - taps/2, ...
    fraction, row = -t - np.floor(-t), -int(np.floor(-t)) + len(table) // 2 - 1
    return np.polyval(table[row][::-1], fraction) if 0 <= row < len(table) else 0.0


@pytest.mark.parametrize(("kernel", "table"), [("cubic", KEYS), ("linear", LINEAR)])
def test_sampling_is_a_product_of_kernels_also_beyond_the_edge(kernel, table):
    rng = np.random.default_rng(0)
    volume = rng.standard_normal(GRID.shape)
    points = np.concatenate([rng.uniform(-1.6, 1.6, (60, 3)), GRID.points[2:4, 0, 0]])
    taps_of = jax.jit(lambda points: _taps(GRID, points, kernel))
    index, weights = map(np.asarray, taps_of(points))
    taps = len(table)
    padded = np.pad(volume, taps - 1)
    found = (padded.ravel()[index] * weights).sum(axis=1)
    axes = [np.asarray(GRID.axis(k)) for k in range(3)]
    spacing = np.asarray(GRID.spacing)
    for point, value in zip(points, found, strict=True):
        w = [
            np.array([weight_of(table, (x - point[k]) / spacing[k]) for x in axes[k]])
            for k in range(3)
        ]
        assert abs(value - np.einsum("abc,a,b,c->", volume, *w)) < 1e-12


def test_nodes_cover_the_part_of_the_sphere_near_the_grid():
    """Their area, and distance from the detector; every sphere through the grid is met."""
    reach = np.linalg.norm(np.asarray(GRID.half_width) + np.asarray(GRID.spacing))
    nodes_of = jax.jit(lambda point, r: _sphere_nodes(point, r, GRID, N_POINTS))
    center = np.asarray(GRID.center)
    for point, r in zip(np.asarray(POINTS.points), (1.4, 2.2, 0.5), strict=True):
        nodes, area = map(np.asarray, nodes_of(point, r))
        np.testing.assert_allclose(np.linalg.norm(nodes - point, axis=1), r, rtol=1e-12)
        d = np.linalg.norm(center - point)
        height = 1 - np.clip((d**2 + r**2 - reach**2) / (2 * d * r), -1, 1)
        np.testing.assert_allclose(area.sum(), 2 * np.pi * r**2 * height, rtol=1e-12)
        assert (np.linalg.norm(nodes - center, axis=1) < reach + 1e-9).all()
    _, area = nodes_of(center, 0.5)
    np.testing.assert_allclose(area.sum(), np.pi, rtol=1e-12)


def test_exact_integrals_are_reached_with_the_kernel_s_order():
    bell = Bells([[0.1, 0.0, -0.1]], [0.95])
    exact = np.asarray(bell.spherical_integrals(POINTS, RADII))
    errors = {}
    for kernel in ("cubic", "linear"):
        for n in (17, 33):
            grid = VolumeGrid(n)
            g = integrate_over_spheres(
                bell.volume(grid), grid, POINTS, RADII, kernel=kernel, n_points=48
            )
            errors[kernel, n] = np.abs(np.asarray(g) - exact).max()
    assert errors["cubic", 33] < 2e-3
    assert np.log2(errors["cubic", 17] / errors["cubic", 33]) > 2.5
    assert np.log2(errors["linear", 17] / errors["linear", 33]) > 1.5


def test_adjoint_passes_the_dot_test_for_batches_and_caps():
    cap = spherical_cap(1.5, 1.0, 3, 4)
    rng = np.random.default_rng(2)
    volumes = rng.standard_normal((2, *GRID.shape))
    data = rng.standard_normal((2, 3, 4, 3))
    g = np.asarray(integrate_over_spheres(volumes, GRID, cap, RADII, n_points=N_POINTS))
    back = np.asarray(integrate_over_spheres_adjoint(data, GRID, cap, RADII, n_points=N_POINTS))
    assert g.shape == data.shape and back.shape == volumes.shape
    for k in range(2):
        one, other = np.vdot(g[k], data[k]), np.vdot(volumes[k], back[k])
        assert abs(one - other) < 1e-12 * np.linalg.norm(g[k]) * np.linalg.norm(data[k])


def test_derivatives_in_volume_positions_and_radii(check_both_modes):
    volume = Bells([[0.1, 0.0, -0.1]], [0.9]).volume(GRID)

    def g(volume, points, radii):
        return integrate_over_spheres(
            volume, GRID, DetectorPoints(points), radii, n_points=N_POINTS
        )

    check_both_modes(g, (volume, POINTS.points[:2], RADII), rtol=1e-4)


def test_default_points_and_refusals():
    grid = VolumeGrid(5)
    zero = np.zeros((5, 5, 5))
    assert integrate_over_spheres(zero, grid, POINTS, RADII).shape == (3, 3)
    for arguments, options, message in (
        ((np.zeros((5, 5, 4)), grid, POINTS, RADII), {}, "volume has shape"),
        ((zero, grid, POINTS, -RADII), {}, "radii is"),
        ((zero, grid, POINTS, RADII), {"kernel": "quintic"}, "kernel is 'quintic'"),
    ):
        with pytest.raises(ValueError, match=message):
            integrate_over_spheres(*arguments, **options)
    with pytest.raises(ValueError, match="data has shape"):
        integrate_over_spheres_adjoint(np.zeros((2, 3)), grid, POINTS, RADII)


def test_back_projection_is_exact_on_a_whole_sphere_only():
    bell = Bells([[0.1, 0.2, -0.3]], [0.6])
    points = jax.device_put(np.random.default_rng(1).uniform(-0.5, 0.5, (40, 3)))
    radii, errors = jax.device_put(np.linspace(0.2, 2.4, 221)), []
    bells = np.asarray(bell(points))
    for top in (1.3, 0.0):
        cap = spherical_cap(1.3, top, 24, 48)
        found = back_projection(cap, radii, bell.spherical_integrals(cap, radii), points)
        errors.append(np.abs(np.asarray(found) - bells).max())
    assert errors[0] < 2e-3 < 0.1 < errors[1]
    cap, jitter = spherical_cap(1.3, 1.3, 24, 48), np.random.default_rng(2).uniform(-0.2, 0.2, 221)
    uneven = jnp.asarray(np.asarray(radii) + 0.01 * jitter)
    found = back_projection(cap, uneven, bell.spherical_integrals(cap, uneven), points)
    assert np.abs(np.asarray(found) - bells).max() < 2e-3, "at any distances"
    for bad, message in (
        ([0.3, 0.8, 0.5], "radii do not increase"),
        ([0.0, 0.5, 1.0], "radii is"),
        ([0.3, 0.5], "the number of radii is 2"),
    ):
        with pytest.raises(ValueError, match=message):
            back_projection(cap, bad, np.ones((24, 48, len(bad))), points)
