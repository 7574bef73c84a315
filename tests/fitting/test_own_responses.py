"""Fits to records of elements in the plane that have responses of their own."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, Setup, circular_arc, disk, model_based, phantoms
from jaxtat.fitting import Ridge
from jaxtat.fitting.arguments import data_fits
from jaxtat.records import (
    apply_impulse_response,
    circular_integrals_to_pressure,
    condition_record,
)

N, TAPS = 12, 9
TIMES = np.linspace(0.1, 4.5, 141)
BAND_PASS = partial(condition_record, times=TIMES, band=(0.2, 6.0), baseline=False)


@pytest.fixture(scope="module")
def setup():
    return Setup(circular_arc(1.3, 1.0, N), disk(1.0), ImageGrid(17), max_frequency=14.0)


@pytest.fixture(scope="module")
def responses():
    """Of different strength, delay and shape."""
    rng = np.random.default_rng(1)
    return np.eye(TAPS)[4] * rng.uniform(0.5, 1.5, (N, 1)) + 0.3 * rng.normal(size=(N, TAPS))


def operator(setup, model, conditioning, responses):
    recorded = TIMES, 1.0, model, conditioning, responses
    return data_fits(setup, recorded, False, None, None, None, None, [setup.grid])[0].operator


@pytest.mark.parametrize("conditioning", [None, BAND_PASS])
@pytest.mark.parametrize(("model", "error"), [("2d", 1e-12), ("in-plane", 2e-2)])
def test_what_is_modelled_is_the_record_of_each_element(
    setup, responses, model, error, conditioning
):
    """In-plane but for waves that the band limit leaves outside of the region, which are cut."""
    image = phantoms.Bells([[0.2, -0.1]], [0.7]).image(setup.grid)
    pressure = operator(setup, model, None, None)(image)
    expected = apply_impulse_response(pressure, responses, origin=TAPS // 2)
    expected = expected if conditioning is None else conditioning(expected)
    A = operator(setup, model, conditioning, responses)
    found = A(image)
    assert jnp.abs(found - expected).max() < error * jnp.abs(expected).max()
    assert jnp.abs(found - pressure).max() > 0.1 * jnp.abs(pressure).max()
    data = np.random.default_rng(2).normal(size=found.shape)
    np.testing.assert_allclose(jnp.vdot(data, found), jnp.vdot(A.T(data), image), rtol=1e-11)


def test_the_object_is_found_through_them(setup, responses):
    bells = phantoms.Bells([[0.2, -0.1]], [0.7])
    g = bells.circular_integrals(setup.curve, setup.radii)
    pressure = circular_integrals_to_pressure(g, setup.radii, TIMES)
    record = apply_impulse_response(pressure, responses, origin=TAPS // 2)
    exact = bells.image(setup.grid)

    def error(record, responses):
        given = {"times": TIMES, "nonnegative": True, "element_responses": responses}
        found = model_based(setup, record, **given).image
        return jnp.linalg.norm(found - exact) / jnp.linalg.norm(exact)

    alike = np.broadcast_to(responses.mean(axis=0), responses.shape)
    assert error(record, responses) < 1.2 * error(pressure, None)
    assert error(record, alike) > 2.5 * error(record, responses)


@pytest.mark.slow
def test_derivatives_in_responses_are_those_of_differences(setup, responses):
    g = phantoms.Bells([[0.2, -0.1]], [0.7]).circular_integrals(setup.curve, setup.radii)
    record = circular_integrals_to_pressure(g, setup.radii, TIMES)
    given = {"penalty": Ridge(), "weight": 1e-2, "tolerance": 1e-12, "max_steps": 20000}
    weights = np.random.default_rng(3).uniform(0.5, 1, setup.grid.shape)

    @jax.jit
    def energy(responses):
        found = model_based(setup, record, times=TIMES, element_responses=responses, **given)
        return jnp.sum(weights * found.image**2)

    along = np.random.default_rng(4).normal(size=responses.shape)
    slope = jnp.vdot(jax.grad(energy)(responses), along)
    _, forwards = jax.jvp(energy, (responses,), (along,))
    step = 1e-5
    difference = (energy(responses + step * along) - energy(responses - step * along)) / (2 * step)
    np.testing.assert_allclose([slope, forwards], difference, rtol=1e-6)


def test_others_than_one_of_each_element_are_refused(setup):
    record = np.ones((N, len(TIMES)))
    with pytest.raises(ValueError, match=r"element_responses has shape \(9,\)"):
        model_based(setup, record, times=TIMES, element_responses=np.ones(TAPS))
    with pytest.raises(ValueError, match="expected one sample of each"):
        model_based(setup, record, times=TIMES, element_responses=np.ones((N, 0)))
