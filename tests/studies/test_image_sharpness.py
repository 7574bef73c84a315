"""Sharpness against waves whose gradient is known, and where it is greatest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, Setup, circular_arc, cosine_filter, disk, phantoms, reconstruct
from jaxtat.studies import sharpness


def test_sharpness_of_a_plane_wave_is_half_its_wave_number_squared_times_the_area():
    grid = ImageGrid(401)
    wave = jnp.sin(grid.points @ jnp.array([3.0, 4.0]))
    x1, x2 = np.meshgrid(*[np.linspace(-0.8, 0.8, 1601)] * 2, indexing="ij")
    exact = 25 * np.sum((np.cos(3 * x1 + 4 * x2) ** 2)[np.hypot(x1, x2) < 0.8]) * 1e-6
    found = sharpness(wave, grid, disk(0.8))
    assert abs(found / exact - 1) < 2e-3  # the rim of the disk is as coarse as the grid
    grid = ImageGrid(65)
    whole = sharpness(jnp.stack([grid.points[..., 0], 3 * grid.points[..., 1]]), grid)
    inner = (63 * grid.spacing[0]) ** 2
    assert np.allclose(whole, [inner, 9 * inner], rtol=1e-12)  # exact for straight slopes


def test_derivatives_of_sharpness(check_both_modes):
    image = jax.random.normal(jax.random.key(0), (11, 11))
    grid, region = ImageGrid(11), disk(0.8)
    check_both_modes(lambda image: sharpness(image, grid, region), (image,), order=2)


def test_images_are_sharpest_with_the_true_speed():
    """Of data with 2 % noise, where the speed was believed to be 2 % less; derivatives too."""
    grid, region, speeds = ImageGrid(33), disk(0.95), np.linspace(1440.0, 1560.0, 7)
    curve, radii = circular_arc(1.3, 1.0, 80), 0.25 + float(grid.spacing[0]) * np.arange(36)
    disks = phantoms.Disks([[0.1, 0.05], [0.3, 0.25]], [0.7, 0.2], [1.0, 0.5])
    g = disks.circular_integrals(curve, radii)
    g = g + phantoms.noise_like(jax.random.key(0), g, 0.02)
    setup = Setup(curve, region, grid, 0.98 * radii)

    @jax.jit
    def at(speed):
        moved = setup.replace(radii=setup.radii * speed / 1470)
        image = reconstruct(moved, g, 1e-3, low_pass=cosine_filter)
        return speed**2 * sharpness(image, grid, region)

    values = np.array([at(speed) for speed in speeds])
    assert speeds[values.argmax()] == 1500.0
    slopes = [jax.jvp(at, (speed,), (1.0,))[1] for speed in (1495.0, 1505.0)]
    assert slopes[0] > 0 > slopes[1]


def test_an_image_of_another_grid_is_refused():
    with pytest.raises(ValueError, match="image has shape"):
        sharpness(jnp.ones((5, 5)), ImageGrid(33))
