"""Spherical Bessel and normalised Legendre functions against mpmath and scipy."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.special

from jaxtat.special import (
    decay_steps,
    legendre_functions,
    scaled_spherical_sequence,
    spherical_sequence,
)

X = np.array([1e-6, 1e-3, 0.3, 0.999, 1.001, 4.7, 33.0, 100.0, 261.4])
ORDERS = np.array([0, 1, 2, 7, 40, 99, 101, 260])


def exact(function, orders):
    """√(π/2x) J|Y_{l+1/2}(x) in 40 digits, large values cut."""
    with mpmath.workdps(40):
        root = [mpmath.sqrt(mpmath.pi / (2 * mpmath.mpf(float(x)))) for x in X]
        found = [
            [r * function(n + 0.5, float(x)) for r, x in zip(root, X, strict=True)] for n in orders
        ]
        return np.array([[float(max(v, mpmath.mpf(-1e150))) for v in row] for row in found])


def test_all_orders_against_mpmath():
    j, y = (np.asarray(v)[ORDERS] for v in spherical_sequence(260, X))
    j_exact, y_exact = exact(mpmath.besselj, ORDERS), exact(mpmath.bessely, ORDERS)
    amplitude = np.maximum(np.abs(y_exact), np.minimum(1.0, 1 / X))
    assert np.abs(j - j_exact).max() < 2e-15
    evanescent = (ORDERS[:, None] > X) & (np.abs(j_exact) > 1e-290)
    assert (np.abs(j / np.where(evanescent, j_exact, 1.0) - 1)[evanescent]).max() < 1e-13
    assert (np.abs(y - y_exact) / amplitude).max() < 2e-13


def test_derivatives_of_all_orders_against_scipy():
    x = np.linspace(0.2, 60.0, 40)
    tangent = jax.jit(lambda x: jax.jvp(lambda v: spherical_sequence(50, v), (x,), (jnp.ones(40),)))
    (j, y), (j_slope, y_slope) = jax.tree.map(np.asarray, tangent(x))
    n = np.arange(51)[:, None]
    np.testing.assert_allclose(j, scipy.special.spherical_jn(n, x), atol=1e-14)
    np.testing.assert_allclose(j_slope, scipy.special.spherical_jn(n, x, True), atol=1e-13)
    slope = scipy.special.spherical_yn(n, x, True)
    assert (np.abs(y_slope - slope) / np.maximum(np.abs(slope), 1 / x)).max() < 1e-12
    # Wronskian, DLMF 10.50.1; where the product neither over- nor underflows
    wronskian = (j * y_slope - j_slope * y) * x**2
    assert np.abs(wronskian - 1)[np.abs(y) < 1e140].max() < 1e-11


def test_scaled_products_where_the_factors_overflow():
    """j_l(x) y_l(1.3 x) -> -(1/1.3)^l / ((2l + 1) 1.3 x), l -> infinity."""
    x = np.array([2.0, 2.6])

    @jax.jit
    def scaled_and_plain(x):
        return *scaled_spherical_sequence(x, decay_steps(900, x[:1])), *spherical_sequence(40, x)

    j, y, plain_j, plain_y = map(np.asarray, scaled_and_plain(x))
    order = np.arange(901)
    product = j[:, 0] * y[:, 1] * (2 * order + 1) * 2.6 * 1.3**order
    assert np.abs(product[400:] + 1).max() < 3e-3  # (x² - y²) / 4l and higher
    np.testing.assert_allclose(j[:41, 0] * y[:41, 1], plain_j[:, 0] * plain_y[:, 1], rtol=1e-12)


def test_edges_of_the_domain():
    j, y = map(np.asarray, spherical_sequence(3, np.array([0.0, -1.0])))
    np.testing.assert_array_equal(j[:, 0], [1, 0, 0, 0])
    np.testing.assert_array_equal(y[:, 0], -1e150)
    assert np.isnan(j[:, 1]).all() and np.isnan(y[:, 1]).all()
    with pytest.raises(ValueError, match="l_max is -1"):
        spherical_sequence(-1, 1.0)


def test_legendre_functions_against_scipy_and_orthonormal():
    nodes, weights = np.polynomial.legendre.leggauss(64)
    orders = np.array([0, 1, 5, 30])
    found = np.asarray(legendre_functions(orders, 31, nodes, 30))
    for m, rows in zip(orders, found, strict=True):
        degrees = m + np.arange(31)
        exact = scipy.special.sph_harm_y(degrees[:, None], m, np.arccos(nodes), 0.0).real
        np.testing.assert_allclose(rows, (-1.0) ** m * exact, atol=2e-13)
        product = 2 * np.pi * (rows * weights) @ rows.T
        np.testing.assert_allclose(product, np.eye(31), atol=2e-13)


def test_legendre_functions_of_high_order_where_the_first_underflow():
    """Σ_m |Y_lm|² = (2l + 1)/4π needs all orders, also those with sin^m theta < 1e-100."""
    degree, t = 300, np.cos(np.array([0.3, 1.1, 2.9]))
    orders = np.arange(degree + 1)
    found = np.asarray(legendre_functions(orders, degree + 1, t, degree))
    rows = found[orders, degree - orders]
    total = (rows**2 * np.where(orders, 2, 1)[:, None]).sum(axis=0)
    np.testing.assert_allclose(total, (2 * degree + 1) / (4 * np.pi), rtol=1e-11)


def test_poles_and_derivative_of_legendre_functions():
    orders, degrees = np.arange(3), np.arange(4)
    poles = np.asarray(legendre_functions(orders, 4, np.array([1.0, -1.0]), 2))
    np.testing.assert_allclose(poles[0, :, 0], np.sqrt((2 * degrees + 1) / (4 * np.pi)), rtol=1e-14)
    np.testing.assert_allclose(poles[0, :, 1], poles[0, :, 0] * (-1.0) ** degrees, rtol=1e-14)
    assert not poles[1:].any()
    t = np.array([-0.7, 0.2])
    slopes = jax.jit(
        lambda t: jax.jvp(lambda t: legendre_functions(orders, 4, t, 2), (t,), (jnp.ones(2),))[1]
    )
    far, near = (np.asarray(legendre_functions(orders, 4, t + h, 2)) for h in (1e-5, -1e-5))
    np.testing.assert_allclose(slopes(t), (far - near) / 2e-5, atol=1e-8)
