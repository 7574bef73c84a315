"""Penalties and shrunk differences against definitions and a general-purpose minimiser."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from jaxtat.fitting import SecondOrderVariation, TotalVariation

RNG = np.random.default_rng(0)
IMAGES = jnp.asarray(RNG.standard_normal((2, 9, 8)))
PENALTIES = [
    TotalVariation(),
    SecondOrderVariation(),
    TotalVariation(joint=True),
]
NAMES = ["tv", "second order", "joint tv"]


@pytest.mark.parametrize("penalty", PENALTIES, ids=NAMES)
def test_flat_images_cost_nothing_but_the_rounding(penalty):
    value = jax.jit(lambda images: penalty.value(images, 1e-6))
    flat = np.full((2, 9, 8), 3.0)
    sizes = jax.eval_shape(lambda images: penalty.sizes(penalty.parts(images)), flat)
    assert_allclose(value(flat), 5e-7 * sizes.size, rtol=1e-6)
    assert float(value(np.asarray(IMAGES))) > 10


def test_values_are_those_of_the_formulas():
    f = np.asarray(IMAGES[0])
    d1, d2 = np.diff(f, axis=0, append=f[-1:]), np.diff(f, axis=1, append=f[:, -1:])
    one = TotalVariation().value(IMAGES[:1], 1e-12)
    assert_allclose(one, np.hypot(d1, d2).sum(), rtol=1e-9)
    both = TotalVariation(joint=True).value(jnp.stack([IMAGES[0], 2 * IMAGES[0]]), 1e-12)
    assert_allclose(both, np.sqrt(5) * one, rtol=1e-9)
    slope = jnp.arange(9.0)[:, None] + 2 * jnp.arange(8.0)
    inside = SecondOrderVariation().parts(slope[None])[:, 0, 1:-1, 1:-1]
    assert_allclose(inside, 0, atol=1e-12)  # a slope costs nothing inside
    x = np.arange(9.0)[:, None] ** 2 + 3 * np.arange(9.0)[:, None] * np.arange(8.0)
    parts = np.asarray(SecondOrderVariation().parts(jnp.asarray(x)[None]))[:, 0, 1:-1, 1:-1]
    assert_allclose(np.linalg.norm(parts, axis=0), np.sqrt(2**2 + 2 * 3**2), rtol=1e-12)


@pytest.mark.parametrize("penalty", PENALTIES, ids=NAMES)
def test_shrunk_differences_minimise(penalty):
    """Beside L-BFGS-B, of differences below, about and above the weight."""
    parts = penalty.parts(IMAGES)
    parts = parts * jnp.asarray(np.random.default_rng(1).uniform(0, 1, parts.shape[2:]))
    weight, delta = 0.4, 0.1

    @jax.jit
    @jax.value_and_grad
    def cost(u):
        u = u.reshape(parts.shape)
        sizes = penalty.sizes(u)
        huber = jnp.where(sizes > delta, sizes, sizes**2 / (2 * delta) + delta / 2)
        return jnp.sum((u - parts) ** 2) / 2 + weight * jnp.sum(huber)

    best = minimize(
        lambda u: tuple(map(np.asarray, cost(u))),
        np.asarray(parts).ravel(),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 5000, "maxfun": 10000, "ftol": 1e-15, "gtol": 1e-10},
    )
    found = penalty.shrunk(parts, weight, delta)
    assert float(cost(found.ravel())[0]) <= best.fun + 1e-9
    assert_allclose(found.ravel(), best.x, atol=2e-4)


def test_what_a_penalty_is_made_of_is_checked():
    with pytest.raises(ValueError, match="smoothing is 0"):
        TotalVariation(smoothing=0.0)
