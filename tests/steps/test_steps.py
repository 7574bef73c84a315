"""Steps 2 to 5, each against the exact transform of a phantom."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special as sp

from jaxtat import circular_arc, cosine_filter, phantoms
from jaxtat.densities import SampledDensities
from jaxtat.steps import (
    delayed_transform,
    offset_step,
    polar_fourier,
    polar_fourier_of_projections,
    radial_transform,
    radon_projections,
    total_integrals,
)
from jaxtat.steps.radial_transforms import radial_kernels

CENTER, WIDTH = np.array([0.3, -0.2]), 0.5
BELL = phantoms.Bells([CENTER], [WIDTH])
CURVE = circular_arc(1.3, 0.5, 24)
RADII = 0.3 + jnp.arange(257) / 128
N, STEP = 128, jnp.array(jnp.pi / 2)
FREQUENCIES = STEP * jnp.arange(1, N + 1)
ANGLES = jnp.arange(256) * jnp.pi / 256


def test_radial_transform_of_a_bell_is_known_by_the_addition_theorem():
    """∫ f(x) J0(k|x - z|) dx = 2π F(k) J0(k d) for radial f at distance d, and Y0 alike."""
    g = BELL.circular_integrals(CURVE, RADII)
    frequencies = jnp.array([1.0, 10.0, 60.0])
    found = np.asarray(radial_transform(g, RADII, frequencies))
    d = np.linalg.norm(np.asarray(CURVE.points) - CENTER, axis=1)
    at_origin = phantoms.Bells([[0.0, 0.0]], [WIDTH])
    radial = np.asarray(at_origin.fourier(frequencies, jnp.zeros(1)))[:, 0].real
    for i, lam in enumerate(np.asarray(frequencies)):
        for j, kernel in enumerate((sp.j0, sp.y0)):
            exact = 2 * np.pi * radial[i] * kernel(lam * d)
            assert np.abs(found[i, j] - exact).max() < 1e-9
    assert np.allclose(
        total_integrals(g, RADII), 2 * np.pi * at_origin.fourier([0.0], [0.0])[0, 0].real
    )


def moved(radii, jitter, seed):
    """By up to so many steps, but for the ends."""
    off = np.random.default_rng(seed).uniform(-jitter, jitter, len(radii)) * (radii[1] - radii[0])
    return jnp.asarray(radii).at[1:-1].add(off[1:-1])


UNEVEN = {
    "jitter 5 %": moved(RADII, 0.05, 0),
    "jitter 20 %": moved(RADII, 0.2, 1),
    "jitter 30 %": moved(RADII, 0.3, 2),
    "coarse, jitter 20 %": moved(RADII[::4], 0.2, 3),
    "growing": 0.3 + 2.0 * jnp.expm1(np.log(3) * jnp.arange(257) / 256) / 2,
}


@pytest.mark.parametrize("radii", UNEVEN.values(), ids=UNEVEN)
def test_radial_transform_is_as_right_for_uneven_radii(radii):
    """The bell fills 64 steps, 16 if coarse; by the trapezoid rule errors are 1e-4 to 2e-2."""
    frequencies = jnp.array([1.0, 10.0, 0.7 * jnp.pi / jnp.diff(radii).max()])
    exact = radial_transform(BELL.circular_integrals(CURVE, RADII), RADII, frequencies)
    g = BELL.circular_integrals(CURVE, radii)
    worst = 1e-9 if len(radii) > 65 else 2e-6
    assert np.abs(radial_transform(g, radii, frequencies) - exact).max() < worst
    delays = jnp.zeros(24)
    assert np.abs(delayed_transform(g, radii, frequencies, delays) - exact).max() < worst
    mass = 2 * np.pi * BELL.fourier([0.0], [0.0])[0, 0].real
    assert np.abs(total_integrals(g, radii) - mass).max() < worst


def test_equispaced_radii_are_summed_by_the_trapezoid_rule():
    frequencies = FREQUENCIES[::16]
    argument = np.asarray(frequencies)[:, None] * np.asarray(RADII)
    steps = np.full(257, 1 / 128)
    steps[[0, -1]] /= 2
    expected = np.stack([sp.j0(argument), sp.y0(argument)], axis=1) * steps
    assert np.abs(radial_kernels(RADII, frequencies) - expected).max() < 1e-14


@jax.jit
def transform(g, radii, frequencies):
    return radial_transform(g, radii, frequencies), total_integrals(g, radii)


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_derivatives_of_the_transform(check_both_modes, jitter):
    """Also where radii are equispaced and most of the weights are zero; without a new trace."""
    radii = moved(np.linspace(0.4, 1.2, 9), jitter, 4)
    g = jnp.asarray(np.random.default_rng(2).standard_normal((5, 9)))
    frequencies = jnp.array([2.0, 5.0])
    check_both_modes(transform, (g, radii, frequencies), rtol=1e-6)
    transform(g, radii, frequencies), transform(g, 1.01 * radii, frequencies)
    assert transform._cache_size() <= 1


def test_delayed_data_are_read_where_they_belong():
    frequencies, delays = jnp.array([1.0, 10.0, 60.0]), jnp.linspace(-0.1, 0.1, 24)
    exact = radial_transform(BELL.circular_integrals(CURVE, RADII), RADII, frequencies)
    late = jnp.stack(
        [
            BELL.circular_integrals(CURVE, RADII - delay)[k]  # the same bell, farther out
            for k, delay in enumerate(delays)
        ]
    )
    found = delayed_transform(late, RADII, frequencies, delays)
    assert np.abs(found - exact).max() < 1e-9
    zero = delayed_transform(late, RADII, frequencies, jnp.zeros(24))
    assert np.allclose(zero, radial_transform(late, RADII, frequencies), atol=1e-13)


def test_second_derivatives_of_the_delayed_transform(check_both_modes):
    """Those of a sum of squares, which standard errors of a calibration take."""
    g = jax.random.normal(jax.random.key(0), (3, 9))
    radii, delays = jnp.linspace(0.5, 1.3, 9), jnp.array([0.1, -0.1, 0.02])

    def energy(g, radii, delays):
        return jnp.sum(delayed_transform(g, radii, jnp.array([2.0, 5.0]), delays) ** 2)

    check_both_modes(jax.grad(energy, (0, 1, 2)), (g, radii, delays), 1e-6)


def test_polar_fourier_is_the_weighted_sum_it_states():
    rng = np.random.default_rng(0)
    transformed = jnp.asarray(rng.standard_normal((2, 3, 2, 24)))
    densities = jnp.asarray(rng.standard_normal((3, 5, 2, 24)) + 1j)
    mass = jnp.asarray(rng.standard_normal((2, 24)))
    weights = jnp.asarray(rng.uniform(0.5, 1, 24))
    found = polar_fourier(transformed, SampledDensities(densities), weights, mass)
    assert found.shape == (2, 4, 5)
    exact = np.einsum("k,bfjk,fdjk->bfd", weights, transformed, densities) / (2 * np.pi)
    assert np.allclose(found[:, 1:], exact)
    mean = np.asarray(mass) @ np.asarray(weights) / np.asarray(weights).sum() / (2 * np.pi)
    assert np.allclose(found[:, 0], mean[:, None])
    half = SampledDensities(densities).in_single_precision()
    assert half.values.dtype == jnp.complex64
    single = polar_fourier(transformed, half, weights, mass)
    assert single.dtype == jnp.complex128
    assert np.allclose(single, found, atol=1e-5)


def exact_fourier(phantom=BELL):
    return phantom.fourier(jnp.concatenate([jnp.zeros(1), FREQUENCIES]), ANGLES)


def test_projections_of_the_exact_transform_are_the_exact_projections():
    p = radon_projections(exact_fourier(), STEP, jnp.ones(N + 1))
    step = offset_step(STEP, N)
    offsets = (jnp.arange(2 * N) - N) * step
    assert np.isclose(step, 1 / 64)
    assert np.abs(np.asarray(p - BELL.radon(ANGLES, offsets))).max() < 1e-9
    back = polar_fourier_of_projections(p, step)
    assert np.abs(np.asarray(back - exact_fourier()))[:-1].max() < 1e-15


def test_low_pass_multiplies_the_transform():
    eta = cosine_filter(jnp.arange(N + 1) / N)
    filtered = radon_projections(exact_fourier(), STEP, eta)
    direct = radon_projections(exact_fourier() * eta[:, None], STEP, jnp.ones(N + 1))
    assert np.allclose(filtered, direct, atol=1e-16)
    assert np.isclose(eta[0], 1)
    assert np.isclose(eta[-1], 0, atol=1e-15)


def test_steps_do_not_retrace_for_new_numbers():
    traced = 0

    @jax.jit
    def project(fhat, step, eta):
        nonlocal traced
        traced += 1
        return radon_projections(fhat, step, eta)

    for scale in (1.0, 1.1, 1.2):
        project(scale * exact_fourier(), STEP * scale, jnp.ones(N + 1) * scale)
    assert traced == 1
