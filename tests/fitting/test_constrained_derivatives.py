"""Derivatives of fitted images in what the model is made of, against differences.

In reverse mode; `test_model_based` compares it with forward mode.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, Setup, VolumeGrid, circular_arc, disk, model_based, phantoms
from jaxtat.fitting import Ridge
from jaxtat.forward import pressure_terms
from jaxtat.reconstruction import operator_on
from jaxtat.records import circular_integrals_to_pressure
from jaxtat.spherical import SolidBells, ball, spherical_cap


def of_pressure():
    """By width of the elements and speed of sound."""
    arc = circular_arc(1.3, 1.0, 12, element_width=0.3)
    setup = Setup(arc, disk(1.0), ImageGrid(13), max_frequency=12.0)
    times = jnp.linspace(0.1, 2.5, 61)
    g = phantoms.Bells([[0.2, -0.3]], [0.6]).circular_integrals(arc, setup.radii)
    pressure = circular_integrals_to_pressure(g, setup.radii, times)

    def image(scales):
        moved = setup.replace(curve=replace(arc, element_width=0.3 * scales[0]))
        recorded = {"times": times, "sound_speed": scales[1]}
        given = {"penalty": Ridge(), "weight": 1e-2, "tolerance": 1e-12, "max_steps": 20000}
        return model_based(moved, pressure, **recorded, **given).image

    return image, setup.grid.shape


def of_pressure_in_space():
    """By start of the record and speed of sound, of detectors on rings."""
    rings = spherical_cap(1.5, 1.0, 6, 12)
    setup = Setup(rings, ball(1.0), VolumeGrid(7), max_frequency=5.0)
    times = jnp.linspace(0.3, 2.6, 24)
    modelled = operator_on(setup, setup.grid, record=pressure_terms(setup.sizes.inside, times))
    pressure = modelled(SolidBells([[0.2, -0.1, 0.1]], [0.8]).volume(setup.grid))

    def image(scales):
        recorded = {"times": times + 0.1 * scales[0] - 0.1, "sound_speed": scales[1]}
        given = {"penalty": Ridge(), "weight": 1e-2, "tolerance": 1e-12, "max_steps": 20000}
        return model_based(setup, pressure, **recorded, **given).image

    return image, setup.grid.shape


@pytest.mark.slow
@pytest.mark.parametrize("of", [of_pressure, of_pressure_in_space])
def test_derivatives_are_those_of_differences(of):
    image, shape = of()
    weights = np.random.default_rng(0).uniform(0.5, 1, shape)

    @jax.jit
    @jax.value_and_grad
    def energy(scales):
        return jnp.sum(weights * image(scales) ** 2)

    slopes, along = energy(np.ones(2))[1], np.array([0.6, -0.8])
    far, near = (float(energy(1 + h * along)[0]) for h in (1e-4, -1e-4))
    np.testing.assert_allclose(slopes @ along, (far - near) / 2e-4, rtol=1e-5)
    assert abs(slopes).min() > 1e-3
