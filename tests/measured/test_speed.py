"""The search for the speed of sound: data of all speeds at once, and sharpness without images."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    circular_arc,
    data_radii,
    phantoms,
    problem_layout,
    sharpness,
    truncated_disk,
)
from jaxtat.measured.speed import _sharpness, _stretched, sharpest
from jaxtat.reconstruction import radial_transform
from jaxtat.reconstruction.direct import direct_arguments, polar_spectrum

CURVE, DISK, GRID = circular_arc(1.3, 1.3, 96), truncated_disk(0.8, 0.8, 96), ImageGrid(41, 0.8)
RADII = data_radii(CURVE, DISK, GRID.spacing[0])
STRETCHES = jnp.array([0.94, 1.0, 1.05])
HIGHEST = 50.0
LAYOUT = problem_layout(CURVE, DISK, GRID, RADII, max_frequency=HIGHEST)


def given(bells):
    g = bells.circular_integrals(CURVE, RADII)
    return direct_arguments(CURVE, DISK, GRID, RADII, g, 1e-8, None, LAYOUT)


def test_data_of_all_speeds_are_those_of_stretched_radii():
    arguments = given(phantoms.Bells([[0.1, -0.15]], [0.5]))
    found = _stretched(arguments, STRETCHES, LAYOUT).transformed
    for number, stretch in enumerate(STRETCHES):
        one = radial_transform(arguments.g, stretch * RADII, LAYOUT.frequencies)
        np.testing.assert_allclose(found[:, number], one, atol=1e-12 * np.abs(one).max())


def test_sharpness_without_an_image_is_the_images():
    """Up to a factor, of bells of two sizes; fhat² itself would be half as large. Times speed²."""
    wide, narrow = (phantoms.Bells([[0.1, -0.15]], [size]) for size in (0.6, 0.45))
    values, exact = [], []
    for bells in (wide, narrow):
        arguments = given(bells)
        data = _stretched(arguments, STRETCHES, LAYOUT)
        fhat, _ = polar_spectrum(arguments.geometry, data, LAYOUT)
        values.append(np.asarray(_sharpness(fhat, arguments.eta, STRETCHES, LAYOUT)))
        exact.append(float(sharpness(bells.image(ImageGrid(201, 0.8)), ImageGrid(201, 0.8))))
    assert values[1][1] / values[0][1] == pytest.approx(exact[1] / exact[0], rel=0.01)
    twice = _sharpness(fhat, arguments.eta, 2 * STRETCHES, LAYOUT)
    np.testing.assert_allclose(twice, 4 * values[1], rtol=1e-12)


def test_no_speed_is_believed_that_hardly_stands_out():
    speed, why = sharpest(lambda speeds: 1 + 0.04 * np.exp(-(((speeds - 0.99) / 0.01) ** 2)))
    assert speed == 1.0
    assert "no other within 7 %" in why
    speed, why = sharpest(lambda speeds: 1 + 0.3 * np.exp(-(((speeds - 0.9837) / 0.01) ** 2)))
    assert speed == pytest.approx(0.9837, abs=1e-5)
    assert why == "the image is sharpest, by 30%; none in the file"
