"""The kernels against what defines them."""

import numpy as np
from scipy.interpolate import BSpline

from jaxtat.base.interpolation import QUINTIC, quintic_prefilter

T = np.linspace(0, 0.999, 30)


def kernel_weights(kernel, t):
    """Weights of the nodes at t, read off the table."""
    return np.stack([np.polynomial.polynomial.polyval(np.asarray(t), row) for row in kernel])


def test_spline_kernel_is_the_quintic_b_spline():
    basis = BSpline.basis_element(np.arange(-3, 4), extrapolate=False)
    weights = kernel_weights(QUINTIC, T)
    for row, node in zip(weights, range(-2, 4), strict=True):
        assert np.allclose(row, np.nan_to_num(basis(T - node)), atol=1e-15)


def test_prefiltered_spline_interpolates_waves():
    n, k = 32, 5
    wave = np.cos(2 * np.pi * k * np.arange(n) / n)
    coefficients = wave * quintic_prefilter(np.array([2 * np.pi * k / n]))[0]
    taps = kernel_weights(QUINTIC, np.zeros(1))[:5, 0]  # at a node: 1, 26, 66, 26, 1 of 120
    at_nodes = sum(w * np.roll(coefficients, j) for j, w in zip(range(-2, 3), taps, strict=True))
    assert np.allclose(at_nodes, wave, atol=1e-15)
