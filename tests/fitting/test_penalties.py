"""Penalties and their proximal maps against definitions and a general-purpose minimiser."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from jaxtat.fitting import SecondOrderVariation, TotalVariation
from jaxtat.fitting.proximal import prox

RNG = np.random.default_rng(0)
IMAGES = jnp.asarray(RNG.standard_normal((2, 9, 8)))
PENALTIES = [
    TotalVariation(),
    SecondOrderVariation(),
    TotalVariation(joint=True),
]
NAMES = ["tv", "second order", "joint tv"]


@pytest.mark.parametrize("penalty", PENALTIES[:2], ids=NAMES[:2])
@pytest.mark.parametrize("shape", [(1, 12, 10), (1, 4, 5, 6)])
def test_the_bound_is_one_and_not_far(penalty, shape):
    """Joint ones have the same parts."""
    matrix = jax.jit(jax.jacfwd(lambda f: penalty.parts(f).ravel()))(np.zeros(shape))
    matrix = np.asarray(matrix).reshape(matrix.shape[0], -1)
    square = np.linalg.eigvalsh(matrix.T @ matrix)[-1]
    assert (
        0.2 * penalty.bound(len(shape) - 1) < square <= penalty.bound(len(shape) - 1) * (1 + 1e-12)
    )


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


@pytest.mark.parametrize(
    ("penalty", "nonnegative"),
    [*((penalty, False) for penalty in PENALTIES), (PENALTIES[0], True)],
    ids=[*NAMES, "tv, nonnegative"],
)
def test_proximal_maps_minimise(penalty, nonnegative):
    """Beside L-BFGS-B, which knows nothing of duals."""
    weight, delta = jnp.array(0.4), jnp.array(0.1)

    def allowed(images):
        return jnp.maximum(images, 0.0) if nonnegative else images

    dual = jnp.zeros(penalty.parts(IMAGES).shape)
    found, _ = jax.jit(lambda v: prox(penalty, v, weight, delta, allowed, dual, 3000))(IMAGES)

    @jax.jit
    @jax.value_and_grad
    def cost(u):
        u = u.reshape(IMAGES.shape)
        return jnp.sum((u - IMAGES) ** 2) / 2 + weight * penalty.value(u, delta)

    bounds = [(0.0 if nonnegative else None, None)] * IMAGES.size
    options = {"maxiter": 5000, "maxfun": 10000, "ftol": 1e-15, "gtol": 1e-10}
    start = np.asarray(allowed(IMAGES)).ravel()
    best = minimize(
        lambda u: tuple(map(np.asarray, cost(u))),
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options=options,
    )
    assert float(cost(found.ravel())[0]) <= best.fun + 1e-9
    assert_allclose(found.ravel(), best.x, atol=2e-4)


def test_what_a_penalty_is_made_of_is_checked():
    with pytest.raises(ValueError, match="smoothing is 0"):
        TotalVariation(smoothing=0.0)
