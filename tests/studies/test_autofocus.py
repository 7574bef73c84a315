"""Sharpness against waves whose gradient is known, and the speed of sound where it is greatest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, Setup, circular_arc, cosine_filter, disk, phantoms, reconstruct
from jaxtat.studies import sharpness, sound_speed_by_sharpness

GRID = ImageGrid(33)
STEP = float(GRID.spacing[0])
CURVE, REGION = circular_arc(1.3, 1.0, 80), disk(0.95)
RADII = 0.25 + STEP * jnp.arange(36)
SETUP = Setup(CURVE, REGION, GRID, 0.98 * RADII)  # as if the speed were 2 % less
SPEEDS = np.linspace(1420.0, 1580.0, 9)
DISKS = phantoms.Disks([[0.1, 0.05], [0.3, 0.25], [-0.35, -0.1]], [0.7, 0.2, 0.15], [1, 0.5, -0.5])


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


@pytest.fixture(scope="module")
def scan():
    """2 % noise, the nominal speed 2 % off."""
    g = DISKS.circular_integrals(CURVE, RADII)
    g = g + phantoms.noise_like(jax.random.key(0), g, 0.02)
    return g, sound_speed_by_sharpness(SETUP, g, SPEEDS, sound_speed=1470.0)


def test_the_image_is_sharpest_with_the_true_speed(scan):
    _, found = scan
    assert found.converged
    assert abs(found.sound_speed / 1500 - 1) < 1e-3
    best = int(np.argmax(found.sharpness))
    assert found.sound_speeds[best] == 1500.0
    # one peak, and no other place as high
    others = np.abs(np.arange(9) - best) > 1
    assert found.sharpness[others].max() < 0.9 * found.sharpness[best]


def test_curve_and_image_are_those_of_reconstructions(scan):
    g, found = scan

    def image(speed):
        stretched = SETUP.replace(radii=SETUP.radii * speed / 1470)
        return reconstruct(stretched, g, 1e-3, low_pass=cosine_filter)

    for i in (0, 2):
        alone = (SPEEDS[i] / 1470) ** 2 * sharpness(image(SPEEDS[i]), GRID, REGION)
        assert np.allclose(found.sharpness[i], alone, rtol=1e-9)
    assert np.allclose(found.image, image(found.sound_speed), atol=1e-9)
    speeds = found.sound_speed + np.array([-0.5, 0.0, 0.5])
    low, top, high = (float(c**2 * sharpness(image(c), GRID, REGION)) for c in speeds)
    assert max(low, high) < top
    assert abs(high - low) < 0.01 * (2 * top - low - high)  # the slope there is zero


def test_a_compiled_search_agrees_and_says_that_the_range_was_too_narrow(scan):
    """With one that is not compiled, of other speeds."""
    g, found = scan

    @jax.jit
    def search(speeds):
        return sound_speed_by_sharpness(SETUP, g, speeds, sound_speed=1470.0)

    again = search(found.sound_speed + np.linspace(-30.0, 25.0, 9))
    assert again.converged
    assert np.allclose(again.sound_speed, found.sound_speed, rtol=1e-6)
    assert not search(SPEEDS + 90).converged  # the first is the sharpest


@pytest.mark.parametrize(
    ("speeds", "message"),
    [
        ([1500.0, 1510.0], "at least 3"),
        ([1500.0, 1490.0, 1510.0], "increasing"),
        ([-1.0, 1490.0, 1510.0], "above zero"),
        (np.linspace(1510.0, 1590.0, 9), "widen their range"),
    ],
)
def test_speeds_that_will_not_do(scan, speeds, message):
    with pytest.raises(ValueError, match=message):
        sound_speed_by_sharpness(SETUP, scan[0], speeds, sound_speed=1470.0)


def test_an_image_of_another_grid_is_refused():
    with pytest.raises(ValueError, match="image has shape"):
        sharpness(jnp.ones((5, 5)), GRID)
