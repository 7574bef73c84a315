"""Spherical harmonics of a volume's Fourier transform, from its values in half of all directions.

F(xi) = ∫ f exp(i xi·x) dx of a real f is a + i b with a(-xi) = a(xi), b(-xi) = -b(xi). So the even
degrees of F are those of a, the odd ones i times those of b, and together they are those of the
real function H = a + b:

    H_lm = ∫ H conj Y_lm dw = 4π Σ_j w_j P_lm(u_j) (a_m | b_m)(u_j),    u_j > 0,

for even | odd l, with a_m, b_m the Fourier coefficients over the azimuth, H_{l,-m} = conj H_lm, and
Gauss's rule (u_j, w_j) in cos theta. Degrees are l = m + i, with i even and odd apart, as the
symmetry P_lm(-u) = (-1)^i P_lm(u) wants them.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..special import legendre_functions
from .spherical_sizes import Band


class Harmonics(eqx.Module):
    """Real and imaginary parts of H_lm, orders m first.

    Attributes:
        even: l = m, m + 2, ..., (orders, 2, volumes, frequencies, degrees).
        odd: l = m + 1, m + 3, ...
    """

    even: Float[Array, "orders 2 volumes k even_degrees"]
    odd: Float[Array, "orders 2 volumes k odd_degrees"]


class Directions(eqx.Module):
    """Directions of F for one band of frequencies, and the Legendre functions there.

    Attributes:
        frequencies: lambda_k [rad/length].
        cosines: u_j > 0.
        even, odd: 4π w_j P_lm(u_j), by parity of l - m.
        zones: (circles, azimuths), see `Band`.
    """

    frequencies: Float[Array, " k"]
    cosines: Float[Array, " polar"]
    even: Float[Array, "orders even_degrees polar"]
    odd: Float[Array, "orders odd_degrees polar"]
    zones: tuple[tuple[int, int], ...] = eqx.field(static=True)

    @property
    def units(self) -> Float[Array, "3 directions"]:
        """w, zone after zone, in each of them azimuths last."""
        parts, start = [], 0
        for circles, azimuths in self.zones:
            cosine = self.cosines[start : start + circles, None]
            start += circles
            azimuth = (2 * np.pi / azimuths * np.arange(azimuths)).astype(cosine.dtype)
            sine = jnp.sqrt(1 - cosine**2)
            unit = jnp.broadcast_arrays(sine * jnp.cos(azimuth), sine * jnp.sin(azimuth), cosine)
            parts.append(jnp.stack(unit).reshape(3, -1))
        return jnp.concatenate(parts, axis=1)

    def harmonics(self, values: Complex[Array, "volumes k directions"]) -> Harmonics:
        """H_lm from F."""
        n_orders = self.even.shape[0]
        even, odd, start = [], [], 0
        for circles, azimuths in self.zones:
            stop = start + circles * azimuths
            a, b = _over_azimuths(values[..., start:stop].reshape(*values.shape[:2], -1, azimuths))
            even.append(_of_orders(a, n_orders))
            odd.append(_of_orders(b, n_orders))
            start = stop
        a, b = jnp.concatenate(even, axis=2), jnp.concatenate(odd, axis=2)
        same = np.arange(n_orders) % 2 == 0  # l - m even: l is even
        return Harmonics(
            _over_polar(jnp.where(same, a, b), self.even),
            _over_polar(jnp.where(same, b, a), self.odd),
        )


@eqx.filter_jit
def directions_of(
    band: Band, frequencies: Float[Array, " k"], cosines: Array, weights: Array
) -> Directions:
    """All tables of a band; cosines and weights of `half_gauss_rule`."""
    table = 4 * jnp.pi * weights * _legendre(band, cosines)
    return Directions(frequencies, cosines, table[:, 0::2], table[:, 1::2], band.zones)


def half_gauss_rule(band: Band) -> tuple[np.ndarray, np.ndarray]:
    """The half u_j > 0 of Gauss's rule with 2 polar nodes."""
    nodes, weights = np.polynomial.legendre.leggauss(2 * band.polar)
    return nodes[band.polar :], weights[band.polar :]


def _legendre(band: Band, cosines: Array) -> Float[Array, "orders degrees polar"]:
    return legendre_functions(jnp.arange(band.orders), band.degrees, cosines, band.orders)


def _over_azimuths(values: Complex[Array, "*n q"]) -> tuple[Complex[Array, "*n q"], ...]:
    """a_m and b_m of F = a + i b, m = 0 .. Q - 1."""
    here = jnp.fft.fft(values, norm="forward")
    there = jnp.roll(jnp.flip(here, axis=-1), 1, axis=-1).conj()
    return (here + there) / 2, -0.5j * (here - there)


def _of_orders(values: Complex[Array, "*n q"], n: int) -> Complex[Array, "*n orders"]:
    """The first n; higher ones than there are azimuths are zero."""
    more = max(0, n - values.shape[-1])
    return jnp.pad(values[..., :n], [(0, 0)] * (values.ndim - 1) + [(0, more)])


def _over_polar(
    values: Complex[Array, "volumes k polar orders"], table: Float[Array, "orders i polar"]
) -> Float[Array, "orders 2 volumes k i"]:
    parts = jnp.stack([values.real, values.imag])
    return jnp.einsum("cbkum,miu->mcbki", parts, table)
