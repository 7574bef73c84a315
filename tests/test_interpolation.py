"""Cubic kernels against what defines them."""

import jax.numpy as jnp
import numpy as np
from scipy.interpolate import BSpline

from jaxtat.interpolation import (
    KEYS,
    SPLINE,
    cell_polynomials,
    polynomial,
    spline_prefilter,
)

T = np.linspace(0, 0.999, 30)


def kernel_weights(kernel, t):
    """Weights of nodes -1, 0, 1, 2 at t, read off the table."""
    return np.stack([np.polynomial.polynomial.polyval(np.asarray(t), row) for row in kernel])


def test_spline_kernel_is_the_cubic_b_spline():
    basis = BSpline.basis_element([-2, -1, 0, 1, 2], extrapolate=False)
    weights = kernel_weights(SPLINE, jnp.asarray(T))
    for row, node in zip(weights, (-1, 0, 1, 2), strict=True):
        assert np.allclose(row, np.nan_to_num(basis(T - node)), atol=1e-15)


def test_keys_kernel_interpolates_and_is_exact_for_parabolas():
    nodes = np.arange(-1.0, 3.0)
    weights = np.asarray(kernel_weights(KEYS, jnp.asarray(T)))
    for power in range(3):
        assert np.allclose(nodes**power @ weights, T**power, atol=1e-15)
    assert not np.allclose(nodes**3 @ weights, T**3, atol=1e-3)
    assert np.allclose(weights[:, 0], [0, 1, 0, 0])


def test_cell_polynomials_give_the_same_as_weights():
    values = np.random.default_rng(0).standard_normal(9)
    for kernel in (KEYS, SPLINE):
        cells = [np.asarray(c) for c in cell_polynomials(kernel, jnp.asarray(values))]
        weights = np.asarray(kernel_weights(kernel, jnp.asarray(T)))
        for j in range(6):
            direct = values[j : j + 4] @ weights
            assert np.allclose(
                polynomial([c[j] for c in cells], jnp.asarray(T)), direct, atol=1e-14
            )


def test_prefiltered_spline_interpolates_waves():
    n, k = 32, 5
    wave = np.cos(2 * np.pi * k * np.arange(n) / n)
    coefficients = wave * float(spline_prefilter(jnp.array(2 * np.pi * k / n)))
    at_nodes = (np.roll(coefficients, 1) + 4 * coefficients + np.roll(coefficients, -1)) / 6
    assert np.allclose(at_nodes, wave, atol=1e-15)
