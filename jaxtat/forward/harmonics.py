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
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..special import legendre_functions
from .sphere_sizes import Band


class Harmonics(eqx.Module):
    """Real and imaginary parts of H_lm, orders m first.

    Attributes:
        even: l = m, m + 2, ..., (orders, 2, volumes, frequencies, degrees).
        odd: l = m + 1, m + 3, ...
    """

    even: Float[Array, "orders 2 volumes k even_degrees"]
    odd: Float[Array, "orders 2 volumes k odd_degrees"]


class Directions(eqx.Module):
    """Where F is needed for one band of frequencies, and the Legendre functions there.

    Attributes:
        frequencies: lambda_k [rad/length].
        cosines: u_j > 0.
        even, odd: 4π w_j P_lm(u_j), by parity of l - m.
        azimuths: how many, over a whole turn.
    """

    frequencies: Float[Array, " k"]
    cosines: Float[Array, " polar"]
    even: Float[Array, "orders even_degrees polar"]
    odd: Float[Array, "orders odd_degrees polar"]
    azimuths: int = eqx.field(static=True)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the samples: (frequencies, polar, azimuths)."""
        return self.frequencies.shape[0], self.cosines.shape[0], self.azimuths

    @property
    def units(self) -> tuple[Float[Array, "polar azimuths"], ...]:
        """The three components of w."""
        azimuth = 2 * np.pi / self.azimuths * np.arange(self.azimuths)
        cosine = self.cosines[:, None]
        sine, like = jnp.sqrt(1 - cosine**2), cosine.dtype
        parts = sine * np.cos(azimuth).astype(like), sine * np.sin(azimuth).astype(like), cosine
        return tuple(jnp.broadcast_arrays(*parts))

    def harmonics(self, values: Complex[Array, "volumes k polar azimuths"]) -> Harmonics:
        """H_lm from F."""
        n_orders = self.even.shape[0]
        spectrum = jnp.fft.fft(values, norm="forward")
        here = spectrum[..., :n_orders]
        there = jnp.roll(jnp.flip(spectrum, axis=-1), 1, axis=-1)[..., :n_orders].conj()
        a, b = (here + there) / 2, -0.5j * (here - there)
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
    return Directions(frequencies, cosines, table[:, 0::2], table[:, 1::2], band.azimuths)


def half_gauss_rule(band: Band) -> tuple[np.ndarray, np.ndarray]:
    """The half u_j > 0 of Gauss's rule with 2 polar nodes."""
    nodes, weights = np.polynomial.legendre.leggauss(2 * band.polar)
    return nodes[band.polar :], weights[band.polar :]


def _legendre(band: Band, cosines: Array) -> Float[Array, "orders degrees polar"]:
    return legendre_functions(jnp.arange(band.orders), band.degrees, cosines, band.orders)


def _over_polar(
    values: Complex[Array, "volumes k polar orders"], table: Float[Array, "orders i polar"]
) -> Float[Array, "orders 2 volumes k i"]:
    parts = jnp.stack([values.real, values.imag])
    return jnp.einsum("cbkum,miu->mcbki", parts, table)
