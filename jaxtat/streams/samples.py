"""From samples to transformed data: conditioning, pressure to integrals and step 2 as one matrix.

All of it is linear in a detector's record p, the same for all detectors, and so is

    (G_J, G_Y)(lambda) = K I C F m p,

m what silences the start, F the filters, C the cosine coefficients of what comes out, I the
integrals of cosines over circles, K the kernels of step 2. All is a matrix of twice the frequencies
by the samples; of its parts I alone depends on the speed of sound, C and m alone on the time of the
first sample. A last row gives ∫ g dr.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.size_ladder import rung
from ..records.pressure import cosine_coefficients, integrals_of_cosines, samples_from_zero
from ..special import both_kinds
from ..steps.quadrature import radial_quadrature, trapezoid_weights


class Pressure(eqx.Module):
    """Conditioning and conversion of a pressure record, before it is transformed.

    Attributes:
        cosines: C, or C F m, (waves, samples).
        filtered: F, by the sample that goes in, (samples, samples); None with C F m.
        mute: m, 0 to 1, (samples,); likewise.
        times: of the record [time].
        model: "2d" or "in-plane".
    """

    cosines: Float[Array, "waves samples"]
    filtered: Float[Array, "samples samples"] | None
    mute: Float[Array, " samples"] | None
    times: Float[Array, " samples"]
    model: str = eqx.field(static=True)

    def multiplied(self) -> "Pressure":
        """The same with C F m, which takes long once, and less for each speed of sound."""
        assert self.filtered is not None and self.mute is not None
        cosines = self.cosines @ self.filtered.T * self.mute
        return Pressure(cosines, None, None, self.times, self.model)


def pressure_of(
    times: Float[Array, " samples"],
    model: str,
    filtered: Float[Array, "samples samples"],
    mute: Float[Array, " samples"],
) -> Pressure:
    """A `Pressure` of these times, of as many waves as for a start some samples earlier or later.

    Args:
        times, model, filtered, mute: its attributes.
    """
    n_waves = samples_from_zero(times)
    m = jnp.arange(rung(n_waves))
    cosines = jax.jit(cosine_coefficients)(m, times, times[-1], n_waves)
    return Pressure(cosines, filtered, mute, times, model)


def record_end(pressure: Pressure | None, sound_speed: float) -> float | None:
    """The largest radius that a record holds [length]; None for circular integrals."""
    return None if pressure is None else sound_speed * float(pressure.times[-1])


@eqx.filter_jit
def integrals_to_waves(
    radii: Float[Array, " radii"],
    frequencies: Float[Array, " frequencies"],
    equispaced: bool,
) -> Float[Array, "rows radii"]:
    """K of the formula above, (G_J, G_Y) at each frequency in turn, and ∫ g dr.

    Args:
        radii: r [length].
        frequencies: lambda [rad/length].
        equispaced: whether the radii are, for which no products are needed.
    """
    nodes, weights = radii, trapezoid_weights(radii)
    if not equispaced:
        nodes, weights = radial_quadrature(radii)
    kernels = jnp.stack(both_kinds(0, frequencies[:, None] * nodes), axis=1)
    rows = jnp.concatenate([kernels.reshape(-1, nodes.shape[0]), jnp.ones_like(nodes)[None]])
    return rows * weights if equispaced else rows @ weights


@eqx.filter_jit
def samples_to_waves(
    kernels: Float[Array, "rows radii"],
    pressure: Pressure,
    radii: Float[Array, " radii"],
    sound_speed: Float[Array, ""],
) -> Float[Array, "rows samples"]:
    """K I C F m of the formula above, in the precision of K.

    Args:
        kernels: K of `integrals_to_waves`.
        pressure: of the record.
        radii: r [length].
        sound_speed: c [length/time].
    """
    m, dtype = jnp.arange(pressure.cosines.shape[0]), kernels.dtype
    integrals = integrals_of_cosines(m, pressure.times[-1], radii, sound_speed, pressure.model)
    # from the left: there are fewer rows than waves or samples
    waves = kernels @ integrals.astype(dtype) @ pressure.cosines.astype(dtype)
    if pressure.filtered is None or pressure.mute is None:
        return waves
    return waves @ pressure.filtered.astype(dtype).T * pressure.mute.astype(dtype)
