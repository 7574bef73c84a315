"""Step 2 in space: radial transform of the data with j_0 and y_0, and Fourier series in azimuth."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry import BallBody
from ..steps.quadrature import radial_quadrature


def spherical_kernels(
    radii: Float[Array, " radii"],
    frequencies: Float[Array, " frequencies"],
    medium: BallBody | None = None,
) -> Float[Array, "frequencies 2 radii"]:
    """j_0(lambda r) = sin(lambda r)/(lambda r) and y_0 = -cos(lambda r)/(lambda r), weighted.

    With the weights of `radial_quadrature`, G = Σ_r kernel g is ∫ g(z, r) (j_0|y_0)(lambda r) dr.
    Outside of a body the waves of lambda in it have the frequency lambda c_1/c_2; its sources are
    counted by their strength in the body.
    """
    if medium is not None:
        outside = spherical_kernels(radii, frequencies * medium.speed_ratio)
        return outside / medium.source_strength
    nodes, weights = radial_quadrature(radii)
    argument = frequencies[:, None] * nodes
    kernels = jnp.stack([jnp.sin(argument), -jnp.cos(argument)], axis=1) / argument[:, None]
    return kernels @ weights


def azimuthal_transform(
    g: Float[Array, "images rings azimuths radii"],
    kernels: Float[Array, "frequencies 2 radii"],
    first_azimuths: Float[Array, " rings"],
    n_orders: int,
    n_padded: int,
) -> tuple[
    Float[Array, "rings n_padded frequencies 2 images 2"], Float[Array, "frequencies rings"]
]:
    """G_m(theta) = (1/n) Σ_k G(theta, phi_k) e^{-i m phi_k}, m = 0 .. n_orders - 1.

    Args:
        g: spherical integrals.
        kernels: of `spherical_kernels`.
        first_azimuths: phi_0 of each ring; phi_k = phi_0 + 2π k/n.
        n_orders: at most half the azimuths.
        n_padded: beyond n_orders there are zeros.

    Returns:
        G_m, (rings, orders, frequencies, J|Y, images, real|imaginary), and the mean of G² over
        images, J|Y and azimuths.
    """

    def of_ring(given: tuple[Array, Array]) -> tuple[Array, Array]:
        ring, first = given
        values = jnp.einsum("fjr,iar->fjia", kernels, ring)
        series = jnp.fft.rfft(values, norm="forward")[..., :n_orders]
        series *= jnp.exp(-1j * first * jnp.arange(n_orders))
        parts = jnp.stack([series.real, series.imag], axis=-1)
        padded = jnp.pad(jnp.moveaxis(parts, -2, 0), ((0, n_padded - n_orders), *[(0, 0)] * 4))
        return padded, jnp.mean(values**2, axis=(1, 2, 3))

    # ring by ring: the transformed data of all azimuths would be several times the data
    series, power = jax.lax.map(jax.checkpoint(of_ring), (jnp.moveaxis(g, 1, 0), first_azimuths))
    return series, power.T
