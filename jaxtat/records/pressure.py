"""From pressure records to circular integrals, and the conditioning of raw records.

A record p(z_k, t) starts from p(., 0) = f, dp/dt(., 0) = 0, and is even in time. Sampled finely
enough, it is the cosine series p(t) = Σ_m a_m cos(omega_m t), omega_m = m π/T, of its samples on
[0, T]. Both acoustic models are integrals over the travelled path tau = c t up to tau = r, and
those of a cosine are known:

    2-D waves:        g(z, r) = 4 r ∫_0^{π/2} p(z, r sin a / c) da = 2π r Σ_m a_m J_0(omega_m r/c),
    in-plane focused: g(z, r) = r ∫_0^r p(z, tau/c) dtau = r Σ_m a_m (c/omega_m) sin(omega_m r/c).

So each is a matrix (radii, times) that does not depend on the record, exact for band-limited ones,
with all derivatives with respect to radii and sound speed.
"""

from functools import partial
from numbers import Real
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Num

from ..base.checks import (
    Numbers,
    by_library,
    is_concrete,
    real_array,
    require_positive,
    whole_number,
)
from ..base.option_values import MODELS
from ..base.size_ladder import filled_up, rung
from ..special import j0

_WAVES_AT_A_TIME = 256
_FEWEST_MUTED = 4  # samples alike at the start
_AT_ONCE = 0.7  # of the rows, of which a muted start ends with one sample
_FEW = 8  # radii that may lie within one sample


def pressure_to_circular_integrals(
    pressure: Numbers,
    times: Numbers,
    radii: Numbers,
    *,
    sound_speed: Numbers = 1.0,
    model: str = "2d",
    max_frequency: float = np.inf,
) -> Float[Array, "*batch detectors radii"]:
    """g(z, r) from pressure records p(z, t).

    ``model="2d"`` is exact for two-dimensional waves (integrating line detectors, simulations in
    the plane): g = 4 r ∫_0^r p / √(r² - tau²) dtau. ``model="in-plane"`` is for point-like
    detectors focused into a thin slab (ring and arc arrays): g = r ∫_0^r p dtau, up to one
    constant that the slab's thickness and the detectors' gain decide. A record counts as zero
    before its first sample, and before time 0.

    Args:
        pressure: (..., detectors, times), any unit.
        times: equispaced, 0 when the laser fires, concrete, (times,) [time].
        radii: r > 0, (radii,) [length].
        sound_speed: c [length/time], traced.
        model: "2d" or "in-plane".
        max_frequency: of the waves that count; all by default, fewer cost less [rad/time].

    Returns:
        (..., detectors, radii) [unit of pressure times length, in-plane: times length²].

    Raises:
        ValueError: for shapes that do not fit, times that are not equispaced, NaN, an unknown
            model, a frequency that is not positive, or radii beyond the end of the record.

    Source: 2-D: Abel transform of the solution of the wave equation, e.g. Burgholzer et al.,
    Inverse Problems 23 (2007) S65-S80; in-plane: spherical means restricted to a thin slab.

    >>> times = jnp.linspace(0.0, 3.0, 301)
    >>> p = jnp.ones((1, 301))  # f = 1 everywhere stays 1, and g is the circumference
    >>> g = pressure_to_circular_integrals(p, times, jnp.array([1.0]))
    >>> abs(float(g[0, 0]) - 2 * np.pi) < 1e-6
    True
    """
    times = real_array("times", times, ("times",))
    radii = real_array("radii", radii, ("radii",))
    pressure = real_array("pressure", pressure, ("...", "detectors", times.shape[0]))
    sound_speed = real_array("sound_speed", sound_speed, ())
    require_positive("sound_speed", sound_speed)
    require_positive("radii", radii)
    if model not in MODELS:
        raise ValueError(f"model is {model!r}, expected '2d' or 'in-plane'.")
    if not (isinstance(max_frequency, Real) and max_frequency > 0):
        raise ValueError(f"max_frequency is {max_frequency!r}, expected a number above zero.")
    _require_record(times, radii, sound_speed)
    n_waves = samples_from_zero(times)
    if np.isfinite(max_frequency):
        n_waves = min(n_waves, int(max_frequency * float(np.asarray(times)[-1]) / np.pi) + 2)
    if not is_concrete(pressure, times, radii, sound_speed):
        where = times, times[-1], radii, sound_speed, jnp.asarray(n_waves)
        return _convert(pressure, *where, model, _blocks(n_waves))
    return _converted(pressure, times, radii, sound_speed, model, n_waves)


def condition_record(
    pressure: Numbers,
    times: Numbers,
    *,
    dead_time: Numbers = 0.0,
    band: tuple[Numbers, Numbers] | None = None,
    order: int = 3,
    baseline: bool = True,
) -> Float[Array, "*batch detectors times"]:
    """Condition a raw record: set its start to zero, remove offset and drift, limit the band.

    Samples before ``dead_time`` (the laser's electrical artefact) are faded out over as long again
    as the dead time, capped at a tenth of the record. Offset and drift of each detector, a straight
    line through the medians of its first and last third, are subtracted. A zero-phase Butterworth
    band-pass |H| = 1/√((1 + (f_lo/f)^2n)(1 + (f/f_hi)^2n)) removes noise and slow drift; the ends
    are tapered so that it does not ring there.

    Args:
        pressure: raw counts or pascals, (..., detectors, times).
        times: equispaced, (times,) [time].
        dead_time: after time 0, when the laser fires; 0 silences nothing [time].
        band: (f_lo, f_hi) [cycles/time], or None for none; f_lo may be 0.
        order: n >= 1.
        baseline: whether to subtract offset and drift; not for records whose slow tail is signal,
            such as simulated 2-D waves.

    Returns:
        (..., detectors, times), differentiable in the record, dead_time and band, with two
        exceptions of the function itself. A median has a kink where samples are equal, as in counts
        and silence: there its derivative is the mean over the equal ones, exact for changes that
        all of them share. And the first samples are silenced at once when dead_time leaves 0: there
        its derivative is 0.

    Raises:
        ValueError: for shapes that do not fit, times that are not equispaced, or an empty band.

    >>> times = np.arange(400) / 40e6
    >>> wave = np.sin(2 * np.pi * 2e6 * times)
    >>> clean = np.asarray(condition_record(512 + wave[None], times, band=(0.1e6, 8e6)))
    >>> bool(np.abs(clean[0] - wave)[100:300].max() < 0.05)
    True
    """
    times = real_array("times", times, ("times",))
    pressure = real_array("pressure", pressure, ("...", "detectors", times.shape[0]))
    require_equispaced(times)
    dead_time = real_array("dead_time", dead_time, ())
    order = whole_number("order", order, 1)
    limits = None
    if band is not None:
        limits = (real_array("band[0]", band[0], ()), real_array("band[1]", band[1], ()))
    _require_units(times, dead_time, limits)
    return by_library(_condition, (pressure, times, dead_time, limits), order, baseline)


def _condition(
    xp: Any,
    pressure: Any,
    times: Any,
    dead_time: Any,
    band: tuple[Any, Any] | None,
    order: int,
    baseline: bool,
) -> Any:
    if baseline:
        pressure = pressure - baseline_of(xp, pressure)
    duration = times[-1] - times[0]
    since = times - times[0]
    fade = xp.clip(dead_time, 2 * (times[1] - times[0]), duration / 10)
    begun = pressure * xp.where(dead_time > 0, _rise(xp, (times - dead_time) / fade), 1.0)
    if band is None:
        return begun
    tapered = begun * _rise(xp, (duration - since) / (duration / 20))
    return _band_pass(xp, tapered, times[1] - times[0], *band, order)


def _converted(
    pressure: Array, times: Array, radii: Array, sound_speed: Array, model: str, n_waves: int
) -> Array:
    """`_convert` by the matrix of the next sizes on the ladder, of any number of records."""
    n_radii, n_times = radii.shape[0], times.shape[0]
    known = np.asarray(times)
    more = np.arange(1, rung(n_times) - n_times + 1) * (known[1] - known[0])
    matrix = _integrals(
        np.concatenate([known, known[-1] + more]),
        known[-1],
        filled_up(radii, (rung(n_radii),), by="last"),
        sound_speed,
        np.asarray(n_waves),
        model,
        _blocks(rung(n_waves)),
        None,
    )
    return jax.device_put(np.asarray(pressure) @ np.asarray(matrix)[:n_radii, :n_times].T)


def _blocks(n_waves: int) -> int:
    return -(-n_waves // _WAVES_AT_A_TIME)


@partial(jax.jit, static_argnames=("model", "n_blocks"))
def _convert(
    pressure: Array,
    times: Array,
    end: Array,
    radii: Array,
    sound_speed: Array,
    n_waves: Array,
    model: str,
    n_blocks: int,
) -> Array:
    records = pressure.reshape(-1, pressure.shape[-1])
    n_times, n_radii = times.shape[0], radii.shape[0]
    series = partial(_integrals, times, end, radii, sound_speed, n_waves, model, n_blocks)
    if records.shape[0] * (n_times + n_radii) < n_times * n_radii:
        integrals = series(records.T)
    else:  # the matrix of all records costs less
        integrals = series(None) @ records.T
    return integrals.T.reshape(*pressure.shape[:-1], n_radii)


@partial(jax.jit, static_argnames=("model", "n_blocks"))
def _integrals(
    times: Array,
    end: Array,
    radii: Array,
    sound_speed: Array,
    n_waves: Array,
    model: str,
    n_blocks: int,
    records: Float[Array, "times records"] | None,
) -> Float[Array, "radii records"]:
    """W p: cosine coefficients of the record, then the integral of each cosine; None gives W."""

    def add(total: Array, m: Array) -> tuple[Array, None]:
        to_coefficients = cosine_coefficients(m, times, end, n_waves)
        integrals = integrals_of_cosines(m, end, radii, sound_speed, model)
        coefficients = to_coefficients if records is None else to_coefficients @ records
        return total + integrals @ coefficients, None

    # a block of waves at a time: all at once would take memory with the square of the samples
    blocks = jnp.arange(n_blocks * _WAVES_AT_A_TIME).reshape(-1, _WAVES_AT_A_TIME)
    start = jnp.zeros((radii.shape[0], times.shape[0] if records is None else records.shape[1]))
    return jax.lax.scan(jax.checkpoint(add), start, blocks)[0]


def cosine_coefficients(
    m: Int[Array, " waves"],
    times: Float[Array, " times"],
    end: Float[Array, ""],
    n_waves: int | Int[Array, ""],
) -> Float[Array, "waves times"]:
    """From a record to a_m, by the trapezoid rule on [0, T]; before 0 or a late start it is zero.

    Args:
        m: from 0; those from ``n_waves`` on count nothing.
        times: of the record, equispaced; those after T count nothing [time].
        end: T [time].
        n_waves: of `samples_from_zero`.
    """
    step = times[1] - times[0]
    halved = (jnp.abs(times) < step / 2) | (times == end)
    outside = (times <= -step / 2) | (times > end)
    counted = jnp.where(outside, 0.0, jnp.where(halved, 0.5, 1.0))
    weights = counted * (2 * step / end)
    ends = (m == 0) | (m == n_waves - 1)
    share = jnp.where(m < n_waves, jnp.where(ends, 0.5, 1.0), 0.0)
    return jnp.cos(jnp.pi / end * m[:, None] * times) * weights * share[:, None]


def integrals_of_cosines(
    m: Int[Array, " waves"],
    end: Float[Array, ""],
    radii: Float[Array, " radii"],
    sound_speed: Float[Array, ""],
    model: str,
) -> Float[Array, "radii waves"]:
    """g(r) of the records cos(m π t / T)."""
    argument = jnp.pi / end * m * radii[:, None] / sound_speed
    if model == "2d":
        return 2 * jnp.pi * radii[:, None] * j0(argument)
    return radii[:, None] ** 2 * jnp.sinc(argument / jnp.pi)


def samples_from_zero(times: Array) -> int:
    """How many samples [0, T] would have, whenever the record starts: one cosine for each."""
    if not is_concrete(times):
        raise ValueError("times are traced, expected concrete ones: trace sound_speed instead.")
    values = np.asarray(times)
    return round(float(values[-1] / (values[1] - values[0]))) + 1


def baseline_of(xp: Any, pressure: Any) -> Any:
    """Straight lines through the medians of the first and last third, which pulses do not move."""
    third = pressure.shape[-1] // 3
    median = _median if xp is jnp else partial(np.median, axis=-1, keepdims=True)
    first, last = median(pressure[..., :third]), median(pressure[..., -third:])
    return first + (last - first) * along_baseline(pressure.shape[-1])


def without_mute(record: Num[np.ndarray, "*batch times"]) -> Num[np.ndarray, "*batch times"]:
    """A record with offset and drift of each detector where its start is muted.

    Until they listen, scanners write zeros or the middle of their range. The step from there to the
    offset is no sound, but rings in a band-pass and tilts baselines. It comes at once in all rows:
    silence before sound arrives does not end so.

    >>> record = np.array([[7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0]])
    >>> muted = np.where(np.arange(10) < 4, 0.0, record)
    >>> bool(np.allclose(without_mute(muted), record))
    True
    """
    # live images come here with every frame, and most are told by their first samples
    begun = np.any(record[..., 1:_FEWEST_MUTED] != record[..., :1], axis=-1)
    if np.mean(begun) > 0.5:
        return record
    ends = np.argmax(record != record[..., :1], axis=-1)
    ends = ends[ends > 0]  # rows of one value throughout tell nothing
    n = int(np.median(ends)) if ends.size else 0
    if n < _FEWEST_MUTED or np.mean(np.abs(ends - n) <= 1) < _AT_ONCE:
        return record
    line = baseline_of(np, record[..., n:])
    before = line[..., :1] + (line[..., 1:2] - line[..., :1]) * np.arange(-n, 0)
    return np.concatenate([before, record[..., n:]], axis=-1)


def along_baseline(n: int) -> Float[np.ndarray, " n"]:
    """0 and 1 in the middle of the first and the last third of n samples."""
    third = n // 3
    return (np.arange(n) - (third - 1) / 2) / (n - third)


def _median(values: Float[Array, "*batch n"]) -> Float[Array, "*batch 1"]:
    """Median over the last axis, as a mean of the samples equal to it: they share the slope."""
    ranked, n = jnp.sort(jax.lax.stop_gradient(values), axis=-1), values.shape[-1]

    def of_rank(k: int) -> Array:
        rank = ranked[..., k : k + 1]
        equal = values == rank
        excess = jnp.where(equal, values - rank, 0.0)  # 0, but for its derivative
        return rank + jnp.sum(excess, axis=-1, keepdims=True) / equal.sum(axis=-1, keepdims=True)

    return (of_rank((n - 1) // 2) + of_rank(n // 2)) / 2


def _rise(xp: Any, t: Any) -> Any:
    """0 below 0, 1 above 1, half a cosine between."""
    return 0.5 - 0.5 * xp.cos(np.pi * xp.clip(t, 0.0, 1.0))


def _band_pass(xp: Any, record: Any, step: Any, low: Any, high: Any, order: int) -> Any:
    n = record.shape[-1]
    padded = 2 * n  # room for the filter's response, so that the ends do not meet
    frequency = xp.fft.rfftfreq(padded) / step
    ratio = frequency / high
    safe = xp.where(frequency > 0, frequency, 1.0)
    response = 1 / (1 + ratio ** (2 * order)) / (1 + (low / safe) ** (2 * order))
    gain = xp.where((frequency > 0) | (low == 0), xp.sqrt(response), 0.0)
    return xp.fft.irfft(xp.fft.rfft(record, padded) * gain, padded)[..., :n]


def require_equispaced(times: Array) -> None:
    """Raise ValueError unless concrete times have equal steps and end after 0."""
    if times.shape[0] < 8:
        raise ValueError(f"got {times.shape[0]} time samples, expected at least 8.")
    if not is_concrete(times):
        return
    values = np.asarray(times)  # stays concrete inside jax.jit too
    steps = np.diff(values)
    if not (steps > 0).all() or np.ptp(steps) > 1e-3 * steps.mean():
        raise ValueError(
            f"times have steps from {steps.min():.6g} to {steps.max():.6g}, expected equal "
            "positive steps: resample the record."
        )
    if values[-1] <= 0:
        raise ValueError(
            f"times end at {values[-1]:.6g}, expected samples after t = 0, when the laser fires."
        )


def _require_units(times: Array, dead_time: Array, band: tuple[Array, Array] | None) -> None:
    """Dead time and band must make sense for these times: seconds with hertz, or µs with MHz."""
    if not is_concrete(times, dead_time, band):
        return
    values = np.asarray(times)
    duration, step = values[-1] - values[0], values[1] - values[0]
    if not 0 <= float(dead_time) < values[-1]:
        raise ValueError(
            f"dead_time is {float(dead_time):.6g}, expected 0 to the record's {values[-1]:.6g}, in "
            "the same unit as times."
        )
    if band is None:
        return
    low, high = float(band[0]), float(band[1])
    if not (0 <= low < high and low < 0.5 / step and high > 1 / duration):
        raise ValueError(
            f"band is ({low:.6g}, {high:.6g}), expected 0 <= f_lo < f_hi within "
            f"{1 / duration:.6g} to {0.5 / step:.6g}, in cycles per unit of times."
        )


def _require_record(times: Array, radii: Array, sound_speed: Array) -> None:
    require_equispaced(times)
    if not is_concrete(times, radii, sound_speed):
        return
    end = float(np.asarray(times)[-1]) * float(sound_speed)
    wanted = float(np.asarray(radii).max())
    if wanted > end * (1 + 1e-9):
        raise ValueError(
            f"radii reach {wanted:.6g}, but with sound speed {float(sound_speed):.6g} the record "
            f"ends at {end:.6g}: use smaller radii or a longer record, and check the units."
        )
    values = np.asarray(times)
    step, spread = float(values[1] - values[0]) * float(sound_speed), float(np.ptp(radii))
    if len(radii) > _FEW and spread < step:
        raise ValueError(
            f"{len(radii)} radii lie within {spread:.6g}, but with sound speed "
            f"{float(sound_speed):.6g} a sample is {step:.6g}: check the units of times and radii."
        )
