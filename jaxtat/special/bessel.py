"""J0, J1, Y0, Y1 of real arguments, with exact derivatives of all orders.

Below X = 5 polynomials in x^2, from X on modulus and phase (DLMF 10.18):

    J_n + i Y_n = sqrt(2 / (pi x)) m_n exp(i (x - (2n + 1) pi/4 + t_n / x)),

with m_n and t_n polynomials in (X/x)^2. The coefficients are in _coefficients.py. Both parts are
evaluated for every element, at arguments clipped to their own range, and `jnp.where` selects.

All functions of one array use the same expressions of |x|. In one elementwise expression, such as
J0 + i Y0, the compiler then computes what they share once (Y0 alone contains all of J0). If they
are two separate results, XLA on the CPU repeats the shared part in the loop of each.

Errors, measured against mpmath: at most 6e-16 of the amplitude max(|f|, sqrt(2 / (pi x))) in
float64 up to x = 1000, and 5e-7 in float32. Beyond, it is at most eps x of the amplitude.
"""

import math
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Num

from ._coefficients import (
    MODULUS,
    PHASE,
    QUARTER_PI_FLOAT32,
    QUARTER_PI_FLOAT64,
    REDUCED_J,
    REGULAR_Y,
    SWITCH_POINT,
    ZERO,
)

# Taylor coefficients of (sin r - r) / r^3 and (cos r - 1 + r^2/2) / r^4 in r^2; for |r| < 0.87 the
# first terms left out are below 4e-19.
_SINE = [(-1) ** k / math.factorial(2 * k + 1) for k in range(1, 9)]
_COSINE = [(-1) ** k / math.factorial(2 * k) for k in range(2, 9)]

# One compiled program when called outside jit, and nothing in the way of sharing inside.
_compiled = partial(jax.jit, inline=True)


def j0(x: Num[ArrayLike, "..."]) -> Float[Array, "..."]:
    """J_0(x) = (1/pi) int_0^pi cos(x sin a) da, an even function.

    Args:
        x: real, any shape, no unit. float32 and float64 keep their dtype, integers are converted.

    Returns:
        J_0(x), the shape of x; 0 at infinity, NaN at NaN.

    Raises:
        TypeError: x is complex or has half precision.

    Source: DLMF 10.9.1; derivative 10.6.3, J_0' = -J_1.

    >>> print(f"{j0(2.5):.12f}")
    -0.048383776468
    """
    return _j0(as_floating(x))


def j1(x: Num[ArrayLike, "..."]) -> Float[Array, "..."]:
    """J_1(x) = (1/pi) int_0^pi cos(a - x sin a) da, an odd function.

    Args:
        x: real, any shape, no unit. float32 and float64 keep their dtype, integers are converted.

    Returns:
        J_1(x), the shape of x; 0 at infinity, NaN at NaN.

    Raises:
        TypeError: x is complex or has half precision.

    Source: DLMF 10.9.2; derivative 10.6.2, J_1' = J_0 - J_1 / x, which is 1/2 at x = 0.

    >>> print(f"{j1(2.5):.12f}")
    0.497094102464
    """
    return _j1(as_floating(x))


def both_kinds(
    order: int, x: Num[ArrayLike, "*shape"]
) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """J_n(x) and Y_n(x), n = 0 or 1: Y_n contains all of J_n, which is written once for both.

    Programs that want both are half as long, and so are their derivatives.

    Args:
        order: n.
        x: real, any shape, no unit. float32 and float64 keep their dtype, integers are converted.

    Returns:
        J_n as `j0` and `j1`; Y_n is -inf at 0, NaN for x < 0. Derivatives of Y_n exist for x > 0
        only: where x may be 0, replace it before the call, not the result after it.

    Raises:
        TypeError: x is complex or has half precision.

    Source: Y_n is (2/pi) log(x/2) J_n(x), -2/(pi x) for n = 1, and a power series, DLMF 10.8.1,
    10.8.2; derivatives 10.6.2, 10.6.3, Y_0' = -Y_1 and Y_1' = Y_0 - Y_1 / x.

    >>> j, y = both_kinds(0, 2.5)
    >>> print(f"{j:.12f} {y:.12f}")
    -0.048383776468 0.498070359615
    >>> print(f"{both_kinds(1, 2.5)[1]:.12f}")
    0.145918137967
    """
    return _both(order, as_floating(x))


def as_floating(x: Num[ArrayLike, "..."]) -> Float[Array, "..."]:
    """x as a float32 or float64 array; TypeError for other dtypes but integers."""
    array = jnp.asarray(x)
    if jnp.issubdtype(array.dtype, jnp.integer):
        return array.astype(jnp.result_type(float))
    if array.dtype not in (jnp.float32, jnp.float64):
        raise TypeError(f"x has dtype {array.dtype}: pass real numbers, as float32 or float64.")
    return array


# The functions and their derivative rules. J_1(x)/x^1, J_2(x)/x^2, ... are primitives of their own:
# they are even and entire, so no rule divides by x, and derivatives of J at 0 are exact.


@jax.custom_jvp
@_compiled
def _j0(x: Array) -> Array:
    x = _size(x)
    return jnp.where(x < SWITCH_POINT, _scaled_j_below(0, x), _hankel_above(0, x)[0])


@_j0.defjvp
def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    # DLMF 10.6.3: J_0' = -J_1.
    (x,), (x_dot,) = primals, tangents
    return _j0(x), -_j1(x) * x_dot


@jax.custom_jvp
@_compiled
def _j1(x: Array) -> Array:
    size = _size(x)
    below = _at_most(size) * _scaled_j_below(1, size)
    value = jnp.where(size < SWITCH_POINT, below, _hankel_above(1, size)[0])
    return jnp.where(x < 0, -value, value)


@_j1.defjvp
def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    # DLMF 10.6.2 with n = 1: J_1' = J_0 - J_1 / x.
    (x,), (x_dot,) = primals, tangents
    return _j1(x), (_j0(x) - _scaled_j(1, x)) * x_dot


@partial(jax.custom_jvp, nondiff_argnums=(0,))
@partial(_compiled, static_argnums=0)
def _scaled_j(order: int, x: Array) -> Array:
    """J_n(x) / x^n for n >= 1: even and entire, 1 / (2^n n!) at 0."""
    x = _size(x)
    below = _scaled_j_below(1, x) if order == 1 else _scaled_j_series(order, x)
    # Above, J_{n+1} / x^{n+1} = (2n J_n / x^n - J_{n-1} / x^{n-1}) / x^2 (DLMF 10.6.1).
    above = _at_least(x)
    previous, current = _hankel_above(0, x)[0], _hankel_above(1, x)[0] / above
    for n in range(1, order):
        previous, current = current, (2 * n * current - previous) / above**2
    return jnp.where(x < SWITCH_POINT, below, current)


@_scaled_j.defjvp
def _(order: int, primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    # DLMF 10.6.6 with k = 1: d/dx (J_n / x^n) = -J_{n+1} / x^n = -x (J_{n+1} / x^{n+1}).
    (x,), (x_dot,) = primals, tangents
    return _scaled_j(order, x), -x * _scaled_j(order + 1, x) * x_dot


@partial(jax.custom_jvp, nondiff_argnums=(0,))
@partial(_compiled, static_argnums=0)
def _both(order: int, x: Array) -> tuple[Array, Array]:
    size = _size(x)
    below, u = _below(size)
    scaled = _scaled_j_below(order, size)
    positive = jnp.where(below > 0, below, 1.0)
    # log(x/2) J_n - n/x, then the part that is entire after division by x^n.
    singular = jnp.log(positive / 2) * scaled
    regular = _horner(REGULAR_Y[order], u)
    if order == 1:
        scaled = below * scaled
        singular = singular * below - 1 / positive
        regular = regular * below
    j_above, y_above = _hankel_above(order, size)
    j = jnp.where(size < SWITCH_POINT, scaled, j_above)
    if order == 1:
        j = jnp.where(x < 0, -j, j)
    y = jnp.where(size < SWITCH_POINT, 2 / math.pi * singular + regular, y_above)
    return j, jnp.where(x > 0, y, jnp.where(x == 0, -jnp.inf, jnp.nan))


@_both.defjvp
def _(order: int, primals: tuple[Array], tangents: tuple[Array]):
    # DLMF 10.6.3: C_0' = -C_1, and 10.6.2 with n = 1: C_1' = C_0 - C_1 / x.
    (x,), (x_dot,) = primals, tangents
    j, y = _both(order, x)
    other_j, other_y = _both(1 - order, x)
    if order == 0:
        return (j, y), (-other_j * x_dot, -other_y * x_dot)
    return (j, y), ((other_j - _scaled_j(1, x)) * x_dot, (other_y - y / x) * x_dot)


# The two ranges, for x >= 0 and n = 0, 1. JAX leaves derivative rules aside where it differentiates
# what reverse mode has kept of a loop, so the formulas themselves must have the right slopes at
# their seams too: abs, minimum and maximum would give half of it, or none. NaN goes through.


def _size(x: Array) -> Array:
    """|x|, at 0 with the slope from the right."""
    return jnp.where(x < 0, -x, x)


def _at_most(x: Array) -> Array:
    """min(x, X), at X with the slope 0: there the upper range counts."""
    return jnp.where(x >= SWITCH_POINT, SWITCH_POINT, x)


def _at_least(x: Array) -> Array:
    """max(x, X), at X with the slope 1."""
    return jnp.where(x < SWITCH_POINT, SWITCH_POINT, x)


def _horner(coefficients: Sequence[float], u: Array) -> Array:
    """sum_k c_k u^k."""
    value = jnp.full_like(u, coefficients[-1])
    for c in coefficients[-2::-1]:
        value = value * u + c
    return value


def _below(x: Array) -> tuple[Array, Array]:
    """min(x, X), and u = 2 (x/X)^2 - 1 in [-1, 1]."""
    x = _at_most(x)
    return x, x * x * (2 / SWITCH_POINT**2) - 1


def _scaled_j_below(order: int, x: Array) -> Array:
    """J_n(x) / x^n; the zero z is a factor, so that the relative error stays small beside it."""
    x, u = _below(x)
    leading, remainder = ZERO[order]
    # x^2 - z^2 as a product and a constant: of (x - c) - d, XLA would make x - (c + d).
    return _horner(REDUCED_J[order], u) * ((x - leading) * (x + leading) - remainder)


def _scaled_j_series(order: int, x: Array) -> Array:
    """J_n(x) / x^n for n >= 2 by the power series (DLMF 10.2.2); it hardly cancels for x < 5."""
    x, _ = _below(x)
    terms = range(20)  # 6.25^20 / (20! 22!) = 3e-24
    return _horner(
        [(-1) ** k / (2**order * math.factorial(k) * math.factorial(k + order)) for k in terms],
        x * x / 4,
    )


def _hankel_above(order: int, x: Array) -> tuple[Array, Array]:
    """J_n(x) and Y_n(x) by modulus and phase."""
    x = _at_least(x)
    inverse = 1 / x
    u = 2 * (SWITCH_POINT * inverse) ** 2 - 1
    amplitude = jnp.sqrt(2 / math.pi * inverse) * _horner(MODULUS[order], u)
    turns, angle, rest = _reduced_phase(x)
    sine, cosine = _sine_cosine(angle, rest + _horner(PHASE[order], u) * inverse)
    # The phase is angle + rest + t/x + (turns - n) pi/2, and only the turns modulo 4 matter.
    turns = turns - order
    quarter = turns - 4 * jnp.floor(turns / 4)
    odd = (quarter == 1) | (quarter == 3)
    j = jnp.where(odd, sine, cosine)
    y = jnp.where(odd, cosine, sine)
    return (
        amplitude * jnp.where((quarter == 1) | (quarter == 2), -j, j),
        amplitude * jnp.where(quarter >= 2, -y, y),
    )


def _reduced_phase(x: Array) -> tuple[Array, Array, Array]:
    """q, r, s with x - pi/4 = r + s + q pi/2, |r| <= pi/4 and s of the size of one rounding.

    With m = 2q + 1 the nearest odd number to 4x/pi, r + s = x - m pi/4 is subtracted in three
    parts (Cody and Waite): the products with the leading parts of pi/4 are exact, so is the first
    difference, and the rounding of the second is kept. The shift by (2n + 1) pi/4 is then whole
    quarter turns for every n, and the cancellation in x - (2n + 1) pi/4 never happens.
    """
    single = x.dtype == jnp.float32
    leading, middle, trailing = QUARTER_PI_FLOAT32 if single else QUARTER_PI_FLOAT64
    # Beyond 1/eps the spacing of floats exceeds one radian and no phase is meaningful.
    x = jnp.minimum(x, 1 / float(jnp.finfo(x.dtype).eps))
    turns = jnp.floor(x * (2 / math.pi))
    m = 2 * turns + 1
    difference = x - m * leading
    correction = m * middle
    angle = difference - correction
    rest = ((difference - angle) - correction) - m * trailing
    return turns, angle, rest


def _sine_cosine(angle: Array, rest: Array) -> tuple[Array, Array]:
    """sin and cos of angle + rest for |angle + rest| < 0.87, |rest| < 0.1, beyond one rounding."""
    r = angle + rest
    low = (angle - r) + rest
    square = r * r
    # sin(r + low) = sin r + low cos r, cos(r + low) = cos r - low sin r; low is one rounding of r.
    sine = r + (r * square * _horner(_SINE, square) + low * (1 - 0.5 * square))
    cosine = 1 - (0.5 * square - (square * square * _horner(_COSINE, square) - r * low))
    return sine, cosine
