"""What passes through a circle or sphere between two media, of each wave.

In the body, |x| < a, waves have the number k_1, in the water around it k_2. In the plane what
comes from outside as J_n(k_2 |x|) e^{in theta} is t_n J_n(k_1 |x|) e^{in theta} inside, and by
reciprocity a source at x in the body gives

    Σ_n t_n J_n(k_1 |x|) H_n(k_2 |z|) e^{in(theta_z - theta_x)}

in the water, H_n = J_n + i Y_n. Pressure and (1/rho) dp/dr are continuous at |x| = a, so that

    t_n = -i w / (x_1 J_n'(x_1) H_n(x_2) rho_2/rho_1 - x_2 J_n(x_1) H_n'(x_2)),   x_j = k_j a,

with w = x_2 (J_n Y_n' - J_n' Y_n)(x_2) = 2/π; it is 1 in one medium. For n beyond x_1 and x_2 t_n
tends to a multiple of (k_2/k_1)^n. In space the same holds of j_n and h_n = j_n + i y_n, where
w = 1/x_2, and the sum is Σ_n (2n + 1) t_n j_n(k_1 |x|) h_n(k_2 |z|) P_n(cos of the angle).

Source: Morse and Ingard, Theoretical Acoustics (1968), chapter 8; DLMF 10.5.2, 10.50.1.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .sequences import decay_steps, scaled_hankel_sequence
from .spherical import scaled_spherical_sequence


@partial(jax.jit, static_argnums=0, static_argnames="spherical")
def transmitted_factors(
    n_max: int,
    inner: Float[Array, "*shape"],
    outer: Float[Array, "*shape"],
    density_ratio: Float[Array, ""],
    *,
    spherical: bool = False,
) -> tuple[Float[Array, "orders *shape"], Float[Array, "orders *shape"]]:
    """Real and imaginary part of t_n, n = 0 .. n_max.

    J_n(x_1) underflows where H_n(x_2) overflows; both come with scales that cancel.

    Args:
        n_max: highest order (static under jit).
        inner, outer: x_1 = k_1 a and x_2 = k_2 a, positive.
        density_ratio: rho_1/rho_2.
        spherical: of a ball in space (static).

    Returns:
        Two arrays, (n_max + 1, *shape).

    >>> x = jnp.array([0.3, 3.0])
    >>> t = transmitted_factors(90, x, x, jnp.array(1.0))
    >>> bool(abs(t[0] - 1).max() < 1e-12), bool(abs(t[1]).max() < 1e-12)
    (True, True)
    """
    steps = decay_steps(n_max + 1, inner)
    square = jnp.cumprod(steps, axis=0)[:-1] ** 2
    sequence = scaled_spherical_sequence if spherical else scaled_hankel_sequence
    j_1, _ = sequence(inner, steps)
    j_2, y_2 = sequence(outer, steps)
    down = steps[1:]
    slope_1 = _times_slope(inner, j_1, down) / density_ratio
    slope_j, slope_y = _times_slope(outer, j_2, down), _times_slope(outer, y_2, 1 / down)
    j_1, j_2, y_2 = j_1[:-1], j_2[:-1], y_2[:-1]
    # J_n over Delta_n, and times it: the product of two J has their scales twice
    real = square * (slope_1 * j_2 - j_1 * slope_j)
    imaginary = slope_1 * y_2 - j_1 * slope_y
    wronskian = 1 / outer if spherical else 2 / jnp.pi
    size = (real**2 + imaginary**2) / wronskian
    return -imaginary / size, -real / size


def _times_slope(x: Array, values: Array, step: Array) -> Array:
    """x C_n' = n C_n - x C_{n+1}, n = 0 .. n_max, of C_n and C_{n+1} / step with one scale.

    DLMF 10.6.2 and 10.51.2, of both kinds of either functions. It does not cancel where J falls
    nor, by more than a factor of two, where Y grows.
    """
    order = jnp.arange(values.shape[0] - 1.0).reshape(-1, *[1] * x.ndim)
    return order * values[:-1] - x * step * values[1:]
