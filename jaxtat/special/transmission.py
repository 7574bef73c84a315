"""What passes through a circle between two media, of each cylindrical wave.

In the body, |x| < a, waves have the number k_1, in the water around it k_2. What comes from outside
as J_n(k_2 |x|) e^{in theta} is t_n J_n(k_1 |x|) e^{in theta} inside, and by reciprocity a source at
x in the body gives

    Σ_n t_n J_n(k_1 |x|) H_n(k_2 |z|) e^{in(theta_z - theta_x)}

in the water, H_n = J_n + i Y_n. Pressure and (1/rho) dp/dr are continuous at |x| = a, so that

    t_n = (-2i/π) / (x_1 J_n'(x_1) H_n(x_2) rho_2/rho_1 - x_2 J_n(x_1) H_n'(x_2)),   x_j = k_j a,

which is 1 in one medium, by the Wronskian. For n beyond x_1 and x_2 t_n tends to a multiple of
(k_2/k_1)^n.

Source: Morse and Ingard, Theoretical Acoustics (1968), chapter 8; DLMF 10.5.5.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .sequences import decay_steps, scaled_hankel_sequence


@partial(jax.jit, static_argnums=0)
def transmitted_factors(
    n_max: int,
    inner: Float[Array, "*shape"],
    outer: Float[Array, "*shape"],
    density_ratio: Float[Array, ""],
) -> tuple[Float[Array, "orders *shape"], Float[Array, "orders *shape"]]:
    """Real and imaginary part of t_n, n = 0 .. n_max.

    J_n(x_1) underflows where H_n(x_2) overflows; both come with scales that cancel.

    Args:
        n_max: highest order (static under jit).
        inner, outer: x_1 = k_1 a and x_2 = k_2 a, positive.
        density_ratio: rho_1/rho_2.

    Returns:
        Two arrays, (n_max + 1, *shape).

    >>> x = jnp.array([0.3, 3.0])
    >>> t = transmitted_factors(90, x, x, jnp.array(1.0))
    >>> bool(abs(t[0] - 1).max() < 1e-12), bool(abs(t[1]).max() < 1e-12)
    (True, True)
    """
    steps = decay_steps(n_max + 1, inner)
    square = jnp.cumprod(steps, axis=0)[:-1] ** 2
    j_1, _ = scaled_hankel_sequence(inner, steps)
    j_2, y_2 = scaled_hankel_sequence(outer, steps)
    slope_1, slope_j, slope_y = (
        inner * _slope(j_1, steps) / density_ratio,
        outer * _slope(j_2, steps),
        outer * _slope_of_y(y_2, steps, outer),
    )
    j_1, j_2, y_2 = j_1[:-1], j_2[:-1], y_2[:-1]
    # J_n over Delta_n, and times it: the product of two J has their scales twice
    real = square * (slope_1 * j_2 - j_1 * slope_j)
    imaginary = slope_1 * y_2 - j_1 * slope_y
    size = (real**2 + imaginary**2) * jnp.pi / 2
    return -imaginary / size, -real / size


def _slope(j: Array, steps: Array) -> Array:
    """J_n' over Delta_n, n = 0 .. n_max, from orders up to n_max + 1."""
    before = jnp.concatenate([-j[1:2] * steps[1], j[:-2] / steps[1:-1]])  # J_-1 = -J_1
    return (before - j[1:] * steps[1:]) / 2


def _slope_of_y(y: Array, steps: Array, x: Array) -> Array:
    """Y_n' times Delta_n, as Y_{n-1} - (n/x) Y_n, which does not cancel where Y grows."""
    before = jnp.concatenate([-y[1:2] / steps[1], y[:-2] * steps[1:-1]])
    order = np.arange(y.shape[0] - 1).reshape(-1, *[1] * x.ndim)
    return before - order / x * y[:-1]
