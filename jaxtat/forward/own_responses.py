"""What elements in the plane record that have impulse responses of their own."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float


class OwnResponses(eqx.Module):
    """Pressure at the elements -> what is kept of p * h, h the response of each.

    In space a response turns the cosines and sines of every wave (`fast_spheres`); of waves in the
    plane the pressure is no sum of these, so that it is folded here, padded so that nothing wraps.

    Attributes:
        transfer: H of every element at the frequencies of the padded record.
        conditioning: what the record went through afterwards, the same for all elements.
    """

    transfer: Complex[Array, "detectors padded_frequencies"]
    conditioning: Float[Array, "times samples"]

    @property
    def n_samples(self) -> int:
        """Number of data of an element."""
        return self.conditioning.shape[-1]

    def __call__(
        self, pressure: Float[Array, "images detectors times"]
    ) -> Float[Array, "images detectors samples"]:
        padded = 2 * (self.transfer.shape[-1] - 1)
        spectrum = jnp.fft.rfft(pressure, padded) * self.transfer
        return jnp.fft.irfft(spectrum, padded)[..., : pressure.shape[-1]] @ self.conditioning
