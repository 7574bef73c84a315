"""What the last steps of an iteration lead to: exact for linear ones, harmless for others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxtat
from jaxtat import ImageGrid, model_based
from jaxtat.fitting import NoPenalty, Ridge, TotalVariation, fit
from jaxtat.fitting.arguments import checked_data, data_fits
from jaxtat.fitting.extrapolation import ROUND, M, empty_trail, extrapolated


def inner_products(moves):
    flat = jnp.concatenate([jax.tree.leaves(moves)[k].reshape(M, -1) for k in (0, 1)], axis=1)
    return flat @ flat.T


def run(step, state, n):
    """States after each of n steps."""
    path, states = empty_trail(state), []
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
    """All moves are zero: any shares of sum 1 will do, and there is no division by zero."""
    still = {"u": jnp.ones((2, 2)), "p": jnp.ones(2)}
    for state in run(lambda state: state, still, 2 * ROUND):
        assert_allclose(state["u"], 1)


def test_moves_that_are_not_numbers_are_not_combined():
    step, start = linear([0.9, 0.3])
    path, state = empty_trail(start), start
    for count in range(1, ROUND + 1):
        state, path = extrapolated(
            path, step(state), jnp.asarray(count), lambda _: jnp.full((M, M), jnp.nan)
        )
    plain = start
    for _ in range(ROUND):
        plain = step(plain)
    assert_allclose(state["p"], plain["p"])


def test_a_round_of_long_steps_is_not_combined():
    """A jump to far away after the first round: the second one is left as it is."""
    step, start = linear([0.9, 0.8, 0.5])
    path, state = empty_trail(start), start
    for count in range(1, 2 * ROUND + 1):
        plain = step(state)
        if count == ROUND + 1:
            plain = jax.tree.map(lambda x: x + 1e3, plain)
        state, path = extrapolated(path, plain, jnp.asarray(count), inner_products)
    assert_allclose(state["p"], plain["p"])


@pytest.fixture(scope="module")
def setup():
    curve = jaxtat.circular_arc(1.3, 1.0, 60)
    return jaxtat.Setup(curve, jaxtat.disk(1.0), ImageGrid(33), max_frequency=40.0)


@pytest.fixture(scope="module")
def noisy(setup):
    disks = jaxtat.phantoms.Disks([[0.2, 0.1], [-0.3, -0.4]], [0.3, 0.2], [1.0, 0.6])
    g = disks.circular_integrals(setup.curve, setup.radii)
    return g + 0.05 * jnp.std(g) * np.random.default_rng(1).standard_normal(g.shape)


@pytest.mark.slow
@pytest.mark.parametrize("nonnegative", [False, True])
def test_fits_end_at_the_same_minimum_in_fewer_steps(setup, noisy, monkeypatch, nonnegative):
    asked = {"nonnegative": nonnegative, "weight": 0.05, "max_steps": 4000}
    end = model_based(setup, noisy, tolerance=1e-7, **asked).image
    found = model_based(setup, noisy, tolerance=1e-4, **asked)
    with monkeypatch.context() as patch:
        patch.setattr(fit, "empty_trail", lambda state: None)
        jax.clear_caches()
        plain = model_based(setup, noisy, tolerance=1e-4, **asked)
    jax.clear_caches()
    size = jnp.linalg.norm(end)
    for each in (found, plain):
        assert bool(each.converged) and jnp.linalg.norm(each.image - end) < 1e-3 * size
    assert int(found.steps) < 0.9 * int(plain.steps)


@pytest.mark.slow
@pytest.mark.parametrize("most", [1, 2, 10, 19, 30, 50])
@pytest.mark.parametrize("penalty", [TotalVariation(), Ridge(), NoPenalty()])
def test_images_are_nonnegative_wherever_a_fit_ends(setup, noisy, penalty, most):
    weight = None if isinstance(penalty, NoPenalty) else 0.05
    options = {"penalty": penalty, "weight": weight, "nonnegative": True, "max_steps": most}
    found = model_based(setup, noisy, tolerance=1e-6, **options)
    assert float(found.image.min()) >= 0
    assert not bool(found.converged) and int(found.steps) in (most, most + 1)


@pytest.mark.slow
def test_what_is_carried_along_stays_that_of_the_image_in_single_precision(setup, noisy):
    """After fifty extrapolations B f is still that of f, to rounding."""
    (part,) = data_fits(setup, None, True, None, None, None, jnp.float32, [setup.grid])
    data, *_ = checked_data(noisy, part)
    weight = jnp.asarray(0.05, jnp.float32)
    level, state = fit.begun(part, data, TotalVariation(), weight, None, 500)
    state = fit._advance(level, TotalVariation(), False, state, jnp.asarray(1e-9), jnp.asarray(500))
    wanted = part.modelled(state.inner.free)
    off = jnp.linalg.norm(state.inner.fitted - wanted) / jnp.linalg.norm(wanted)
    assert float(off) < 1e-4
