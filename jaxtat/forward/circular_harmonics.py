"""Circular harmonics of the transform of a real image, about one centre and about another.

With F the transform of a real image at |xi| = k, F_m = H_m for even and i H_m for odd orders, H_m
those of a real function of the direction. About another centre F is multiplied by
exp(i xi·(c - c')) and its harmonics are found anew: so waves in water alone, which about the centre
of a body are Σ_m H_m r_m (J_m|Y_m)(k |z - c|) with real r_m, become waves about the centre c' of
the detectors' circle, order by order by Graf's addition theorem, at the price of two FFTs.

Y_n(k |z - c'|) magnifies the rounding of orders n that are small. Where it is above `LARGE` it is
left out, which counts nothing from some frequency on; below it there are few orders, and tables of
the waves at the detectors are small.

Source: DLMF 10.23.7.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft
from jaxtyping import Array, Complex, Float

LARGE = 100.0  # |Y_n| up to which rounding to 32 bits is harmless


def harmonics_of(
    values: Complex[Array, "*n half_turn"], orders: int
) -> Complex[Array, "*n orders"]:
    """H_m, m = 0..M, with F_m = H_m for even and i H_m for odd m.

    f is real, F = a + i b with a(-xi) = a(xi) and b(-xi) = -b(xi): of the real function a + b the
    even harmonics are those of a, the odd ones those of b.
    """
    a, b = values.real, values.imag
    turn = jnp.concatenate([a + b, a - b], axis=-1)
    return jnp.fft.rfft(turn, norm="forward")[..., : orders + 1]


def values_of(
    harmonics: Complex[Array, "*n orders"], half_turn: int
) -> Complex[Array, "*n half_turn"]:
    """F in half a turn of directions, back from H_m."""
    turn = jnp.fft.irfft(harmonics, 2 * half_turn, norm="forward")
    here, there = turn[..., :half_turn], turn[..., half_turn:]
    return jax.lax.complex(here + there, here - there) / 2


def signs(orders: int) -> Float[np.ndarray, " orders"]:
    """(-i)^m of even m, (-i)^m i of odd m, for m and -m together."""
    m = np.arange(orders + 1)
    return np.where(m > 0, 2.0, 1.0) * (-1.0) ** (m // 2)


def turn_for(orders: int) -> int:
    """Directions of a whole turn for harmonics up to an order, of which FFTs are fast."""
    return 2 * int(scipy.fft.next_fast_len(orders + 1, real=True) or 0)


def half_turn_of(turn: int) -> Float[np.ndarray, "half_turn 2"]:
    """Directions of half a turn."""
    omega = 2 * np.pi / turn * np.arange(turn // 2)
    return np.stack([np.cos(omega), np.sin(omega)], axis=-1)


class MovedWaves(eqx.Module):
    """From the waves of an image about a body's centre to those about the detectors' circle.

    Attributes:
        through: real part and minus the imaginary part of t_m, (2, frequencies, orders).
        phases: exp(-i k w·(c' - c)) for half a turn of directions w.
        radial: J_n and Y_n of k |z - c'| with their signs, (2, frequencies, orders).
    """

    through: Float[Array, "2 k inner_orders"]
    phases: Complex[Array, "k half_turn"]
    radial: Float[Array, "2 k outer_orders"]

    def __call__(
        self, harmonics: Complex[Array, "images k inner_orders"]
    ) -> Complex[Array, "images k outer_orders"]:
        """What is summed over orders with exp(i n theta) at the detectors."""
        parts = self.through[:, None] * harmonics
        moved = values_of(parts, self.phases.shape[-1]) * self.phases
        outer = harmonics_of(moved, self.radial.shape[-1] - 1)
        return jnp.sum(outer * self.radial[:, None], axis=0)


def within_reason(y: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Y_n, zero where it is large."""
    return jnp.where(y < -LARGE, 0.0, y)
