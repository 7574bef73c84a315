"""Integrals over circles without quadrature: brute force, whole circles, wide elements.

Exact bells, transposes, derivatives and precision are in tests/reconstruction/test_operator.py.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special

from jaxtat import (
    DiskBody,
    ImageGrid,
    Setup,
    circular_arc,
    detector_curve,
    disk,
    elliptic_arc,
    forward_operator,
    phantoms,
)
from jaxtat.forward import circle_integrals, circle_sizes, sizes_inside
from jaxtat.geometry import SampledCurve

RADII = jax.device_put(np.linspace(0.3, 2.3, 11))
ARC = circular_arc(1.3, 1.0, 6)
CURVES = {
    "on a circle": ARC,
    "inside the image": circular_arc(0.4, 0.3, 5),
    "on an ellipse": elliptic_arc((1.6, 1.2), 7),
}


@eqx.filter_jit
def integrals(curve, grid, radii, sizes, image):
    return circle_integrals(curve, grid, radii, sizes, None, 1e-10)(image[None])[0]


def brute_force(curve, grid, radii, sizes, image):
    """Σ_n h1 h2 f_n (2 r/T²) Σ_k J_0(lambda_k |x_n - z|) J_0(lambda_k r) / J_1(lambda_k T)²."""
    z, x = (np.asarray(v.points).reshape(-1, 2) for v in (curve, grid))
    distance = np.linalg.norm(z[:, None] - x, axis=-1)
    j0, r, frequencies = scipy.special.j0, np.asarray(radii), np.asarray(sizes.frequencies)
    at = np.stack([j0(k * distance) @ np.ravel(image) for k in frequencies], axis=1)
    waves = j0(frequencies[:, None] * r) / scipy.special.j1(sizes.zeros[:, None]) ** 2
    return 2 * r * (r < sizes.period) / sizes.period**2 * (at @ waves) * np.prod(grid.spacing)


@pytest.mark.parametrize("name", CURVES)
def test_is_the_sum_over_pixels_also_of_noise(name):
    grid = ImageGrid((10, 13), half_width=(1.0, 0.8), center=(0.1, -0.1))
    image = np.random.default_rng(1).standard_normal(grid.shape)
    sizes = circle_sizes(CURVES[name], grid)
    g = integrals(CURVES[name], grid, RADII, sizes, image)
    exact = brute_force(CURVES[name], grid, RADII, sizes, image)
    assert np.abs(g - exact).max() < 1e-8 * np.abs(exact).max()


@pytest.mark.parametrize("name", CURVES)
def test_images_that_are_zero_outside_a_disk_need_fewer_waves(name):
    grid, region = ImageGrid(24, 1.0, (0.1, -0.1)), disk(0.9, center=(0.1, -0.1))
    noise = np.random.default_rng(1).standard_normal(grid.shape)
    image = np.where(region.contains(grid.points), noise, 0.0)
    whole = circle_sizes(CURVES[name], grid)
    sizes = sizes_inside(whole, CURVES[name], grid, region)
    assert sizes.groups[-1][2] < 0.9 * whole.groups[-1][2]
    g = integrals(CURVES[name], grid, RADII, sizes, image)
    exact = brute_force(CURVES[name], grid, RADII, sizes, image)
    assert np.abs(g - exact).max() < 1e-8 * np.abs(exact).max()


def test_detectors_inside_the_grid_see_whole_circles():
    """One of them at the centre of the grid itself."""
    grid, bell = ImageGrid(49), phantoms.Bells([[0.0, 0.0]], [0.8])
    points = np.concatenate([circular_arc(0.2, 0.2, 5).points, [[1e-300, 0.0]]])
    curve = sampled(points)
    radii = jnp.array([0.05, 0.3, 0.7])
    g = integrals(curve, grid, radii, circle_sizes(curve, grid), bell.image(grid))
    assert np.allclose(g, bell.circular_integrals(curve, radii), atol=1e-5)


@pytest.mark.parametrize("kind", ["arc", "straight"])
def test_data_of_wide_elements_are_means_of_those_of_points(kind):
    """By brute force, of exact phantoms and of images."""
    width, n = 0.3, 60
    shares = (np.arange(n) + 0.5) / n - 0.5
    if kind == "arc":
        wide = circular_arc(1.3, 1.0, 6, element_width=width)
        points = [circular_arc(1.3, 1.0, 6, angle=s * width / 1.3).points for s in shares]
    else:
        wide = detector_curve(ARC.points, element_width=width)
        tangents = np.asarray(wide.normals)[:, ::-1] * (-1, 1)
        points = [np.asarray(wide.points) + s * width * tangents for s in shares]
    many = sampled(np.concatenate(points))

    def mean(g):
        return np.reshape(g, (n, 6, -1)).mean(axis=0)

    grid, bell = ImageGrid(17), phantoms.Bells([[0.3, 0.5]], [0.4])
    exact = mean(bell.circular_integrals(many, RADII))
    assert np.allclose(bell.circular_integrals(wide, RADII), exact, atol=2e-5)
    assert not np.allclose(bell.circular_integrals(ARC, RADII), exact, atol=2e-3)
    sizes, image = circle_sizes(wide, grid), np.asarray(bell.image(grid))
    g = integrals(wide, grid, RADII, sizes, image)
    assert np.allclose(g, mean(brute_force(many, grid, RADII, sizes, image)), atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["points", "arc", "straight", "many"])
def test_waves_about_a_body_are_moved_to_the_circle_of_the_detectors(kind, monkeypatch):
    """As tables of all waves at each detector, which need no circle."""
    width = None if kind in ("points", "many") else 0.1
    curve = circular_arc(1.3, 1.0, 6, element_width=width)
    if kind == "straight":
        curve = detector_curve(curve.points, element_width=width)
    if kind == "many":  # by non-uniform FFTs
        monkeypatch.setattr("jaxtat.forward.fast_circles.DENSE", 0)
    grid, body = ImageGrid(65, 0.5, (0.2, -0.1)), DiskBody((0.2, -0.1), 0.5, 1.1, 1.0, 1.05)
    sizes = circle_sizes(curve, grid, body)
    low, moved = sizes.groups[0], sizes.groups[1:]
    assert low[-1] == 0 < min(group[-1] for group in moved)
    noise = np.random.default_rng(1).standard_normal((1, *grid.shape))
    image = jnp.where(disk(0.5, center=(0.2, -0.1)).contains(grid.points), noise, 0.0)
    g, wanted = (
        circle_integrals(curve, grid, RADII, each, None, 1e-11, body)(image)
        for each in (sizes, replace(sizes, moved=()))
    )
    assert np.abs(g - wanted).max() < 1e-8 * np.abs(wanted).max()


def test_moved_waves_in_single_precision():
    curve, grid = circular_arc(1.0, 0.97, 20), ImageGrid(65, 0.8, (0.15, 0.0))
    body = DiskBody((0.15, 0.0), 0.8, 0.95, 1.0)  # 0.05 from a detector: the worst case
    region = disk(0.8, center=(0.15, 0.0))
    setup = Setup(curve, region, grid, medium=body, max_frequency=8.0)
    image = phantoms.Bells([[0.3, 0.2]], [0.4]).image(grid)
    single, double = (forward_operator(setup, dtype=dtype)(image) for dtype in ("f4", "f8"))
    assert np.abs(single - double).max() < 3e-5 * np.abs(double).max()


def sampled(points):
    n = len(points)
    return SampledCurve(*map(jnp.asarray, (points, np.ones(n), np.ones((n, 2)))), False)
