"""Phantoms in space against quadrature over spheres and volumes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import VolumeGrid
from jaxtat.spherical import Balls, DetectorPoints, SolidBells

CENTERS, SIZES, AMPLITUDES = [[0.2, -0.1, 0.3], [-0.3, 0.2, -0.2]], [0.5, 0.4], [1.0, -0.7]
DETECTORS = DetectorPoints([[0.0, 0.0, 1.3], [1.1, -0.4, 0.2], [0.3, 0.0, 0.2]])
RADII = jax.device_put(np.array([0.15, 0.45, 0.9, 1.3, 1.9]))


def sphere(n):
    """Directions and weights of a product rule, Gauss in the cosine."""
    t, w = np.polynomial.legendre.leggauss(n)
    phi = np.pi / n * (np.arange(2 * n) + 0.5)
    s = np.sqrt(1 - t**2)[:, None]
    points = np.stack(np.broadcast_arrays(s * np.cos(phi), s * np.sin(phi), t[:, None]), -1)
    return points.reshape(-1, 3), np.repeat(w * np.pi / n, 2 * n)


@pytest.mark.parametrize(("kind", "tolerance"), [(Balls, 3e-3), (SolidBells, 1e-12)])
def test_spherical_integrals_against_quadrature(kind, tolerance):
    """Detector 3 is inside a part, whose spheres of radius 0.15 lie within it altogether."""
    phantom = kind(CENTERS, SIZES, AMPLITUDES)
    found = phantom.spherical_integrals(DETECTORS, RADII)
    direction, weight = sphere(500 if kind is Balls else 200)
    radii = np.asarray(RADII)
    points = np.asarray(DETECTORS.points)[:, None, None] + radii[:, None, None] * direction
    exact = radii**2 * (np.asarray(phantom(jnp.asarray(points))) @ weight)
    np.testing.assert_allclose(found, exact, atol=tolerance)


@pytest.mark.parametrize("kind", [Balls, SolidBells])
def test_in_the_centre_of_a_part_all_of_the_sphere_has_one_value(kind):
    """There, and near: the same but for the square of the distance."""
    center = np.array([0.2, -0.1, 0.3])
    away = np.array([0.0, 1e-7, 1e-5])[:, None] * np.array([0.0, 0.6, 0.8])
    phantom, radii = kind([center, center], [0.5, 0.4], [1.0, -0.7]), RADII / 4
    found = phantom.spherical_integrals(DetectorPoints(center + away), radii)
    value = phantom(jax.device_put(center + np.asarray(radii)[:, None] * [0.0, 0.6, 0.8]))
    exact = np.broadcast_to(4 * np.pi * np.asarray(radii) ** 2 * value, (3, 5))
    np.testing.assert_allclose(found, exact, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("kind", [Balls, SolidBells])
def test_fourier_transform_against_quadrature(kind):
    """Shell by shell; at xi = 0 the mass."""
    phantom = kind(CENTERS, SIZES, AMPLITUDES)
    xi = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, -2.0], [-3.0, 9.0, 1.0]])
    direction, weight = sphere(40)
    t, w = np.polynomial.legendre.leggauss(60)
    total = np.zeros(3, complex)
    for center, size, amplitude in zip(CENTERS, SIZES, AMPLITUDES, strict=True):
        r = size * (t + 1) / 2
        profile = np.asarray(phantom._profile(jax.device_put(r / size))) * r**2 * w * size / 2
        waves = np.exp(
            -1j * (xi @ np.array(center))[:, None]
            - 1j * np.multiply.outer(xi @ direction.T, r).transpose(2, 0, 1)
        )
        total += amplitude * np.einsum("s,sxd,d->x", profile, waves, weight)
    np.testing.assert_allclose(phantom.fourier(xi), total / (2 * np.pi) ** 1.5, atol=1e-12)


def test_volume_is_the_function_at_the_nodes():
    grid = VolumeGrid((5, 6, 7), half_width=(0.5, 0.6, 0.7), center=(0.1, 0.0, -0.1))
    bell = SolidBells(CENTERS, SIZES)
    volume = np.asarray(bell.volume(grid))
    assert volume.shape == (5, 6, 7)
    point = np.asarray(grid.points)[2, 3, 1]
    assert volume[2, 3, 1] == float(bell(jnp.asarray(point)))
    axes = (np.asarray(axis)[k] for axis, k in ((grid.x1, 2), (grid.x2, 3), (grid.x3, 1)))
    np.testing.assert_allclose(point, list(axes))
    np.testing.assert_allclose(grid.spacing, [0.25, 0.24, 1.4 / 6])
