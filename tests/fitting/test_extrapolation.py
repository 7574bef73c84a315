"""What the last steps of an iteration lead to: exact for linear ones, harmless for others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxtat
from jaxtat import ImageGrid, model_based
from jaxtat.fitting import fit
from jaxtat.fitting.extrapolation import ROUND, M, extrapolated, trail


def inner_products(moves):
    flat = jnp.concatenate([jax.tree.leaves(moves)[k].reshape(M, -1) for k in (0, 1)], axis=1)
    return flat @ flat.T


def run(step, state, n):
    """States after each of n steps."""
    path, states = trail(state), []
    for count in range(1, n + 1):
        state, path = extrapolated(path, step(state), jnp.asarray(count), inner_products)
        states.append(state)
    return states


def linear(factors):
    """Towards ones, by these factors along orthogonal directions of two arrays."""
    q = np.linalg.qr(np.random.default_rng(0).standard_normal((6, 6)))[0]
    matrix = jnp.asarray(q[:, : len(factors)] * factors @ q[:, : len(factors)].T)
    flat = lambda state: jnp.concatenate([state["u"].ravel(), state["p"]])  # noqa: E731

    def step(state):
        left = matrix @ (flat(state) - 1)
        return {"u": 1 + left[:4].reshape(2, 2), "p": 1 + left[4:]}

    start = jnp.asarray(1 + q[:, : len(factors)].sum(axis=1))
    return step, {"u": start[:4].reshape(2, 2), "p": start[4:]}


def test_two_directions_are_left_out_at_once():
    step, start = linear([0.9, 0.3])
    states = run(step, start, ROUND)
    away = [float(abs(state["u"] - 1).max()) for state in states]
    assert away[ROUND - 2] > 0.1
    assert away[ROUND - 1] < 1e-2 * away[ROUND - 2]
    assert_allclose(states[-1]["p"], 1, atol=1e-2)


def test_of_more_directions_the_slow_ones_are_left_out():
    step, start = linear([0.95, 0.8, 0.1])
    plain = start
    for _ in range(2 * ROUND):
        plain = step(plain)
    found = run(step, start, 2 * ROUND)[-1]
    assert abs(found["u"] - 1).max() < 5e-2 * abs(plain["u"] - 1).max()


def test_an_iteration_that_stands_still_stays_there():
    still = {"u": jnp.ones((2, 2)), "p": jnp.ones(2)}
    for state in run(lambda state: state, still, 2 * ROUND):
        assert_allclose(state["u"], 1)


def test_a_round_of_long_steps_is_not_combined():
    """A jump to far away after the first round: the second one is left as it is."""
    step, start = linear([0.9, 0.8, 0.5])
    path, state = trail(start), start
    for count in range(1, 2 * ROUND + 1):
        plain = step(state)
        if count == ROUND + 1:
            plain = jax.tree.map(lambda x: x + 1e3, plain)
        state, path = extrapolated(path, plain, jnp.asarray(count), inner_products)
    assert_allclose(state["p"], plain["p"])


@pytest.mark.slow
@pytest.mark.parametrize("nonnegative", [False, True])
def test_fits_end_at_the_same_minimum_in_fewer_steps(monkeypatch, nonnegative):
    curve = jaxtat.circular_arc(1.3, 1.0, 60)
    setup = jaxtat.Setup(curve, jaxtat.disk(1.0), ImageGrid(33), max_frequency=40.0)
    disks = jaxtat.phantoms.Disks([[0.2, 0.1], [-0.3, -0.4]], [0.3, 0.2], [1.0, 0.6])
    g = disks.circular_integrals(curve, setup.radii)
    g = g + 0.05 * jnp.std(g) * np.random.default_rng(1).standard_normal(g.shape)
    asked = {"nonnegative": nonnegative, "weight": 0.05, "max_steps": 4000}
    end = model_based(setup, g, tolerance=1e-7, **asked).image
    found = model_based(setup, g, tolerance=1e-4, **asked)
    with monkeypatch.context() as patch:
        last = lambda path, state, *_: (state, path)  # noqa: E731
        patch.setattr(fit, "extrapolated", last)
        jax.clear_caches()
        plain = model_based(setup, g, tolerance=1e-4, **asked)
    jax.clear_caches()
    size = jnp.linalg.norm(end)
    assert jnp.linalg.norm(found.image - end) < 1e-3 * size
    assert jnp.linalg.norm(plain.image - end) < 1e-3 * size
    assert int(found.steps) < int(plain.steps)
