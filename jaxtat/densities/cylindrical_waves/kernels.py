"""What the detectors record of each cylindrical wave: the kernels of step 1.

A source at x in the region and a detector at z, both counted from the centre of the waves, have

    G_J + i G_Y = Σ_n J_n(lambda |x|) h_n(|z|) e^{in(theta_z - theta_x)},

with h_n = h_-n by the speed of sound on the way. Where it is that of the region, h_n = H_n = J_n +
i Y_n of lambda |z| (Graf, DLMF 10.23.7). The rim of a body of another speed, a circle about the
same centre, multiplies each order by a complex factor and changes the frequency outside. Any other
rim mixes orders, and each detector has its own factors for cosines and sines.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...geometry import DiskBody, OutlineBody
from ...special import (
    angular,
    outline_residual,
    scaled_hankel_sequence,
    transmitted_factors,
    waves_through_outline,
)


class Kernels(eqx.Module):
    """What detectors record of the waves of the region."""

    @property
    def highest_ratio(self) -> Float[Array | np.ndarray, ""]:
        """The largest frequency on the way, over that in the region: orders are to resolve both."""
        return np.ones(())

    @abstractmethod
    def of_detectors(
        self,
        frequency: Float[Array, ""],
        distance: Float[Array, " detectors"],
        angles: Float[Array, " detectors"],
        steps: Float[Array, " orders"],
    ) -> Float[Array, "2 2 fewer detectors"]:
        """Real and imaginary part of what they record of Delta_n^-1 J_n (cos|sin)(n theta).

        Args:
            frequency: lambda in the region [rad/length].
            distance, angles: |z| [length], and theta_z, counted from the axis [rad].
            steps: of the scales Delta_n, up to N + 1, see `special.decay_steps`.
        """


class RadialKernels(Kernels):
    """h_n at one or many frequencies and distances."""

    def of_detectors(
        self, frequency: Array, distance: Array, angles: Array, steps: Array
    ) -> Float[Array, "2 2 fewer detectors"]:
        radial = self.at(frequency, distance, steps[:, None])
        return radial[:, None] * angular(steps.shape[0] - 2, angles)

    @abstractmethod
    def at(
        self,
        frequency: Float[Array, "*f"],
        distance: Float[Array, "*detectors"],
        steps: Float[Array, "orders *broadcast"],
    ) -> Float[Array, "2 fewer *shape"]:
        """Real and imaginary part of eps_n Delta_n h_n, n = 0..N.

        Args:
            frequency: lambda in the region [rad/length]; broadcasts against distances.
            distance: |z| [length].
            steps: of the scales Delta_n, up to N + 1, see `special.decay_steps`.
        """


class HankelKernels(RadialKernels):
    """h_n = J_n + i Y_n of lambda |z|: one speed of sound."""

    def at(self, frequency: Array, distance: Array, steps: Array) -> Array:
        argument = frequency * distance
        j, y = scaled_hankel_sequence(argument, steps[:-1])
        scale = jnp.cumprod(steps[:-1], axis=0)
        eps = twice(steps.shape[0] - 2).reshape(-1, *[1] * argument.ndim)
        return eps * jnp.stack([j * scale**2, y])


class BodyKernels(RadialKernels):
    """h_n = t_n H_n(lambda |z| c_1/c_2): sources in a body, detectors in the water around it.

    Attributes:
        body: about the centre of the waves.
    """

    body: DiskBody

    @property
    def highest_ratio(self) -> Float[Array, ""]:
        return jnp.maximum(self.body.speed_ratio, 1.0)

    def at(self, frequency: Array, distance: Array, steps: Array) -> Array:
        body, n_max = self.body, steps.shape[0] - 2
        inner = frequency * body.radius
        outer = inner * body.speed_ratio
        factors = transmitted_factors(n_max, inner, outer, body.density_ratio)
        argument = frequency * distance * body.speed_ratio
        each = n_max + 1, *[1] * (argument.ndim - inner.ndim), *inner.shape
        real, imaginary = (factor.reshape(each) for factor in factors)
        j, y = scaled_hankel_sequence(argument, steps[:-1])
        j = j * jnp.cumprod(steps[:-1], axis=0) ** 2
        eps = twice(n_max).reshape(-1, *[1] * argument.ndim)
        return eps * jnp.stack([real * j - imaginary * y, real * y + imaginary * j])


class OutlineKernels(Kernels):
    """Sources in a body with any outline: a system of equations for each frequency.

    Attributes:
        body: its centre is that of the waves.
        axis: from which angles are counted [rad].
    """

    body: OutlineBody
    axis: Float[Array, ""]

    @property
    def highest_ratio(self) -> Float[Array, ""]:
        return jnp.maximum(self.body.speed_ratio, 1.0)

    def of_detectors(self, frequency: Array, distance: Array, angles: Array, steps: Array) -> Array:
        return waves_through_outline(*self._problem(frequency, distance, angles, steps))

    @eqx.filter_jit
    def residual(
        self, frequency: Array, distance: Array, angles: Array, steps: Array
    ) -> Float[Array, ""]:
        """Of equations that were not solved, see `special.outline_residual`."""
        return outline_residual(*self._problem(frequency, distance, angles, steps))

    def _problem(self, frequency: Array, distance: Array, angles: Array, steps: Array) -> Any:
        body = self.body
        return (
            body.nodes(steps.shape[0] - 2, self.axis),
            (frequency, frequency * body.speed_ratio),
            body.density_ratio,
            steps,
            (distance * jnp.stack([jnp.cos(angles), jnp.sin(angles)])).T,
        )


def twice(n_max: int) -> Float[Array, " orders"]:
    """eps_n: 1 for n = 0, else 2."""
    return jnp.where(np.arange(n_max + 1) == 0, 1.0, 2.0)
