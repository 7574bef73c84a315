"""J0, J1, Y0, Y1 against mpmath, and their derivatives.

Errors are relative to the amplitude max(|f|, sqrt(2 / (pi x))). The figures in comments are the
largest ones measured; the bounds are about twice that.
"""

import subprocess
import sys
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
import scipy.special

from jaxtat.special import both_kinds, j0, j1
from jaxtat.special.bessel import SWITCH_POINT

mp.mp.dps = 30


def y0(x):
    return both_kinds(0, x)[1]


def y1(x):
    return both_kinds(1, x)[1]


FUNCTIONS = {"j0": (j0, mp.besselj, 0), "j1": (j1, mp.besselj, 1),
             "y0": (y0, mp.bessely, 0), "y1": (y1, mp.bessely, 1)}  # fmt: skip
each_function = pytest.mark.parametrize("name", FUNCTIONS)
J0_ZEROS = [float(mp.besseljzero(0, k)) for k in range(1, 7)]
J1_ZEROS = [float(mp.besseljzero(1, k)) for k in range(1, 7)]
Y_ZEROS = [float(mp.besselyzero(n, k)) for n in (0, 1) for k in (1, 2, 3)]


SIZE = 60  # of every array of points: one shape, one compilation


def points(low: float, high: float, size: int = SIZE) -> np.ndarray:
    return np.random.default_rng(size).uniform(low, high, size)


def around(zeros: list[float]) -> np.ndarray:
    """The floats nearest to the zeros, and others on both sides of them."""
    steps = [0, 1e-15, -1e-15, 1e-13, -1e-13, 1e-11, -1e-11, 1e-8, -1e-8, 1e-6]
    return np.array([zero * (1 + step) for step in steps for zero in zeros])


RANGES = {
    "tiny": np.concatenate([10.0 ** points(-300, -9, 30), 10.0 ** points(-9, -1, 30)]),
    "below": points(0.1, SWITCH_POINT),
    "switch": np.concatenate(
        [SWITCH_POINT + 1e-7 * points(-1, 1, SIZE - 3), np.nextafter(SWITCH_POINT, [0, 9]), [5.0]]
    ),
    "zeros of J0": around(J0_ZEROS),
    "zeros of J1": around(J1_ZEROS),
    "zeros of Y": around(Y_ZEROS),
    "middle": points(SWITCH_POINT, 30),
    "large": points(30, 1000),
}


def reference(name: str, x: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Rounded to double from 30 digits, at exactly the given floats."""
    _, function, order = FUNCTIONS[name]
    return np.array([float(function(order, mp.mpf(float(v)), derivative)) for v in x])


def error(value, expected: np.ndarray, x: np.ndarray) -> float:
    oscillation = np.sqrt(2 / np.pi / np.maximum(x.astype(float), 1.0))
    return np.max(np.abs(np.asarray(value) - expected) / np.maximum(np.abs(expected), oscillation))


@each_function
@pytest.mark.parametrize("region", RANGES)
def test_float64_against_mpmath(name, region):
    x = RANGES[region]
    value = jax.jit(FUNCTIONS[name][0])(x)
    assert value.dtype == jnp.float64
    assert error(value, reference(name, x), x) < 1e-15  # 4.8e-16


@each_function
def test_float32_against_mpmath(name):
    x = np.concatenate([region[::2] for region in RANGES.values()])
    x = np.maximum(x, 1e-35).astype(np.float32)
    value = FUNCTIONS[name][0](x)
    assert value.dtype == jnp.float32
    assert error(value, reference(name, x), x) < 1e-6  # 4.4e-7


@each_function
@pytest.mark.parametrize("scale", [1e4, 1e5, 1e6, 1e7, 1e9, 1e12])
def test_far_error_is_below_the_rounding_of_the_argument(name, scale):
    x = scale * points(0.9, 1.1)
    found = error(FUNCTIONS[name][0](x), reference(name, x), np.ones_like(x))
    amplitude = np.sqrt(2 / np.pi / scale)
    assert found < amplitude * np.finfo(float).eps * scale
    if scale <= 1e7:
        assert found < 1e-15 * amplitude  # 4e-16: so far the argument is reduced without loss


@pytest.mark.parametrize(("name", "zero"), [("j0", J0_ZEROS[0]), ("j1", J1_ZEROS[0])])
def test_relative_accuracy_beside_the_first_zero(name, zero):
    x = around([zero] * 6)
    expected = reference(name, x)
    assert np.all(np.abs(FUNCTIONS[name][0](x) - expected) < 1e-15 * np.abs(expected) + 1e-22)


def test_relative_accuracy_of_j1_and_y1_at_tiny_arguments():
    x = RANGES["tiny"]
    for name in ("j1", "y1"):
        np.testing.assert_allclose(FUNCTIONS[name][0](x), reference(name, x), rtol=1e-15)


@each_function
def test_against_scipy(name):
    x = points(1e-3, 1000)
    expected = getattr(scipy.special, name)(x)
    assert error(FUNCTIONS[name][0](x), expected, x) < 1e-13  # 3e-14, the error of scipy


def test_wronskian():
    for x in RANGES.values():
        wronskian = np.asarray(j1(x)) * y0(x) - np.asarray(j0(x)) * y1(x)
        np.testing.assert_allclose(wronskian, 2 / (np.pi * x), rtol=2e-15)


def test_symmetry():
    for x in RANGES.values():
        np.testing.assert_array_equal(j0(-x), j0(x))
        np.testing.assert_array_equal(j1(-x), -np.asarray(j1(x)))


def test_special_values():
    x = np.array([0.0, -0.0, -1.0, -7.0, np.inf, np.nan])
    of_j = [np.asarray(j(x)) for j in (j0, j1)]
    np.testing.assert_allclose(of_j[0][:2], 1.0, rtol=3e-16)
    np.testing.assert_array_equal(of_j[1][:2], 0.0)
    for values in of_j:
        assert values[4] == 0
        assert np.isnan(values[5])
    for y in (y0, y1):
        np.testing.assert_array_equal(y(x), [-np.inf, -np.inf, np.nan, np.nan, 0.0, np.nan])


@each_function
def test_dtypes(name):
    function = FUNCTIONS[name][0]
    np.testing.assert_array_equal(function(jnp.array([1, 6])), function(jnp.array([1.0, 6.0])))
    assert function(2.0).shape == ()
    with pytest.raises(TypeError, match="float32 or float64"):
        function(jnp.array([1j]))
    with pytest.raises(TypeError, match="float32 or float64"):
        function(jnp.array([1.0], jnp.float16))


def all_four(x):
    return jnp.stack([function(x) for function, _, _ in FUNCTIONS.values()])


def test_jit_vmap_and_plain_agree():
    x = points(0.01, 40).reshape(3, 4, 5)
    expected = [reference(name, x.ravel()).reshape(x.shape) for name in FUNCTIONS]
    mapped = jax.vmap(jax.vmap(all_four, 1, 2), 1, 2)
    for variant in (jax.jit(all_four), jax.jit(mapped)):
        assert error(variant(x), np.array(expected), x) < 1e-15
    plain = [function(x.ravel()).reshape(x.shape) for function, *_ in FUNCTIONS.values()]
    assert error(plain, np.array(expected), x) < 1e-15


HIGHEST_DERIVATIVE = {"j0": 4, "j1": 4, "y0": 3, "y1": 3}


@cache
def derivatives(name: str):
    """x -> the function and its derivatives, all of one compiled program."""

    def with_one_more(tower):
        def higher(x):
            values, slopes = jax.jvp(tower, (x,), (jnp.ones_like(x),))
            return jnp.concatenate([values, slopes[-1:]])

        return higher

    tower = lambda x: FUNCTIONS[name][0](x)[None]  # noqa: E731
    for _ in range(HIGHEST_DERIVATIVE[name]):
        tower = with_one_more(tower)
    return jax.jit(tower)


@each_function
def test_derivatives_against_mpmath(name):
    x = np.concatenate(
        [[1e-6, 1e-3, 0.1, 4.999999, 5.0, 5.000001], points(0.1, 5, 12), points(5, 200, 12)]
    )
    for order, value in enumerate(np.asarray(derivatives(name)(x))):
        assert error(value, reference(name, x, order), x) < 1e-15, order  # 4.7e-16


@pytest.mark.parametrize("name", ["j0", "j1"])
def test_derivatives_of_j_at_zero_and_below(name):
    x = np.concatenate([np.zeros(15), points(-30, -0.1, 15)])
    found = np.asarray(derivatives(name)(x))
    # J0 = 1 - x^2/4 + x^4/64 - ..., J1 = x/2 - x^3/16 + ...
    at_zero = {"j0": [1, 0, -1 / 2, 0, 3 / 8], "j1": [0, 1 / 2, 0, -3 / 8, 0]}
    np.testing.assert_allclose(found[:, 0], at_zero[name], rtol=1e-15, atol=1e-300)
    expected = [reference(name, x[15:], order) for order in range(5)]
    np.testing.assert_allclose(found[:, 15:], expected, atol=1e-15)


def test_derivatives_of_loops_at_the_seams():
    """Forward mode over the reverse mode of a loop differentiates the formulas, not the rules."""
    functions = FUNCTIONS.values()
    first = [0.0 if name[0] == "j" else 0.5 for name in FUNCTIONS]
    x = np.stack([first, *(np.full(4, at) for at in (2.4, SWITCH_POINT, 8.0))])

    def each(row):
        return jnp.stack([function(at) for (function, *_), at in zip(functions, row, strict=True)])

    slopes = jax.grad(lambda x: jnp.sum(jax.lax.map(each, x)))
    found = jax.jit(lambda x: jax.jvp(slopes, (x,), (jnp.ones_like(x),)))(x)
    for order, values in enumerate(found, 1):
        for (_, exact, n), points, column in zip(functions, x.T, np.transpose(values), strict=True):
            wanted = [float(mp.diff(lambda t: exact(n, t), mp.mpf(t), order)) for t in points]  # noqa: B023
            assert np.allclose(column, wanted, rtol=1e-12, atol=1e-13)


def test_hessian_of_a_sum_is_diagonal_and_float32_stays():
    x = jnp.array([0.5, 4.0, 9.0], jnp.float32)
    hessian = jax.jit(jax.jacfwd(jax.jacrev(lambda v: all_four(v).sum(axis=1))))(x)
    assert hessian.dtype == jnp.float32
    expected = [np.diag(reference(name, np.asarray(x), 2)) for name in FUNCTIONS]
    np.testing.assert_allclose(hessian, expected, atol=2e-6, rtol=1e-6)


def test_stored_coefficients_are_what_the_script_derives():
    script = Path(__file__).parents[2] / "scripts" / "derive_bessel_coefficients.py"
    command = [sys.executable, str(script), "--check"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
