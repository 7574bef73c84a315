"""Step 3: the Fourier transform of the image on a polar grid."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ..densities import Densities


@jax.jit
def polar_fourier(
    transformed: Float[Array, "*batch frequencies 2 detectors"],
    densities: Densities,
    weights: Float[Array, " detectors"],
    mass: Float[Array, "*batch detectors"],
) -> Complex[Array, "*batch frequencies+1 directions"]:
    """fhat(xi) = (1/2π) ∫_gamma (rho_J G_J + rho_Y G_Y) dl, at lambda = 0 too.

    For f inside the region this is (1/2π) ∫ f(x) exp(-i xi·(x - c)) dx. The value at 0 is the
    total mass over 2π, taken as the mean of ∫ g dr over the curve.

    Args:
        transformed: (G_J, G_Y) of step 2 at the frequencies of the densities.
        densities: (rho_J, rho_Y) of step 1, in single or double precision.
        weights: arc lengths w_k [length].
        mass: ∫ g dr per detector.

    Returns:
        Complex; the first frequency is 0.

    Source: Kunyansky 2008, section 3.
    """
    return with_origin(densities.polar_fourier(transformed, weights), mass, weights)


def with_origin(
    fhat: Complex[Array, "*batch frequencies directions"],
    mass: Float[Array, "*batch detectors"],
    weights: Float[Array, " detectors"],
) -> Complex[Array, "*batch frequencies+1 directions"]:
    """fhat with its value at lambda = 0 in front: the total mass over 2π.

    Args:
        fhat: at lambda > 0.
        mass: ∫ g dr, which is the mass for every detector.
        weights: arc lengths w_k, for the mean over the curve [length].
    """
    origin = value_at_origin(mass, weights)
    shape = (*fhat.shape[:-2], 1, fhat.shape[-1])
    # the origin is of double precision, and so is the result
    return jnp.concatenate([jnp.broadcast_to(origin[..., None, None], shape) + 0j, fhat], axis=-2)


def value_at_origin(
    mass: Float[Array, "*batch detectors"], weights: Float[Array, " detectors"]
) -> Float[Array, "*batch"]:
    """fhat(0), the mean of the detectors' masses over 2π."""
    return (mass @ weights) / (2 * jnp.pi * weights.sum())
