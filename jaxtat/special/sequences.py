"""J_n and Y_n of all integer orders 0 .. n_max, and the full-circle norm N(lambda)."""

import math
import operator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Num

from ..base.checks import is_concrete
from .bessel import as_floating, both_kinds


def hankel_sequence(
    n_max: int, x: Num[ArrayLike, "*shape"]
) -> tuple[Float[Array, "orders *shape"], Float[Array, "orders *shape"]]:
    """J_n(x) and Y_n(x), n = 0 .. n_max, by C_{n+1} + C_{n-1} = (2n/x) C_n.

    Y, and J for n <= x, are carried upward from n = 0, 1. For n > x J is the decaying solution, and
    upward errors would grow like Y; there J_n = R_n J_{n-1} with the ratios carried downward,
    R_n = x / (2n - x R_{n+1}).

    Args:
        n_max: highest order, a Python integer (static under jit).
        x: positive, any shape, no unit; float32 and float64 keep their dtype.

    Returns:
        J and Y, each of shape (n_max + 1, *x.shape). J_n underflows to 0. Y_n saturates at -1e150
        (float32: -1e18), so that its square stays finite, and counts as constant from there on:
        its derivatives are 0. At x = 0 J is exact and Y saturated; for x < 0 both are NaN.

    Raises:
        TypeError: n_max is not an integer, or x is complex or has half precision.
        ValueError: n_max is negative.

    Source: DLMF 10.6.1, 10.6.2 (recurrences and derivatives), 3.6 (their direction), 10.74(iv).

    >>> j, y = hankel_sequence(20, 2.0)
    >>> print(f"{j[20]:.6e} {y[20]:.6e}")
    3.918973e-19 -4.081651e+16
    """
    x = as_floating(x)
    n_max = order_count(n_max, "n_max")
    return _sequence(n_max, x, jnp.ones((n_max + 1, *[1] * x.ndim), x.dtype))


@partial(jax.jit, static_argnums=0)
def decay_steps(n_max: int, x: Float[Array, "*shape"]) -> Float[Array, "orders *shape"]:
    """delta_n = J_n(x) / J_{n-1}(x) for n > x, and 1 for n <= x: how fast high orders decay.

    The products Delta_n = delta_0 ... delta_n are scales for `scaled_hankel_sequence`. They are
    constants to differentiation: what is computed with them does not depend on them.

    Args:
        n_max: highest order.
        x: positive, for instance lambda R.

    Returns:
        0 < delta_n <= 1, n = 0 .. n_max.
    """
    x = jax.lax.stop_gradient(x)
    high = ratios(n_max, x)
    steps = jnp.concatenate([jnp.ones((1, *x.shape)), x[None] / (2 - x * high[:1]), high])
    order = np.arange(n_max + 1).reshape(-1, *[1] * x.ndim)
    return jnp.where(x < order, steps[: n_max + 1], 1.0)


def scaled_hankel_sequence(
    x: Float[Array, "*shape"], steps: Float[Array, "orders *broadcast"]
) -> tuple[Float[Array, "orders *shape"], Float[Array, "orders *shape"]]:
    """J_n(x) / Delta_n and Delta_n Y_n(x) with the scales of `decay_steps`.

    Products such as J_n(lambda |x|) Y_n(lambda |z|) = (J_n / Delta_n)(Delta_n Y_n) stay exact for
    orders at which the factors themselves under- and overflow.

    Args:
        x: positive.
        steps: delta_n, n = 0 .. n_max; trailing axes broadcast against those of x.

    Returns:
        Two arrays, (n_max + 1, *x.shape). Y as in `hankel_sequence` saturates at -1e150.

    >>> x = jnp.array([1.0, 1.3])
    >>> j, y = scaled_hankel_sequence(x, decay_steps(400, x[:1]))
    >>> print(f"{j[400, 0] * y[400, 1] * 400 * jnp.pi * 1.3**400:.4f}")  # J_n Y_n ~ -(R/R_g)^n / πn
    -1.0004
    """
    return _sequence(steps.shape[0] - 1, x, steps)


def full_circle_norm(
    frequency: Num[ArrayLike, "*shape"],
    radius: Num[ArrayLike, ""],
    n_orders: int | None = None,
) -> Float[Array, "*shape"]:
    """N(lambda) with N^2 = 1/(2 pi R_g) sum_{n=-inf}^{inf} 1 / |H_n(lambda R_g)|^2.

    H_n = J_n + i Y_n. N is the L2 norm on the circle |z| = R_g of the minimal-norm densities
    (rho_J, rho_Y) whose single-layer potentials reproduce a plane wave of wavenumber lambda,

        int [rho_J(z) J_0(lambda |x - z|) + rho_Y(z) Y_0(lambda |x - z|)] ds(z) = e^{-i xi.x}

    for |x| < R_g, with xi = lambda (cos t, sin t). For x = |x| (cos a, sin a) and
    z = R_g (cos b, sin b), Graf's addition theorem (DLMF 10.23.7) and the Jacobi-Anger expansion
    (10.12.1) read

        J_0|Y_0(lambda |x - z|) = sum_n J_n(lambda |x|) (J_n|Y_n)(lambda R_g) e^{in(a - b)},
        e^{-i xi.x} = sum_n (-i)^n J_n(lambda |x|) e^{in(a - t)}.

    Insert rho_J = sum_n p_n e^{inb}, rho_Y = sum_n q_n e^{inb} and ds = R_g db: the coefficients of
    J_n(lambda |x|) e^{ina} agree if 2 pi R_g (p_n J_n + q_n Y_n) = (-i)^n e^{-int} at lambda R_g.
    The smallest such pair has |p_n|^2 + |q_n|^2 = 1 / ((2 pi R_g)^2 |H_n|^2), and
    N^2 = ||rho_J||^2 + ||rho_Y||^2 = 2 pi R_g sum_n (|p_n|^2 + |q_n|^2) is the sum above.

    So N^2 = F(lambda R_g) / R_g, hence N(lambda/s, s R_g) = N(lambda, R_g) / sqrt(s). For large
    lambda R_g, 1/|H_n(x)|^2 ~ (pi/2) sqrt(x^2 - n^2) for |n| < x (DLMF 10.18.17) and the sum is
    an area of half a disk: N^2 ~ lambda^2 pi R_g / 8, which is short by one part in lambda R_g. The
    formula printed in the paper lacks the factor 1/(2 pi R_g), without which the norm would not
    follow a change of the unit of length.

    Args:
        frequency: lambda > 0 in radians per unit length, any shape.
        radius: R_g > 0 in units of length.
        n_orders: highest |n| in the sum (static under jit). By default, from the largest
            lambda R_g, enough for the rest to be below rounding.

    Returns:
        N(lambda), the shape of frequency. It tends to 0 with lambda R_g.

    Raises:
        TypeError: n_orders is not an integer, or an argument is complex or has half precision.
        ValueError: n_orders is negative, or missing while the arguments are being traced or when
            lambda R_g is negative, NaN or infinite.

    Source: Kunyansky (2008), section 3.1.

    >>> print(f"{full_circle_norm(64 * np.pi, 1.3):.6f}")
    143.933091
    """
    frequency, radius = as_floating(frequency), as_floating(radius)
    argument = frequency * radius
    n_orders = _orders_for(argument) if n_orders is None else order_count(n_orders, "n_orders")
    return _norm(n_orders, argument, radius)


@partial(jax.jit, static_argnums=0)
def _norm(n_orders: int, argument: Array, radius: Array) -> Array:
    """full_circle_norm for lambda R_g and R_g."""
    j, y = hankel_sequence(n_orders, argument)
    square = j**2 + y**2
    # Terms below 1/cap are far below rounding, and their derivatives would overflow.
    kept = square < largest_value(square)
    terms = jnp.where(kept, 1 / jnp.where(kept, square, 1.0), 0.0)
    return jnp.sqrt((terms[0] + 2 * terms[1:].sum(axis=0)) / (2 * math.pi * radius))


def order_count(n: int, name: str) -> int:
    n = operator.index(n)
    if n < 0:
        raise ValueError(f"{name} is {n}: pass a non-negative integer.")
    return n


def _orders_for(argument: Array) -> int:
    """`enough_orders` for the largest of concrete arguments."""
    if not is_concrete(argument):
        raise ValueError(
            "n_orders cannot be found while frequency or radius is traced by jit, vmap or grad: "
            "pass n_orders, an integer somewhat above the largest frequency * radius."
        )
    values = np.asarray(argument)
    if not (np.isfinite(values) & (values >= 0)).all():
        raise ValueError("frequency * radius must be positive and finite.")
    return enough_orders(float(values.max(initial=0.0)))


def enough_orders(largest: float) -> int:
    """Highest order for which 1 / |H_n|² still counts, at arguments up to ``largest``."""
    return math.ceil(largest) + evanescent_orders(largest)


def evanescent_orders(x: int | float) -> int:
    """Orders beyond n = x after which (J_n / J_x)^2 and 1 / Y_n^2 are below 1e-17.

    Around the turning point J_{x + s x^(1/3)}(x) ~ (2/x)^(1/3) Ai(2^(1/3) s), and Y_n with -Bi
    (DLMF 10.19.8). At s = 8, (Ai(10.1) / Ai(0))^2 = 5e-20 and 1 / Bi(10.1)^2 = 3e-18. The ten
    orders more are for small x, where the decay is that of (x/2)^n / n!.
    """
    return 10 + math.ceil(8 * x ** (1 / 3))


def largest_value(x: Array) -> float:
    """Size at which Y_n saturates: its square, and its quotient by a small x, are finite."""
    return 1e18 if x.dtype == jnp.float32 else 1e150


def ratios(n_max: int, x: Array, half: float = 0.0) -> Array:
    """R_n = J_n / J_{n-1} for n = 2 .. n_max + 2, of use for n > x; orders are n + ``half``.

    The downward recurrence starts from R = 0 at an order N beyond n_max. An error in R_{n+1} enters
    R_n with the factor R_n^2, so the start is forgotten like (J_N / J_{n_max})^2. For x > n_max the
    ratios are not used; for x <= n_max the decay is slowest at x = n_max.
    """
    last = n_max + 2
    start = last + evanescent_orders(last)

    def downward(following: Array, n: Array | np.ndarray) -> tuple[Array, Array]:
        ratio = x / (2 * n - x * following)
        return ratio, ratio

    # numpy: where a plan is built nothing is traced, and each length would be a program
    orders = np.arange(start, last, -1, dtype=x.dtype) + half
    ratio, _ = jax.lax.scan(lambda r, n: (downward(r, n)[0], None), jnp.zeros_like(x), orders)
    orders = np.arange(2, last + 1, dtype=x.dtype) + half
    return jax.lax.scan(downward, ratio, orders, reverse=True)[1]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
@partial(jax.jit, static_argnums=0)
def _sequence(n_max: int, x: Array, steps: Array) -> tuple[Array, Array]:
    """J_n / Delta_n and Delta_n Y_n; ``steps`` are delta_n, constants to differentiation."""
    x = jnp.where(x >= 0, x, jnp.nan)
    (j_0, y_0), (j_1, y_1) = both_kinds(0, x), both_kinds(1, x)
    return carried_upward(n_max, x, steps, (j_0, j_1, y_0, y_1), ratios(n_max, x))


def carried_upward(
    n_max: int,
    x: Array,
    steps: Array,
    first: tuple[Array, Array, Array, Array],
    high: Array,
    half: float = 0.0,
) -> tuple[Array, Array]:
    """J_n / Delta_n and Delta_n Y_n of orders n + ``half``, n = 0 .. n_max.

    Args:
        n_max: highest n.
        x: positive or NaN.
        steps: delta_n, which are constants to differentiation.
        first: J_0, J_1, Y_0, Y_1.
        high: `ratios`, used for n > x.
        half: 0 for cylindrical, 1/2 for spherical functions.
    """
    cap = largest_value(x)

    def upward(carry: tuple[Array, ...], item: tuple[Array | np.ndarray, ...]):
        # Orders n - 2 and n - 1 come in; n - 2 goes to the result, n to the next step.
        j_before, j, y_before, y = carry
        n, ratio, step_before, step = item
        factor = 2 * (n - 1 + half) / x
        j_next = jnp.where(n <= x, factor * j - j_before / step_before, ratio * j) / step
        y_next = jnp.maximum((factor * y - y_before * step_before) * step, -cap)
        return (j, j_next, y, y_next), (j_before, y_before)

    # two orders more than wanted pass through, with any scale
    steps = jnp.concatenate([steps, jnp.ones((2, *steps.shape[1:]), steps.dtype)])
    j_0, j_1, y_0, y_1 = first
    start = j_0, j_1 / steps[1], jnp.maximum(y_0, -cap), jnp.maximum(y_1 * steps[1], -cap)
    orders = np.arange(2, n_max + 3, dtype=x.dtype)
    return jax.lax.scan(upward, start, (orders, high, steps[1:-1], steps[2:]))[1]


@_sequence.defjvp
def _(n_max: int, primals: tuple[Array, Array], tangents: tuple[Array, Array]):
    # DLMF 10.6.1: J_n' = (J_{n-1} - J_{n+1}) / 2, at the price of one more order. Unlike
    # J_{n-1} - (n/x) J_n (10.6.2) it does not cancel at small x, where higher derivatives would
    # suffer. For Y it would mix saturated with unsaturated orders, but there Y_{n-1} - (n/x) Y_n
    # does not cancel, as |Y_n| grows with n. J_{-1} = -J_1 and Y_{-1} = -Y_1.
    (x, steps), (x_dot, _) = primals, tangents
    steps = jnp.concatenate([steps, jnp.ones((1, *steps.shape[1:]), steps.dtype)])
    j, y = _sequence(n_max + 1, x, steps)
    j_before = jnp.concatenate([-j[1:2] * steps[1], j[:-2] / steps[1:-1]])
    j_slope = (j_before - j[1:] * steps[1:]) / 2
    y_before = jnp.concatenate([-y[1:2] / steps[1], y[:-2] * steps[1:-1]])
    y = y[:-1]
    orders = np.arange(n_max + 1, dtype=x.dtype).reshape(-1, *[1] * x.ndim)
    y_slope = jnp.where(y <= -largest_value(y), 0.0, y_before - orders / x * y)
    return (j[:-1], y), (j_slope * x_dot, y_slope * x_dot)
