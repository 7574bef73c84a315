"""J_n and Y_n of all orders and the full-circle norm, against mpmath, scipy and identities.

The figures in comments are the largest errors measured.
"""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
import scipy.special
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat.special import (
    both_kinds,
    decay_steps,
    full_circle_norm,
    hankel_sequence,
    scaled_hankel_sequence,
)

mp.mp.dps = 30
CAP = {jnp.float64: 1e150, jnp.float32: 1e18}
ORDERS = np.array([0, 1, 2, 3, 5, 10, 50, 100, 299, 300, 301, 700, 999, 1000, 1001, 1050, 1300])
ARGUMENTS = np.concatenate(
    [[1e-6, 1e-3, 0.1, 1, 5, 50, 299, 300, 301, 700, 999, 1000],
     np.random.default_rng(3).uniform(0, 1000, 2)]
)  # fmt: skip


def reference(orders, x, derivative: int = 0, cap: float = 1e150) -> tuple[np.ndarray, np.ndarray]:
    """J and Y from 30 digits, Y cut at the cap."""
    x = [mp.mpf(float(v)) for v in x]
    j = [[float(mp.besselj(int(n), v, derivative)) for v in x] for n in orders]
    y = [[float(max(mp.bessely(int(n), v, derivative), -mp.mpf(cap))) for v in x] for n in orders]
    return np.array(j), np.array(y)


@pytest.fixture(scope="module")
def exact():
    return reference(ORDERS, ARGUMENTS)


@pytest.fixture(scope="module")
def computed():
    return [np.asarray(c) for c in hankel_sequence(1300, ARGUMENTS)]


def relative_to_amplitude(value, expected, x):
    return np.abs(value - expected) / np.maximum(np.abs(expected), np.sqrt(2 / np.pi / x))


def test_j_against_mpmath(computed, exact):
    error = np.abs(computed[0][ORDERS] - exact[0])
    assert error.max() < 1e-15  # 4.3e-16
    evanescent = (ORDERS[:, None] > ARGUMENTS) & (np.abs(exact[0]) > 1e-290)
    assert (error[evanescent] / np.abs(exact[0][evanescent])).max() < 1e-13  # 1.8e-14


def test_y_against_mpmath(computed, exact):
    assert relative_to_amplitude(computed[1][ORDERS], exact[1], ARGUMENTS).max() < 1e-13  # 1.8e-14


def test_all_orders_against_scipy():
    n, x = np.arange(81)[:, None], np.random.default_rng(5).uniform(0.01, 120, 200)
    j, y = hankel_sequence(80, x)
    np.testing.assert_allclose(j, scipy.special.jv(n, x), atol=1e-13)
    expected = np.maximum(scipy.special.yn(n, x), -1e150)
    assert relative_to_amplitude(y, expected, x).max() < 1e-12  # 2e-13, the error of scipy


@pytest.mark.parametrize("n_max", [0, 3])
def test_lowest_orders(n_max):
    x = np.array([[1e-6, 0.5, 3.0], [1.0, 2.0, 700.0]])
    j, y = map(np.asarray, hankel_sequence(n_max, x))
    assert j.shape == y.shape == (n_max + 1, 2, 3)
    for n in range(min(n_max, 1) + 1):
        jn, yn = both_kinds(n, x)
        np.testing.assert_allclose(j[n], jn, rtol=1e-15)
        np.testing.assert_allclose(y[n], yn, rtol=1e-15)


def test_downward_recurrence_starts_far_enough():
    # The start matters most for x just below n_max; hundreds of orders more change nothing.
    for n_max in (2, 1300):
        x = np.linspace(max(n_max - 3.0, 0.5), n_max + 2.0, len(ARGUMENTS))
        further = np.asarray(hankel_sequence(1600, x)[0])[: n_max + 1]
        np.testing.assert_allclose(hankel_sequence(n_max, x)[0], further, rtol=1e-15)


@pytest.mark.parametrize("dtype", CAP)
def test_saturation_and_underflow(dtype):
    x = np.array([1e-6, 1e-3, 0.1, 1.0, 3.0, 5.0, 10.0, 30.0], dtype)
    j, y = map(np.asarray, hankel_sequence(400, x))
    assert j.dtype == y.dtype == dtype
    np.testing.assert_array_equal(j[-1], 0.0)
    np.testing.assert_array_equal(y[-1], dtype(-CAP[dtype]))
    assert np.all(np.isfinite(y**2))
    assert np.all(np.isfinite(1 / y**2)) and np.all(1 / y**2 > 0)


def test_edges_of_the_domain():
    x = np.array([[0.0, -1.0, 0.0], [-1e-9, -30.0, 0.0]])
    j, y = map(np.asarray, hankel_sequence(3, x))
    np.testing.assert_allclose(j[:, x == 0], [[1] * 3, [0] * 3, [0] * 3, [0] * 3], rtol=3e-16)
    np.testing.assert_array_equal(y[:, x == 0], -1e150)
    assert np.all(np.isnan(j[:, x < 0])) and np.all(np.isnan(y[:, x < 0]))


def test_refusals():
    with pytest.raises(ValueError, match="n_max is -1"):
        hankel_sequence(-1, 1.0)
    with pytest.raises(TypeError):
        hankel_sequence(2.5, 1.0)  # pyright: ignore
    with pytest.raises(TypeError, match="float32 or float64"):
        hankel_sequence(2, 1j)  # pyright: ignore


def test_float32():
    x = ARGUMENTS[2:].astype(np.float32)
    orders = ORDERS[ORDERS <= 300]
    j, y = (np.asarray(c)[orders] for c in hankel_sequence(300, x))
    exact_j, exact_y = reference(orders, x, cap=1e18)
    assert np.abs(j - exact_j).max() < 1e-6  # 3e-7
    assert relative_to_amplitude(y, exact_y, x).max() < 5e-6  # 1.2e-6


DERIVED_AT = np.array([1e-6, 1e-3, 0.3, 1.0, 4.9, 5.1, 11.9, 12.1, 60.0])


@pytest.fixture(scope="module")
def derivatives():
    """The first, by reverse mode, and the third, by both modes; of orders up to 200."""
    function = lambda x: jnp.stack(hankel_sequence(200, x))  # noqa: E731
    first = jax.jacrev(function)
    third = jax.jacrev(jax.jacfwd(first))
    both = jax.jit(jax.vmap(lambda x: (first(x), third(x)), out_axes=-1))
    return dict(zip((1, 3), map(np.asarray, both(DERIVED_AT)), strict=True))


@pytest.mark.parametrize("order", [1, 3])
def test_derivatives_against_mpmath(derivatives, order):
    # At 1e-6, J_{n-1} - (n/x) J_n would have lost ten digits of the third derivative.
    x, orders = DERIVED_AT, np.array([0, 1, 2, 3, 8, 12])
    found = derivatives[order][:, orders]
    j, y = [], []
    for n in orders:
        j.append([float(mp.besselj(int(n), mp.mpf(v), order)) for v in x])
        y.append([float(mp.bessely(int(n), mp.mpf(v), order)) for v in x])
    np.testing.assert_allclose(found[0], j, atol=1e-15)  # 1.1e-16
    assert relative_to_amplitude(found[1], np.array(y), x).max() < 2e-15  # 7.4e-16


def test_saturated_orders_are_constant(derivatives):
    saturated = np.asarray(hankel_sequence(200, DERIVED_AT)[1]) == -1e150
    assert 0 < saturated[:, 2].sum() < 201
    for slopes in derivatives.values():
        assert np.all(slopes[1][saturated] == 0)
        assert np.all(np.isfinite(slopes)) and np.all(slopes[1][~saturated] != 0)


arguments = st.lists(st.floats(1e-3, 1000.0), min_size=8, max_size=8).map(np.array)


@settings(max_examples=50, deadline=None)
@given(arguments)
def test_three_term_recurrence(x):
    n = np.arange(1, 400)[:, None]
    for c in hankel_sequence(400, x):
        c = np.asarray(c)
        free = np.abs(c[2:]) < 1e150
        right = 2 * n / x * c[1:-1]
        size = np.maximum(np.abs(c[:-2]) + np.abs(c[2:]), np.abs(right))
        error = np.abs(c[:-2] + c[2:] - right)
        assert np.all(error[free] <= 4e-15 * size[free] + 1e-300)  # 6e-16


@settings(max_examples=50, deadline=None)
@given(arguments)
def test_wronskian(x):
    # DLMF 10.5.2: J_{n+1} Y_n - J_n Y_{n+1} = 2 / (pi x) ties the two recurrences together.
    j, y = (np.asarray(c) for c in hankel_sequence(400, x))
    free = (y[1:] > -1e150) & (j[1:] > 1e-290)
    wronskian = (j[1:] * y[:-1] - j[:-1] * y[1:]) * np.pi * x / 2
    np.testing.assert_allclose(wronskian[free], 1.0, rtol=1e-13)  # 3e-14


# arguments lambda |x| <= lambda R < lambda |z|: Delta_n belongs to the second
SCALED = np.array([[0.005, 0.01, 0.013], [3.0, 4.0, 5.2], [0.1, 200.0, 300.0]])


def test_products_of_scaled_orders_where_factors_under_and_overflow():
    """J_n(x) Y_n(z) and J_n(R) Y_n(z) to 1e-12, though J_n alone is 0 and Y_n infinite."""
    orders = [0, 1, 2, 5, 9, 50, 199, 200, 201, 250, 400]

    @jax.jit
    def scaled_and_plain(x):
        steps = decay_steps(400, x[1])
        return *scaled_hankel_sequence(x, steps[:, None]), *hankel_sequence(400, x)

    j, y, plain_j, plain_y = map(np.asarray, scaled_and_plain(SCALED.T))
    assert j.shape == y.shape == (401, 3, 3)
    assert (plain_j[400, 1, :2] == 0).all() and (plain_y[400, 2, :2] == -1e150).all()
    for n in orders:
        for k, (x, rim, z) in enumerate(SCALED):
            exact_y = mp.bessely(n, mp.mpf(z))
            for place, argument in ((0, x), (1, rim)):
                expected = mp.besselj(n, mp.mpf(argument)) * exact_y
                error = abs(float(j[n, place, k]) * float(y[n, 2, k]) - expected)
                # near zeros of an oscillating factor errors are relative to its amplitude
                size = abs(expected) + (0.01 if n <= z else 0)
                assert error <= 1e-12 * size + 1e-300, (n, argument, z)


def test_decay_steps_against_mpmath():
    """J_n / J_{n-1} beyond n = x, one up to there; never above one."""
    for x in (0.01, 4.0, 200.0):
        steps = np.asarray(decay_steps(260, np.array(x)))
        assert steps.shape == (261,) and (steps > 0).all() and (steps <= 1).all()
        np.testing.assert_array_equal(steps[: int(x) + 1], 1.0)
        for n in (int(x) + 1, int(x) + 2, 210, 260):
            ratio = mp.besselj(n, mp.mpf(x)) / mp.besselj(n - 1, mp.mpf(x))
            np.testing.assert_allclose(steps[n], float(ratio), rtol=1e-13)


def test_scales_are_constants_that_drop_out():
    """Moving R moves the scales; products J Y do not feel it and have the right derivatives."""
    n_max, radius, distance = 120, 1.0, 1.3

    def product(parameters):
        lam, radius, distance = parameters
        steps = decay_steps(n_max, lam * radius)
        j, _ = scaled_hankel_sequence(lam * radius, steps)
        _, y = scaled_hankel_sequence(lam * distance, steps)
        return j * y

    point = jnp.array([5.0, radius, distance])
    forward, reverse = jax.jit(lambda at: (jax.jacfwd(product)(at), jax.jacrev(product)(at)))(point)
    np.testing.assert_allclose(forward, reverse, rtol=1e-11, atol=1e-20)

    def exact(n, lam, radius, distance):
        return mp.besselj(n, lam * radius) * mp.bessely(n, lam * distance)

    for n in (0, 4, 6, 30, 120):
        for i in range(3):
            order = [0, 0, 0]
            order[i] = 1
            slope = mp.diff(lambda *a, n=n: exact(n, *a), tuple(map(float, point)), tuple(order))
            np.testing.assert_allclose(forward[n, i], float(slope), rtol=1e-11)


def exact_norm(frequency, radius):
    """The sum with scipy, which gives NaN where H_n overflows."""
    n = np.arange(-600, 601)[:, None]
    with np.errstate(over="ignore", invalid="ignore"):
        terms = 1 / np.abs(scipy.special.hankel1(n, frequency * radius)) ** 2
    return np.sqrt(np.nansum(terms, axis=0) / (2 * np.pi * radius))


@pytest.mark.parametrize("radius", [0.04, 1.3])
def test_norm_against_scipy(radius):
    frequency = np.array([0.01, 0.5, np.pi / 2, 10.0, 64 * np.pi])
    expected = exact_norm(frequency, radius)
    np.testing.assert_allclose(full_circle_norm(frequency, radius), expected, rtol=1e-14)


def test_norm_for_large_arguments():
    radius, frequency = 1.3, np.array([50.0, 100.0, 200.0, 400.0])
    ratio = np.asarray(full_circle_norm(frequency, radius)) ** 2 / (
        frequency**2 * np.pi * radius / 8
    )
    # The first correction is the reciprocal of lambda R_g, and the next one is smaller.
    np.testing.assert_allclose((ratio - 1) * frequency * radius, 1.0, atol=1e-5)


def test_norm_scales_with_the_unit_of_length():
    frequency = np.array([0.3, 5.0, 150.0])
    norm = np.asarray(full_circle_norm(frequency, 1.3, 300))
    for unit in (1e-3, 25.4):
        scaled = full_circle_norm(frequency / unit, 1.3 * unit, 300)
        np.testing.assert_allclose(scaled, norm / unit**0.5, rtol=1e-13)


def test_default_number_of_orders_is_enough():
    for argument in (1.0, 500.0):
        default = full_circle_norm(argument, 1.0)
        np.testing.assert_allclose(default, full_circle_norm(argument, 1.0, 800), rtol=1e-15)


def test_norm_derivatives():
    # All orders of the first frequency but the lowest have vanishing terms.
    frequency, radius = np.array([1e-6, 3.0, 200.0]), 1.3

    def function(frequency, radius):
        return full_circle_norm(frequency, radius, 400)

    def exact(radius):
        terms = [1 / abs(mp.hankel1(n, 3 * radius)) ** 2 for n in range(20)]
        return mp.sqrt((2 * mp.fsum(terms) - terms[0]) / (2 * mp.pi * radius))

    def kinds(*point):
        transformations = (jax.jacfwd, jax.jacrev, jax.hessian)
        found = [transformation(function, (0, 1))(*point) for transformation in transformations]
        return function(*point), *found

    results = jax.tree.map(np.asarray, jax.jit(kinds)(frequency, radius))
    for block in jax.tree.leaves(results):
        assert np.all(np.isfinite(block))
    norm, forward, reverse, second = results
    slope, curvature = (float(mp.diff(exact, mp.mpf(radius), order)) for order in (1, 2))
    np.testing.assert_allclose([forward[1][1], reverse[1][1]], slope, rtol=1e-13)
    np.testing.assert_allclose(second[1][1][1], curvature, rtol=1e-12)
    # N = h(lambda R_g) / sqrt(R_g), hence lambda dN/dlambda = R_g dN/dR_g + N/2.
    scaled = frequency * np.diag(forward[0])
    np.testing.assert_allclose(scaled, radius * forward[1] + norm / 2, rtol=1e-12)


def test_norm_under_jit_and_in_float32():
    frequency = np.array([0.5, 20.0, 100.0], np.float32)
    expected = full_circle_norm(frequency.astype(float), 1.3)
    jitted = jax.jit(full_circle_norm, static_argnums=2)(frequency, 1.3, 180)
    np.testing.assert_allclose(jitted, expected, rtol=1e-6)
    single = full_circle_norm(frequency, np.float32(1.3))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, expected, rtol=1e-6)


def test_norm_at_zero_frequency_and_refusals():
    assert full_circle_norm(0.0, 1.3) == 0
    with pytest.raises(ValueError, match="pass n_orders"):
        jax.jit(full_circle_norm)(1.0, 1.3)
    with pytest.raises(ValueError, match="pass n_orders"):
        jax.grad(full_circle_norm)(1.0, 1.3)
    with pytest.raises(ValueError, match="positive and finite"):
        full_circle_norm(-1.0, 1.3)
    with pytest.raises(ValueError, match="n_orders is -2"):
        full_circle_norm(1.0, 1.3, -2)
