"""Spherical Bessel functions j_l, y_l of all orders 0 .. l_max, and normalised Legendre functions.

j_l(x) = √(π/2x) J_{l+1/2}(x), y_l alike: recurrences are those of `sequences`, half an order on.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int, Num

from .bessel import as_floating
from .sequences import carried_upward, largest_value, order_count, ratios


def spherical_sequence(
    l_max: int, x: Num[ArrayLike, "*shape"]
) -> tuple[Float[Array, "orders *shape"], Float[Array, "orders *shape"]]:
    """j_l(x) and y_l(x), l = 0 .. l_max, by f_{l+1} + f_{l-1} = ((2l + 1)/x) f_l.

    Args:
        l_max: highest order, a Python integer (static under jit).
        x: positive, any shape, no unit; float32 and float64 keep their dtype.

    Returns:
        j and y, each of shape (l_max + 1, *x.shape). Where they under- and overflow, at x = 0 and
        for x < 0, as `hankel_sequence`.

    Raises:
        TypeError: l_max is not an integer, or x is complex or has half precision.
        ValueError: l_max is negative.

    Source: DLMF 10.51.1, 10.51.2 (recurrences and derivatives), 10.49(i) (l = 0, 1).

    >>> j, y = spherical_sequence(10, 2.0)
    >>> print(f"{j[10]:.6e} {y[10]:.6e}")
    6.825301e-08 -3.554147e+05
    """
    x = as_floating(x)
    l_max = order_count(l_max, "l_max")
    return _sequence(l_max, x, jnp.ones((l_max + 1, *[1] * x.ndim), x.dtype))


def scaled_spherical_sequence(
    x: Float[Array, "*shape"], steps: Float[Array, "orders *broadcast"]
) -> tuple[Float[Array, "orders *shape"], Float[Array, "orders *shape"]]:
    """j_l(x) / Delta_l and Delta_l y_l(x), Delta_l = delta_0 ... delta_l.

    Args:
        x: positive.
        steps: delta_l, l = 0 .. l_max, of `decay_steps`: J_l and j_l decay alike, up to √l.

    Returns:
        Two arrays, (l_max + 1, *x.shape).

    >>> from jaxtat.special import decay_steps
    >>> x = jnp.array([1.0, 1.3])
    >>> j, y = scaled_spherical_sequence(x, decay_steps(400, x[:1]))
    >>> print(f"{j[400, 0] * y[400, 1] * 801 * 1.3**401:.4f}")  # ~ -(R/R_g)^l / ((2l + 1) R_g)
    -1.0004
    """
    return _sequence(steps.shape[0] - 1, x, steps)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
@partial(jax.jit, static_argnums=0)
def _sequence(l_max: int, x: Array, steps: Array) -> tuple[Array, Array]:
    """j_l / Delta_l and Delta_l y_l; ``steps`` are constants to differentiation."""
    x = jnp.where(x >= 0, x, jnp.nan)
    high = ratios(l_max, x, half=0.5)
    j_0, cosine = jnp.sinc(x / np.pi), jnp.cos(x)
    # below 1 the closed form of j_1 cancels, and the ratio to j_0 is at hand
    j_1 = jnp.where(x < 1, x / (3 - x * high[0]) * j_0, (j_0 - cosine) / jnp.where(x < 1, 1.0, x))
    y_0 = -cosine / x
    return carried_upward(l_max, x, steps, (j_0, j_1, y_0, (y_0 - jnp.sin(x)) / x), high, half=0.5)


@_sequence.defjvp
def _(l_max: int, primals: tuple[Array, Array], tangents: tuple[Array, Array]):
    # DLMF 10.51.2: (2l + 1) j_l' = l j_{l-1} - (l + 1) j_{l+1}, which does not cancel at small x;
    # y_l' = y_{l-1} - ((l + 1)/x) y_l with y_{-1} = j_0, see `sequences`.
    (x, steps), (x_dot, _) = primals, tangents
    steps = jnp.concatenate([steps, jnp.ones((1, *steps.shape[1:]), steps.dtype)])
    j, y = _sequence(l_max + 1, x, steps)
    order = jnp.arange(l_max + 1, dtype=x.dtype).reshape(-1, *[1] * x.ndim)
    j_before = jnp.concatenate([jnp.zeros_like(j[:1]), j[:-2] / steps[1:-1]])
    j_slope = (order * j_before - (order + 1) * j[1:] * steps[1:]) / (2 * order + 1)
    y_before = jnp.concatenate([j[:1] * steps[:1] ** 2, y[:-2] * steps[1:-1]])
    y = y[:-1]
    y_slope = jnp.where(y <= -largest_value(y), 0.0, y_before - (order + 1) / x * y)
    return (j[:-1], y), (j_slope * x_dot, y_slope * x_dot)


@partial(jax.jit, static_argnames=("n_degrees", "highest", "over_sine"))
def legendre_functions(
    orders: Int[Array, " orders"],
    n_degrees: int,
    cosine: Float[Array, " points"],
    highest: int,
    *,
    over_sine: bool = False,
) -> Float[Array, "orders n_degrees points"]:
    """Normalised associated Legendre functions P_lm(cos theta), l = m, m + 1, ..., of orders m.

    Y_lm = P_lm(cos theta) e^{i m phi}, P_lm >= 0 near theta = 0 (not Condon and Shortley's sign)
    and ∫ |Y_lm|² = 1. Upward in l at fixed m, the stable direction,

        P_lm = a_l (cos theta P_{l-1,m} - P_{l-2,m} / a_{l-1}),  a_l² = (4l² - 1)/(l² - m²),

    from P_mm = √((2m + 1)!! / (4π (2m)!!)) sin^m theta. That underflows only where all P_lm with
    l < 2000 are negligible.

    Args:
        orders: m >= 0, which may be traced.
        n_degrees: how many degrees l from l = m on (static).
        cosine: cos theta in [-1, 1]; differentiable within (-1, 1), and constant for derivatives
            at the poles.
        highest: the largest m that may come (static).
        over_sine: gives P_lm / sin^m theta instead, polynomials that are smooth at the poles too;
            too large for floats where degrees go up to thousands.

    Returns:
        (orders, n_degrees, points), P of l = m + i at index i.

    Source: DLMF 14.10.3, 14.30; Press et al., Numerical Recipes (2007), section 6.7.

    >>> p = np.asarray(legendre_functions(jnp.array([0, 1]), 2, jnp.array([0.6]), 1))
    >>> cosine, sine = np.sqrt(4 * np.pi / 3) * p[0, 1, 0], np.sqrt(8 * np.pi / 3) * p[1, 0, 0]
    >>> round(float(cosine), 12), round(float(sine), 12)
    (0.6, 0.8)
    """
    m = np.arange(1, highest + 1)
    first = np.cumprod(np.concatenate([[np.sqrt(0.25 / np.pi)], np.sqrt((2 * m + 1) / (2 * m))]))
    square = 1 - cosine**2
    real = orders.astype(cosine.dtype)[:, None]
    # at the poles a constant: there the power's slope is infinite, which would spoil that of others
    power = jnp.where(square > 0, jnp.where(square > 0, square, 1.0) ** (real / 2), real == 0)
    start = jnp.asarray(first)[orders][:, None] * (jnp.ones_like(power) if over_sine else power)

    def inverse_factor(degree: Array) -> Array:
        """1 / a_l; 0 for l = m."""
        return jnp.sqrt((degree**2 - real**2) / (4 * degree**2 - 1))

    def upward(carry: tuple[Array, Array], i: Array):
        before, last = carry
        degree = real + i
        value = (cosine * last - inverse_factor(degree - 1) * before) / inverse_factor(degree)
        return (last, value), last

    steps = jnp.arange(1, n_degrees + 1, dtype=cosine.dtype)
    _, values = jax.lax.scan(upward, (jnp.zeros_like(start), start), steps)
    return jnp.moveaxis(values, 0, 1)
