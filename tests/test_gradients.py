"""Derivatives of an image through plan and reconstruction: everywhere finite, without retracing.

In the number of one rule: those of the others are in regularization/test_filtered_solve.py.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    NormBound,
    Setup,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    phantoms,
    reconstruct,
)

BELL = phantoms.Bells([[-0.5, 0.1]], [0.4])
AT = np.array([1.8, 1.3, 0.0, 1.0, 0.7])  # K, radius of the arc, cut, speed of sound, filter


@pytest.fixture(scope="module")
def setup():
    """The paper's geometry 2, small."""
    curve, region = circular_arc(1.3, 0.0, 40), disk(1.0, 0.0)
    radii = data_radii(curve, region, 0.1)
    return Setup(curve, region, ImageGrid(11), radii, max_frequency=10.0, n_directions=8)


@pytest.fixture(scope="module")
def data(setup):
    return np.asarray(BELL.circular_integrals(setup.curve, setup.radii))


@pytest.fixture(scope="module")
def derived(setup):
    """Size of an image, its slope in K by forward mode, and all slopes by reverse mode.

    In one program for all tests. By collocation: reconstruction/test_plan.py.
    """
    traced = []

    @jax.jit
    def at(numbers, g):
        traced.append(1)

        def loss(numbers):
            K, radius, cut, speed, eta = numbers
            curve = eqx.tree_at(lambda arc: arc.radius, setup.curve, radius)
            moved = setup.replace(curve=curve, region=disk(1.0, cut), radii=speed * setup.radii)
            plan = build_plan(moved, NormBound(K))
            image = reconstruct(plan, g, low_pass=lambda share: jnp.cos(jnp.pi / 2 * share * eta))
            return 1e3 * jnp.mean(image**2)

        value, forward = jax.jvp(loss, (numbers,), (jnp.eye(5)[0],))
        return value, forward, jax.grad(loss)(numbers)

    at.traced = traced
    return at


@pytest.mark.slow
def test_no_gradient_is_nan_along_K(derived, data):
    """Circles and mirror symmetry make singular values pair up, and low ranks cut between them."""
    for K in np.linspace(1.0, 10.0, 10):
        for found in derived(np.array([K, *AT[1:]]), data):
            assert np.isfinite(found).all(), K


def test_slopes_are_those_of_differences(derived, data):
    """Where differences are smooth: the part of a term that is just admitted goes with a root."""
    _, _, slopes = derived(AT, data)
    for i, tolerance in enumerate((1e-5, 1e-5, 1e-5, 1e-6, 1e-6)):
        step = np.zeros(5)
        step[i] = 1e-5 * (AT[i] or 1.0)
        ahead, behind = (float(derived(AT + s, data)[0]) for s in (step, -step))
        difference = (ahead - behind) / (2 * step[i])
        assert np.isclose(float(slopes[i]), difference, rtol=tolerance, atol=0), i


def test_both_modes_agree_where_a_term_is_rounding(derived, data):
    """A large bound lets terms in whose amplitudes are rounding over sigma_j: 1e-14 of sigma_1."""
    noisy = data + 0.1 * np.random.default_rng(0).standard_normal(data.shape)
    _, forward, backward = derived(np.array([5e4, *AT[1:]]), noisy)
    np.testing.assert_allclose(backward[0], forward, rtol=1e-6)


def test_new_numbers_need_no_new_program(derived, data):
    derived.traced.clear()
    for scale in (1.0, 1.01, 1.02):
        derived(np.array([3.0 * scale, 1.3 * scale, 0.01 * scale, scale, 0.5 * scale]), data)
    assert len(derived.traced) <= 1  # none if other tests have compiled it
