"""Waves through a circle between two media, against mpmath and the equations at the rim."""

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.special as sp

from jaxtat.special import transmitted_factors


def exact(n, inner, outer, density):
    """t_n in 60 digits."""
    with mpmath.workdps(60):
        x, y = mpmath.mpf(inner), mpmath.mpf(outer)

        def hankel(n):
            return mpmath.besselj(n, y) + 1j * mpmath.bessely(n, y)

        slope = (mpmath.besselj(n - 1, x) - mpmath.besselj(n + 1, x)) / 2
        slope_out = (hankel(n - 1) - hankel(n + 1)) / 2
        bracket = x * slope * hankel(n) / density - y * mpmath.besselj(n, x) * slope_out
        return complex(-2j / mpmath.pi / bracket)


@pytest.mark.parametrize("density", [1.0, 1.1])
@pytest.mark.parametrize("ratio", [0.7, 0.96, 1.04, 1.4])
@pytest.mark.parametrize("inner", [0.05, 12.0, 400.0])
def test_factors_of_all_orders(inner, ratio, density):
    """Also where J_n underflows and Y_n overflows."""
    last = int(inner * max(1, ratio) + 8 * np.cbrt(inner) + 60)
    real, imaginary = transmitted_factors(last, inner, inner * ratio, density)
    for n in (0, 1, 2, int(inner), int(inner) + 3, last // 2, last):
        wanted = exact(n, inner, inner * ratio, density)
        assert abs(real[n] + 1j * imaginary[n] - wanted) < 1e-13 * abs(wanted)


@pytest.mark.parametrize("ratio", [0.7, 1.04, 1.4])
@pytest.mark.parametrize("inner", [0.05, 40.0])
def test_factors_of_a_ball(inner, ratio):
    """In 60 digits, by j_l(x) = √(π/2x) J_{l+1/2}(x)."""
    last, density = int(inner * max(1, ratio)) + 70, 1.1
    real, imaginary = transmitted_factors(last, inner, inner * ratio, density, spherical=True)

    def with_slope(kind, n, x):
        value, after = (mpmath.sqrt(mpmath.pi / 2 / x) * kind(m + 0.5, x) for m in (n, n + 1))
        return value, n / x * value - after

    for n in (0, 1, 2, int(inner), last // 2, last):
        with mpmath.workdps(60):
            x, y = mpmath.mpf(inner), mpmath.mpf(inner * ratio)
            j, slope = with_slope(mpmath.besselj, n, x)
            h, slope_out = with_slope(mpmath.hankel1, n, y)
            wanted = complex(-1j / y / (x * slope * h / density - y * j * slope_out))
        assert abs(real[n] + 1j * imaginary[n] - wanted) < 1e-13 * abs(wanted)


def test_equal_media_let_all_pass():
    x = jnp.array([0.3, 30.0])
    real, imaginary = transmitted_factors(90, x, x, 1.0)
    assert max(abs(real - 1).max(), abs(imaginary).max()) < 1e-12


def test_a_source_in_the_body_by_the_equations_at_its_rim():
    """Unknown waves inside and outside, by two equations for each order; rho_1/rho_2 = 1.3."""
    inner, outer, density, place, far = 7.0, 6.4, 1.3, 0.6, 2.0
    real, imaginary = transmitted_factors(30, inner, outer, density)
    for n in range(20):
        # density J_n(k_1 |x|) H_n(k_1 r) + b J_n(k_1 r) inside, d H_n(k_2 r) outside
        matrix = [
            [sp.jv(n, inner), -sp.hankel1(n, outer)],
            [inner * sp.jvp(n, inner) / density, -outer * sp.h1vp(n, outer)],
        ]
        source = density * sp.jv(n, place * inner)
        rhs = -source * np.array(
            [sp.hankel1(n, inner), inner * sp.h1vp(n, inner) / density], complex
        )
        outside = np.linalg.solve(np.array(matrix, complex), rhs)[1] * sp.hankel1(n, far)
        found = sp.jv(n, place * inner) * (real[n] + 1j * imaginary[n]) * sp.hankel1(n, far)
        assert abs(found - outside) < 1e-12 * abs(outside)


def test_derivatives(check_both_modes):
    def summed(inner, outer, density):
        real, imaginary = transmitted_factors(40, inner, outer, density)
        return jnp.sum(real * jnp.cos(jnp.arange(41)) + imaginary)

    check_both_modes(summed, (11.0, 12.0, 1.1), rtol=1e-7)
