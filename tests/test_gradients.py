"""Derivatives of an image through plan and reconstruction: everywhere finite, without retracing."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    FixedRank,
    ImageGrid,
    NormBound,
    Setup,
    SingularValueCutoff,
    Tikhonov,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    phantoms,
    reconstruct,
)

BELL = phantoms.Bells([[-0.5, 0.1]], [0.4])
RULES = {
    "K": (NormBound, 1.8),
    "j_max": (FixedRank, 12.3),
    "sigma_min": (SingularValueCutoff, 0.05),
    "alpha": (Tikhonov, 1e-3),
}


@pytest.fixture(scope="module")
def setup():
    """The paper's geometry 2, small."""
    curve, region = circular_arc(1.3, 0.0, 40), disk(1.0, 0.0)
    radii = data_radii(curve, region, 0.1)
    return Setup(curve, region, ImageGrid(11), radii, max_frequency=10.0, n_directions=8)


@pytest.fixture(scope="module")
def gradient(setup):
    """Value and slopes of an image in a rule's number, radius of the arc, cut of the region, speed
    of sound and filter, compiled once for each rule. For geometry 1 see test_plan.py."""
    g = BELL.circular_integrals(setup.curve, setup.radii)
    traced = []

    @eqx.filter_jit
    def of(kind, *numbers):
        traced.append(kind)

        def loss(number, radius, cut, speed, eta):
            curve = eqx.tree_at(lambda arc: arc.radius, setup.curve, radius)
            moved = setup.replace(curve=curve, region=disk(1.0, cut), radii=speed * setup.radii)
            plan = build_plan(moved, kind(number))
            image = reconstruct(plan, g, low_pass=lambda share: jnp.cos(jnp.pi / 2 * share * eta))
            return 1e3 * jnp.mean(image**2)

        return jax.value_and_grad(loss, range(5))(*numbers)

    def at(kind, number, radius=1.3, cut=0.0, speed=1.0, eta=0.7):
        # of one type: a number of Python's own has a weaker one, and would make another program
        return of(kind, *(jnp.asarray(x, float) for x in (number, radius, cut, speed, eta)))

    at.traced = traced
    return at


def test_no_gradient_is_nan_along_K_and_j_max(gradient):
    """Circles and mirror symmetry make singular values pair up, and low ranks cut between them."""
    for kind, values in (
        (NormBound, np.linspace(1.0, 10.0, 10)),
        (FixedRank, np.linspace(1.0, 200.0, 21)),
    ):
        for value in values:
            loss, slopes = gradient(kind, float(value))
            assert np.isfinite(loss)
            assert np.isfinite(slopes).all(), (kind, value)


@pytest.mark.parametrize("name", RULES)
def test_slopes_are_those_of_differences(gradient, name):
    """Where differences are smooth: the part of a term that is just admitted goes with a root."""
    kind, number = RULES[name]
    cut = 1e-6 if name == "alpha" else 1e-5
    at = np.array([number, 1.3, 0.0, 1.0, 0.7])
    _, slopes = gradient(kind, *at)
    for i, tolerance in enumerate((cut, cut, cut, 1e-6, 1e-6)):
        step = np.zeros(5)
        step[i] = 1e-5 * (at[i] or 1.0)
        ahead, behind = (float(gradient(kind, *(at + s))[0]) for s in (step, -step))
        difference = (ahead - behind) / (2 * step[i])
        assert np.isclose(float(slopes[i]), difference, rtol=tolerance, atol=0), (name, i)


def test_new_numbers_need_no_new_program(gradient):
    gradient.traced.clear()
    for scale in (1.0, 1.01, 1.02):
        gradient(NormBound, 3.0 * scale, 1.3 * scale, 0.01 * scale, scale, 0.5 * scale)
    assert len(gradient.traced) <= 1  # none if other tests have compiled it


def test_positions_need_no_new_program(setup):
    """Detectors one by one, and all else about the geometry."""
    g = BELL.circular_integrals(setup.curve, setup.radii)

    @jax.jit
    def image(points, alpha):
        center = points.mean(axis=0) - setup.curve.points.mean(axis=0)
        moved = setup.replace(curve=eqx.tree_at(lambda arc: arc.center, setup.curve, center))
        return reconstruct(build_plan(moved, Tikhonov(alpha)), g)

    for shift in (0.0, 0.01, 0.02):
        assert np.isfinite(image(setup.curve.points + shift, jnp.array(1e-3 + shift))).all()
    assert image._cache_size() == 1


def test_both_modes_agree_where_a_term_is_rounding(half_arc):
    """A large bound lets terms in whose amplitudes are rounding over sigma_j."""
    bell = phantoms.Bells([[-0.45, 0.3]], [0.35])
    g = bell.circular_integrals(half_arc.curve, half_arc.radii)
    g = g + phantoms.noise_like(jax.random.key(0), g, 0.15)

    def size(K):
        image = reconstruct(build_plan(half_arc, NormBound(K)), g)
        return jnp.linalg.norm(image)

    @jax.jit  # in one program, which is made sooner than two
    def both(K):
        return jax.jvp(size, (K,), (jnp.ones(()),))[1], jax.grad(size)(K)

    forward, backward = both(jnp.array(50.0))
    np.testing.assert_allclose(backward, forward, rtol=1e-6)
