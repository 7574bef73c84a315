"""Caps recognised by the positions of their detectors, in any order."""

import jax
import numpy as np
import pytest

from jaxtat import Setup, VolumeGrid
from jaxtat.geometry.rings import fit_sphere
from jaxtat.regularization import tikhonov_rule
from jaxtat.spherical import ball, find_rings, spherical_cap
from jaxtat.spherical.tikhonov import solve_rings

CENTER = np.array([0.1, -0.2, 0.3])


def positions(turns, theta, n=44, radius=2.0):
    """Rings at polar angles theta, each turned."""
    phi = np.asarray(turns)[:, None] + 2 * np.pi / n * np.arange(n)
    sine, cosine = np.sin(theta)[:, None], np.cos(theta)[:, None]
    parts = sine * np.cos(phi), sine * np.sin(phi), cosine
    return CENTER + radius * np.stack(np.broadcast_arrays(*parts), axis=-1)


def test_rings_in_any_order_turned_and_upside_down():
    theta = np.array([3.0, 2.7, 2.2, 1.5, 1.0])
    points = positions([0.0, 0.05, -3.1, 3.1, 0.01], theta)
    mixed = np.random.default_rng(0).permutation(points.size // 3)
    for sign in (1.0, -1.0):
        turned = (points - CENTER) * [1.0, 1.0, sign] + CENTER
        shuffled = turned.reshape(-1, 3)[mixed]
        rings, order, upside_down = find_rings(shuffled)
        assert upside_down == (sign < 0) and rings.shape == (5, 44)
        np.testing.assert_allclose(rings.center, CENTER, atol=1e-12)
        upwards = (shuffled[order] - CENTER) * [1.0, 1.0, sign] + CENTER
        np.testing.assert_allclose(rings.points, upwards, atol=1e-12)
        np.testing.assert_allclose(rings.polar_angles, theta, atol=1e-12)
        # to the pole below, half-way between, and as far above as below
        assert np.isclose(float(rings.half_opening), 0.75)
        bounds = np.cos([np.pi, 2.85, 2.45, 1.85, 1.25, 0.75])
        np.testing.assert_allclose(rings.ring_areas, 8 * np.pi * np.diff(bounds), rtol=1e-9)


def test_turned_rings_give_what_turned_data_of_straight_ones_do():
    """F_m of detectors turned by an angle, from data that have been sampled there."""
    theta, region = np.linspace(2.9, 0.9, 7), ball(0.5, center=CENTER)
    radii = jax.device_put(1.5 + 0.1 * np.arange(11))
    rng, n = np.random.default_rng(3), 44
    # of data with azimuthal orders up to 8 the values anywhere on a ring are known
    series = rng.standard_normal((7, 11, 9)) + 1j * rng.standard_normal((7, 11, 9))

    def found(turns):
        rings = find_rings(positions(turns, theta).reshape(-1, 3)).rings
        phi = np.asarray(rings.turns)[:, None] + 2 * np.pi / n * np.arange(n)
        waves = np.exp(1j * phi[..., None] * np.arange(9))
        g = jax.device_put(np.einsum("tam,trm->tar", waves, series).real)
        grid = VolumeGrid(9, half_width=0.5, center=CENTER)
        sizes = Setup(rings, region, grid, radii, max_frequency=9.0).sizes
        rule = tikhonov_rule(1e-4, sizes.n_frequencies)
        return np.asarray(solve_rings(rings, region, radii, g[None], rule, sizes)[0])

    straight, turned = found(np.zeros(7)), found(rng.uniform(-3, 3, 7))
    np.testing.assert_allclose(turned, straight, atol=1e-10 * np.abs(straight).max())


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda p: p[:-1], "expected two rings or more"),
        (lambda p: p * [1.0, 1.0, 0.98], "do not lie on a sphere"),
        (lambda p: p * [1.0, 1.0, 0.0], "lie in a plane"),
        (lambda p: p[:44], "lie in a plane"),
        (lambda p: np.delete(p, np.s_[::44], axis=0), "same even number"),
        (lambda p: np.delete(p, np.r_[0:220:44, 1:220:44], axis=0), "not equispaced"),
        (lambda p: p[:, [2, 0, 1]], "rings about the axis x_3"),
    ],
)
def test_what_is_no_cap_of_rings_is_refused(spoil, message):
    points = positions(np.zeros(5), np.linspace(2.9, 1.0, 5)).reshape(-1, 3)
    with pytest.raises(ValueError, match=message):
        find_rings(spoil(points))


def test_the_whole_sphere_and_gauss_rings_are_recognised():
    for top, opening in ((1.3, 0.0), (0.5, np.arccos(0.5 / 1.3))):
        cap = spherical_cap(1.3, top, 16, 12)
        rings = find_rings(np.asarray(cap.points).reshape(-1, 3)).rings
        np.testing.assert_allclose(rings.points, cap.points, atol=1e-12)
        assert abs(float(rings.half_opening) - opening) < 0.03
    center, radius = fit_sphere(np.asarray(cap.points).reshape(-1, 3))
    assert np.isclose(radius, 1.3) and np.abs(center).max() < 1e-12
