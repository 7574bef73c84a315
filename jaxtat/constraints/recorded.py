"""From circular integrals to what was recorded: pressure, and what it went through since."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Conditioning = Callable[[Array], Array]  # (..., detectors, times) -> the same, linear


class PressureOf(eqx.Module):
    """p = conditioning(V g), linear in g.

    Attributes:
        matrix: V, (times, radii), by `pressure_matrix`.
        conditioning: linear, or None.
    """

    matrix: Float[Array, "times radii"]
    conditioning: Conditioning | None

    def __call__(self, integrals: Float[Array, "*batch detectors radii"]) -> Array:
        """(..., detectors, times)."""
        pressure = jnp.einsum("...kr,tr->...kt", integrals, self.matrix)
        return pressure if self.conditioning is None else self.conditioning(pressure)
