"""Step 3: the Fourier transform of the image on a polar grid."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float


@jax.jit
def polar_fourier(
    transformed: Float[Array, "*batch frequencies 2 detectors"],
    densities: Complex[Array, "frequencies directions 2 detectors"],
    weights: Float[Array, " detectors"],
    mass: Float[Array, "*batch detectors"],
) -> Complex[Array, "*batch frequencies+1 directions"]:
    """fhat(xi) = (1/2π) ∫_gamma (rho_J G_J + rho_Y G_Y) dl, at lambda = 0 and all others.

    For f inside the region this is (1/2π) ∫ f(x) exp(-i xi·(x - c)) dx. The value at 0 is the
    total mass over 2π, taken as the mean of ∫ g dr over the curve.

    Args:
        transformed: (G_J, G_Y) of step 2 at the frequencies of the densities.
        densities: (rho_J, rho_Y) of step 1 [1/length], in single or double precision.
        weights: arc lengths w_k [length].
        mass: ∫ g dr per detector.

    Returns:
        Complex; the first frequency is 0.

    Source: Kunyansky 2008, section 3.
    """
    weighted = (weights * transformed).astype(densities.real.dtype)
    total = jnp.einsum("fdjk,...fjk->...fd", densities, weighted)
    origin = (mass @ weights) / weights.sum()
    origin = jnp.broadcast_to(origin[..., None, None], (*mass.shape[:-1], 1, densities.shape[1]))
    # the origin is of double precision, and so is the result
    return jnp.concatenate([origin + 0j, total], axis=-2) / (2 * jnp.pi)
