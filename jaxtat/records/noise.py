"""The noise of a record, from its quiet part, and how it propagates to the data.

Before the first wave arrives a record holds noise alone: its standard deviation in every detector,
and its spectrum S. Any linear data Σ_t b_t p_t of one detector then have the variance

    sigma² ∫ |B(v)|² S(v) dv,   B(v) = Σ_t b_t exp(-2πi v t),   v in cycles per sample,

S of mean 1. Circular integrals integrate the record: their noise is not white even if that of the
record is, low frequencies have much more of it. What the reconstruction needs is the variance of
G_J and G_Y at each frequency, and that follows exactly, with b the rows of the map p -> G.
"""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_positive
from ..base.rows import map_rows
from ..geometry import DetectorCurve
from ..regularization import NoiseLevel
from ..special import root
from ..steps.radial_transforms import noise_power, radial_kernels
from .pressure import pressure_to_circular_integrals, require_equispaced

LEAST_SAMPLES = 16  # of a quiet part
_PERIODOGRAMS = 64  # over which a spectrum is averaged, if there are as many
_AT_A_TIME = 64  # rows of the map p -> G


class RecordNoise(eqx.Module):
    """Stationary noise, independent from detector to detector, of the same colour in all.

    Attributes:
        sigma: standard deviation in each detector, (detectors,) [unit of the record].
        spectrum: S at equispaced frequencies from 0 to half the sampling rate, of mean 1; a single
            1 is white noise.
    """

    sigma: Float[Array, " detectors"]
    spectrum: Float[Array, " frequencies"]

    def variance(self, rows: Float[Array, "*rows times"]) -> Float[Array, "*rows"]:
        """Variance of Σ_t b_t p_t for noise of sigma = 1: ∫ |B|² S dv, for each row b."""
        padded = 2 * rows.shape[-1]
        power = jnp.abs(jnp.fft.rfft(rows, padded)) ** 2
        cycles = jnp.linspace(0.0, 1.0, power.shape[-1])
        nodes = jnp.linspace(0.0, 1.0, self.spectrum.shape[0])
        sides = jnp.full(power.shape[-1], 2.0).at[jnp.array([0, -1])].set(1.0)
        return power @ (sides * jnp.interp(cycles, nodes, self.spectrum)) / padded

    def sample(self, key: Array, n_times: int) -> Float[Array, "detectors times"]:
        """A record of such noise, normally distributed.

        >>> noise = RecordNoise(jnp.array([3.0]), jnp.array([0.0, 2.0]))
        >>> drawn = noise.sample(jax.random.key(0), 4000)
        >>> abs(float(drawn.std()) - 3) < 0.1
        True
        """
        return _sample(self, key, n_times)


@partial(jax.jit, static_argnames="n_times")
def _sample(noise: RecordNoise, key: Array, n_times: int) -> Float[Array, "detectors times"]:
    white = jax.random.normal(key, (noise.sigma.shape[0], n_times))
    spectrum = jnp.fft.rfft(white)
    cycles = jnp.linspace(0.0, 1.0, spectrum.shape[-1])
    nodes = jnp.linspace(0.0, 1.0, noise.spectrum.shape[0])
    coloured = spectrum * root(jnp.interp(cycles, nodes, noise.spectrum))
    return noise.sigma[:, None] * jnp.fft.irfft(coloured, n_times)


def noise_of_record(
    pressure: Numbers, times: Numbers, *, until: Numbers, dead_time: Numbers = 0.0
) -> RecordNoise:
    """Standard deviations and spectrum of the noise, from samples dead_time <= t < until.

    Periodograms with Hann's window: those of one detector give its standard deviation, their
    median over detectors the spectrum, so that single bad detectors do not colour it. Waves
    with less than two periods in the quiet part cannot be distinguished from an offset: they are
    taken to be as strong as the next faster ones.

    Args:
        pressure: (..., detectors, times); frames are averaged. As recorded is best, since a
            filter that is applied afterwards is known exactly; filtered is possible.
        times: equispaced, concrete, (times,) [time].
        until: end of the quiet part, concrete: `first_arrival` [time].
        dead_time: its start, after the laser's artefact, concrete [time].

    Returns:
        RecordNoise, differentiable in the record.

    Raises:
        ValueError: for shapes that do not fit, times that are traced or not equispaced, or fewer
            than 16 quiet samples.

    Source: Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70-73.

    >>> record = 3 * np.random.default_rng(0).standard_normal((50, 400))
    >>> noise = noise_of_record(record, np.arange(400.0), until=400.0)
    >>> noise.sigma.shape, abs(float(noise.sigma.mean()) - 3) < 0.05
    ((50,), True)
    """
    times = real_array("times", times, ("times",))
    record = real_array("pressure", pressure, ("...", "detectors", times.shape[0]))
    require_equispaced(times)
    until, dead_time = real_array("until", until, ()), real_array("dead_time", dead_time, ())
    if not is_concrete(times, until, dead_time):
        raise ValueError(
            "times, until or dead_time are traced, and sizes depend on them: trace pressure only."
        )
    first, last = np.searchsorted(np.asarray(times), [float(dead_time), float(until)])
    if last - first < LEAST_SAMPLES:
        raise ValueError(
            f"{max(last - first, 0)} samples lie between dead_time = {float(dead_time):.6g} and "
            f"until = {float(until):.6g}, expected at least {LEAST_SAMPLES}: the record has no "
            "quiet part, or times are in another unit. Give the noise as RecordNoise(sigma, [1])."
        )
    return _of_quiet(record.reshape(-1, *record.shape[-2:])[..., first:last])


def record_noise_level(
    noise: RecordNoise,
    curve: DetectorCurve,
    times: Numbers,
    radii: Numbers,
    frequencies: Numbers,
    *,
    sound_speed: Numbers = 1.0,
    model: str = "2d",
    conditioning: Callable[[Array], Array] | None = None,
) -> NoiseLevel:
    """The `NoiseLevel` of `solve` for the noise of a record.

        sigma_g(lambda)² = mean_k(w_k sigma_k²) V(lambda) / p(lambda),

    V the mean variance of G_J and G_Y for unit noise in the record, p the mean square of √w (G_J,
    G_Y) for unit white noise in g: as much as white noise in g would have to be at that frequency.

    Args:
        noise: of the record, by `noise_of_record`; sigma for every detector of the curve, or one.
        curve: the detectors.
        times, radii, sound_speed, model: as in `pressure_to_circular_integrals`.
        frequencies: lambda of the reconstruction, ``setup.frequencies`` [rad/length].
        conditioning: what is done to the record between noise and circular integrals: a linear map
            (..., detectors, times) to the same, alike for all detectors; for instance
            ``partial(condition_record, times=times, band=band, baseline=False)``.

    Returns:
        NoiseLevel with one sigma per frequency [unit of g], differentiable.

    Raises:
        ValueError: for shapes that do not fit, noise of zero, and as
            `pressure_to_circular_integrals`.

    Source: propagation of variance; e.g. Papoulis, Probability, Random Variables, and Stochastic
    Processes (1991), section 10-2.

    >>> from jaxtat import circular_arc
    >>> curve, times = circular_arc(1.3, 1.0, 20), np.linspace(0, 3, 301)
    >>> radii = np.linspace(1, 2, 51)
    >>> noise = RecordNoise(jnp.ones(1), jnp.ones(1))
    >>> level = record_noise_level(noise, curve, times, radii, [2.0, 20.0], model="in-plane")
    >>> bool(level.sigma[0] > 5 * level.sigma[1])  # integration: slow noise grows
    True
    """
    radii = real_array("radii", radii, ("radii",))
    frequencies = real_array("frequencies", frequencies, ("frequencies",))
    times = real_array("times", times, ("times",))
    sound_speed = real_array("sound_speed", sound_speed, ())
    require_positive("frequencies", frequencies)
    if noise.sigma.shape[0] not in (1, curve.n_detectors):
        raise ValueError(
            f"noise.sigma has shape {noise.sigma.shape}, expected ({curve.n_detectors},), one for "
            "each detector of the curve, or (1,): leave the same detectors out of both."
        )
    if is_concrete(noise) and not np.asarray(noise.sigma).max() > 0:
        raise ValueError("the noise is zero: give alpha as a number, 1e-6 or less.")

    def to_g(record: Array) -> Array:
        ready = record if conditioning is None else conditioning(record)
        return pressure_to_circular_integrals(
            ready, times, radii, sound_speed=sound_speed, model=model
        )

    kernels = radial_kernels(radii, frequencies).reshape(-1, 1, radii.shape[0])
    record = jax.ShapeDtypeStruct((kernels.shape[0], 1, times.shape[0]), kernels.dtype)
    (rows,) = jax.linear_transpose(to_g, record)(kernels)
    of_white = noise_power(radii, frequencies, curve.weights)
    return NoiseLevel(_equivalent(noise, curve.weights, rows[:, 0], of_white))


@jax.jit
def _equivalent(noise: RecordNoise, weights: Array, rows: Array, of_white: Array) -> Array:
    variance = map_rows(noise.variance, rows, _AT_A_TIME)
    of_noise = jnp.mean(weights * noise.sigma**2) * jnp.mean(variance.reshape(-1, 2), axis=1)
    return jnp.sqrt(of_noise / of_white)


@jax.jit
def _of_quiet(record: Float[Array, "frames detectors quiet"]) -> RecordNoise:
    frames, detectors, n = record.shape
    wanted = -(-_PERIODOGRAMS // (frames * detectors))
    size = max(LEAST_SAMPLES, n // max(1, wanted // 2))  # half overlapping
    starts = np.arange(0, n - size + 1, max(1, size // 2))
    pieces = jnp.stack([record[..., s : s + size] for s in starts], axis=-2)
    pieces = pieces - jnp.mean(pieces, axis=-1, keepdims=True)
    window = jnp.asarray(np.hanning(size + 1)[:-1])
    power = jnp.abs(jnp.fft.rfft(pieces * window)) ** 2 / jnp.sum(window**2)
    power = _inner(power)
    of_detector = jnp.mean(power, axis=(0, 2, 3))
    some = of_detector > 0
    scaled = power / jnp.where(some, of_detector, 1.0)[:, None, None]
    spectrum = jnp.median(scaled, axis=(0, 1, 2))
    total = jnp.mean(spectrum)
    spectrum = jnp.where(total > 0, spectrum / jnp.where(total > 0, total, 1.0), 1.0)
    return RecordNoise(root(of_detector), spectrum)


def _inner(power: Float[Array, "*n frequencies"]) -> Float[Array, "*n frequencies"]:
    """A spectrum whose ends, which are distorted, are replaced by the values beside them."""
    n = power.shape[-1]
    return power[..., np.clip(np.arange(n), 2, n - 2)]
