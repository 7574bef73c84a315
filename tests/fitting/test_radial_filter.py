"""The high-pass over radii: its differential equation, the spectrum of data, dense equations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

import jaxtat
from jaxtat import model_based
from jaxtat.fitting import Ridge
from jaxtat.fitting.arguments import data_fits
from jaxtat.fitting.radial_filter import high_pass
from jaxtat.reconstruction import operator_on
from jaxtat.spherical import ball, spherical_cap


def test_it_solves_its_equation_on_uneven_radii():
    """H g = g - λ0 ∫ exp(-λ0 (r - s)) g(s) ds for a g that is zero at the first radius."""
    cutoff = 3.0
    radii = np.cumsum(np.random.default_rng(0).uniform(0.005, 0.015, 300))
    g = lambda r: np.sin(5 * (r - radii[0])) ** 2  # noqa: E731
    found = high_pass(jnp.asarray(radii), cutoff) @ g(radii)
    for k in (10, 120, 299):
        past = quad(lambda s: np.exp(-cutoff * (radii[k] - s)) * g(s), radii[0], radii[k])[0]  # noqa: B023
        assert_allclose(found[k], g(radii[k]) - cutoff * past, atol=2e-4)


def test_sines_are_damped_as_the_formula_says():
    frequencies, radii = np.array([0.3, 1.0, 4.0]), np.linspace(0, 40, 2001)
    waves = np.asarray(high_pass(jnp.asarray(radii), 1.0)) @ np.sin(np.outer(radii, frequencies))
    late = waves[800:]  # after their start
    assert_allclose(late.max(axis=0) ** 2, frequencies**2 / (frequencies**2 + 1), rtol=2e-3)


@pytest.fixture(scope="module")
def whole():
    """A sphere of detectors, which see every direction twice."""
    sphere = spherical_cap(1.5, 1.5, 40, 96)
    return jaxtat.Setup(sphere, ball(1.0), jaxtat.VolumeGrid(25))


def test_data_determine_coarse_and_fine_details_alike(whole):
    """||H A f||² of waves in a bell is c / (|xi|² + λ0²) ||f||² with one c."""
    (fit,) = data_fits(whole, None, False, 1.0, None, None, None, [whole.grid])
    points, cutoff = whole.grid.points, 1 / float(whole.grid.spacing[0])
    bell = jnp.maximum(1 - jnp.sum(points**2, axis=-1) / 0.8**2, 0) ** 2
    frequencies = np.array([10.0, 15.0, 21.0, 30.0])
    assert frequencies[-1] < np.pi * cutoff
    direction = np.array([0.48, 0.6, 0.64])
    waves = jnp.stack([bell * jnp.cos(f * points @ direction) for f in frequencies])
    sizes = jnp.sum(waves**2, axis=(1, 2, 3))
    data = fit.modelled(waves)
    plain = jnp.sum(data**2, axis=(1, 2, 3)) / sizes
    passed = jax.vmap(fit.misfit)(data) / sizes
    assert_allclose(plain * frequencies**2 / plain[1] / frequencies[1] ** 2, 1, atol=0.1)
    expected = passed * (frequencies**2 + cutoff**2)
    assert_allclose(expected / expected[1], 1, atol=0.1)


def test_the_transpose_holds_it(cap):
    """<H B f, H B h> = <f, B^T H^T H B h>, with noise that differs and data that are left out."""
    random = np.random.default_rng(2)
    noise = random.uniform(0.5, 2, cap.data_shape)
    mask = random.uniform(size=cap.data_shape) > 0.2
    (fit,) = data_fits(cap, None, False, noise, mask, None, None, [cap.grid])
    f, h = jnp.asarray(random.standard_normal((2, 1, *cap.grid.shape)))
    b, d = fit.modelled(f), fit.modelled(h)
    product = (fit.misfit(b + d) - fit.misfit(b - d)) / 4
    assert_allclose(jnp.sum(f * fit.transposed(d)), product, rtol=1e-10)


@pytest.fixture(scope="module")
def small():
    """A few voxels, and the data of a bell."""
    sphere = spherical_cap(1.5, 1.5, 8, 16)
    setup = jaxtat.Setup(sphere, ball(1.0), jaxtat.VolumeGrid(7), max_frequency=5.0)
    bell = jaxtat.spherical.SolidBells([[0.1, 0.0, 0.2]], [0.7])
    return setup, bell.spherical_integrals(sphere, setup.radii)


def test_ridge_is_what_dense_equations_give(small):
    setup, g = small
    inside = np.asarray(setup.region.contains(setup.grid.points)).ravel()
    a = np.asarray(operator_on(setup, setup.grid).as_matrix())[:, inside]
    h = np.asarray(high_pass(setup.radii, 1 / setup.grid.spacing[0]))
    a, b = (
        (x.reshape(*setup.data_shape, -1).swapaxes(-1, -2) @ h.T).swapaxes(-1, -2)
        for x in (a, np.asarray(g))
    )
    a, b = a.reshape(-1, inside.sum()), b.ravel()
    given = {"weight": 0.3, "noise": 0.5, "tolerance": 1e-10}
    found = model_based(setup, g, penalty=Ridge(), **given)
    wanted = np.linalg.solve(a.T @ a / 0.25 + 0.3 * np.eye(inside.sum()), a.T @ b / 0.25)
    assert_allclose(found.image.ravel()[inside], wanted, atol=1e-7)


@pytest.mark.slow
def test_derivatives_are_those_of_differences(small):
    """Forward and reverse mode are compared in the plane."""
    setup, g = small
    weights = np.random.default_rng(0).uniform(0.5, 1, setup.grid.shape)
    given = {"penalty": Ridge(), "weight": 1e-1, "noise": 1.0, "tolerance": 1e-12}

    @jax.jit
    @jax.value_and_grad
    def energy(scales):
        moved = setup.replace(radii=setup.radii * scales[0])
        found = model_based(moved, scales[1] * g, max_steps=20000, **given)
        return jnp.sum(weights * found.image**2)

    slopes, along = energy(np.ones(2))[1], np.array([0.6, -0.8])
    far, near = (float(energy(1 + h * along)[0]) for h in (1e-4, -1e-4))
    assert_allclose(slopes @ along, (far - near) / 2e-4, rtol=1e-4)
    assert abs(slopes).min() > 1e-3


def test_few_steps_find_the_edges_of_a_ball_in_single_precision(cap):
    """In as many steps as the plane needs; without the high-pass it would be about a hundred."""
    balls = jaxtat.spherical.Balls([[0.1, 0.0, 0.2]], [0.5], [1.0])
    bells = jaxtat.spherical.SolidBells([[0.1, 0.0, 0.2]], [0.7])
    for phantom in (balls, bells):
        g = phantom.spherical_integrals(cap.curve, cap.radii)
        noise = jaxtat.phantoms.noise_like(jax.random.key(0), g, 0.02)
        options = {"noise": float(noise.std()), "nonnegative": True, "dtype": jnp.float32}
        options["tolerance"] = 2e-2
        found = model_based(cap, g + noise, **options)
        assert found.image.dtype == jnp.float32
        assert found.converged and int(found.steps) <= 60
    wanted = bells.volume(cap.grid)
    assert float(jnp.linalg.norm(found.image - wanted) / jnp.linalg.norm(wanted)) < 0.1
