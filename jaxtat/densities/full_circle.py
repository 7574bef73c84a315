"""Full circle: the densities of plane waves in closed form (paper, section 3.1).

By Graf's addition theorem, on |z| = R_g and for |x| < R_g,

    J_0(lambda |x - z|) = Σ_n J_n(lambda R_g) J_n(lambda |x|) e^{i n (theta_x - theta_z)},

and Y_0 alike with Y_n(lambda R_g), while the plane wave is
exp(-i xi·x) = Σ_n (-i)^|n| J_|n|(lambda |x|) e^{i n (theta_x - theta_xi)}. Densities with Fourier
coefficients a_n, b_n reproduce it if a_n J_n + b_n Y_n = (-i)^|n| / (2π R_g); the least do so with

    (a_n, b_n) = (-i)^|n| e^{-i n theta_xi} (J_n, Y_n) / |H_n|² / (2π R_g),  |H_n|² = J_n² + Y_n².
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..special import hankel_sequence


@partial(jax.jit, static_argnames="n_orders")
def full_circle_densities(
    frequency: Float[Array, ""],
    angles: Float[Array, " directions"],
    detector_angles: Float[Array, " detectors"],
    radius: Float[Array, ""],
    n_orders: int,
) -> Complex[Array, "directions 2 detectors"]:
    """(rho_J, rho_Y)(z) = Σ_n (-i)^|n| (J_n, Y_n)/|H_n|² e^{i n (theta_z - theta_xi)} / (2π R_g).

    All Bessel functions at lambda R_g. At n detectors, equally spaced, the trapezoid rule
    reproduces the plane wave to rounding once n exceeds lambda (|x| + R_g) by a few tens.

    Args:
        frequency: lambda > 0 [rad/length].
        angles: directions theta_xi of the plane waves exp(-i xi·x), (directions,) [rad].
        detector_angles: theta_z about the centre of the circle, (detectors,) [rad].
        radius: R_g [length].
        n_orders: terms |n| < n_orders; lambda R_g plus some tens reach rounding.

    Returns:
        Complex, (directions, 2, detectors) [1/length].

    Source: Kunyansky 2008, section 3.1; DLMF 10.23.7 (addition theorem).

    >>> from jaxtat.geometry import circular_arc
    >>> from jaxtat.densities import potential
    >>> theta = jnp.linspace(0, 2 * jnp.pi, 64, endpoint=False) + jnp.pi / 64
    >>> lam, x = jnp.array(10.0), jnp.array([[0.3, -0.6]])
    >>> rho = full_circle_densities(lam, jnp.zeros(1), theta, jnp.array(1.3), 60)
    >>> u = potential(lam, rho, circular_arc(1.3, 1.3, 64), x)
    >>> bool(abs(complex(u[0, 0]) - np.exp(-3j)) < 1e-13)
    True
    """
    j, y = hankel_sequence(n_orders - 1, frequency * radius)
    order = jnp.arange(n_orders)
    twice = jnp.where(order == 0, 1.0, 2.0)  # n and -n together: e^{in t} + e^{-in t} = 2 cos n t
    coefficients = jnp.stack([j, y]) / (j**2 + y**2) * twice / (2 * jnp.pi * radius)
    waves = _powers_of_minus_i(n_orders) * coefficients  # (2, orders)
    # cos n (theta_z - theta_xi) split, so that no (directions, detectors, orders) array is made
    z, xi = order[:, None] * detector_angles, order[:, None] * angles
    even = jnp.einsum("jn,nk,nd->djk", waves, jnp.cos(z), jnp.cos(xi))
    odd = jnp.einsum("jn,nk,nd->djk", waves, jnp.sin(z), jnp.sin(xi))
    return even + odd


def _powers_of_minus_i(n: int) -> Array:
    return jnp.asarray(np.array([1, -1j, -1, 1j])[np.arange(n) % 4])
