"""The largest region and the finest detail that a record and its detectors permit.

- A source x is in the record of detector z from |x - z|/c on. All circles about all detectors that
  meet the region must have been recorded.
- Along the curve, a wave of frequency lambda from x turns by lambda |t·(z - x)|/|z - x| radians per
  length, t the tangent in z; on a circle R_g around a disk R by at most lambda R/R_g. Detectors a
  step s apart tell waves apart up to half a turn from one to the next: lambda s |t·e| <= π, that is
  lambda <= π R_g/(R s). Beyond, waves from opposite rims of the region are alike to the detectors.
- Samples dt apart hold waves up to lambda = π/(c dt).

The smallest detail at lambda is half a wave, π/lambda, which is also the pixel that samples it.
"""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_positive
from ..base.units import Units
from ..geometry import DetectorCurve, Region
from ..geometry.measured_curves import behind_gap
from .pressure import require_equispaced

_BESIDE = 4  # detectors to either side, over which spacing is averaged
_EDGE = 0.98  # of the distance to the nearest detector: cylindrical waves need every one outside


class Supported(eqx.Module):
    """Requested and possible region radius and highest frequency.

    Attributes:
        reach: radius of the region about its centre, as requested [length].
        end: c times end of the record [length].
        reach_of_end: the largest that the end of the record allows [length].
        reach_of_start: the largest that its start, or the nearest detector, allows [length].
        covered: c times end of the record, less the farthest point of the region; below zero the
            record is too short for it [length].
        free: the nearest point of the region, less c times start of the record; below zero the
            record starts too late for it [length].
        requested_frequency: lambda_max that was requested; infinite if none was [rad/length].
        frequency_of_detectors: up to which detectors sample the waves of the region [rad/length].
        frequency_of_times: up to which samples in time do [rad/length].
    """

    reach: Float[Array, ""]
    end: Float[Array, ""]
    reach_of_end: Float[Array, ""]
    reach_of_start: Float[Array, ""]
    covered: Float[Array, ""]
    free: Float[Array, ""]
    requested_frequency: Float[Array, ""]
    frequency_of_detectors: Float[Array, ""]
    frequency_of_times: Float[Array, ""]

    @property
    def largest_reach(self) -> Float[Array, ""]:
        """Radius of the largest disk about the region's centre that the record covers [length]."""
        return jnp.minimum(self.reach_of_end, self.reach_of_start)

    @property
    def max_frequency(self) -> Float[Array, ""]:
        """The highest possible lambda [rad/length]."""
        return jnp.minimum(self.frequency_of_detectors, self.frequency_of_times)

    @property
    def smallest_detail(self) -> Float[Array, ""]:
        """Half the shortest wave, π/lambda_max; the pixel size that goes with it [length]."""
        return jnp.pi / self.max_frequency

    @property
    def ends_early(self) -> bool:
        """Whether the record ends before sound from the far side of the region arrives."""
        return float(self.covered) < -1e-9 * float(self.reach)

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """What is not possible, each in a sentence with numbers; empty if everything is."""
        requested, detail = float(self.reach), np.pi / float(self.requested_frequency)
        sentences = []
        if self.ends_early:
            sentences.append(
                f"the record ends {-float(self.covered):.4g} before the far side of the region: a "
                f"region of radius {requested:.4g} was requested, {_up_to(self.reach_of_end)}"
            )
        if float(self.free) < -1e-9 * requested:
            sentences.append(
                f"the record starts {-float(self.free):.4g} after the near side of the region: a "
                f"region of radius {requested:.4g} was requested, {_up_to(self.reach_of_start)}"
            )
        for name, limit, remedy in (
            ("detectors are too few", self.frequency_of_detectors, "more detectors"),
            ("samples are too slow", self.frequency_of_times, "a higher sampling rate"),
        ):
            if np.isfinite(detail) and detail and float(limit) < float(self.requested_frequency):
                sentences.append(
                    f"{name}: details of {detail:.4g} (lambda "
                    f"{float(self.requested_frequency):.4g}) were requested, "
                    f"{np.pi / float(limit):.4g} (lambda {float(limit):.4g}) are possible without "
                    f"{remedy}"
                )
        return tuple(sentences)

    def __str__(self) -> str:
        return self.in_words(Units())

    def in_words(self, units: Units) -> str:
        """The shortfalls, or else what is possible, with units of length where they are known."""
        reach, largest, detail = (
            units.of_length(float(x))
            for x in (self.reach, self.largest_reach, self.smallest_detail)
        )
        return "; ".join(self.shortfalls) or (
            f"region of radius {reach} of at most {largest}, details down to {detail} in all of it"
        )


def supported(
    curve: DetectorCurve,
    region: Region,
    times: Numbers,
    *,
    sound_speed: Numbers = 1.0,
    dead_time: Numbers = 0.0,
    max_frequency: Numbers | None = None,
) -> Supported:
    """Region radius and lambda_max that record and detectors permit, and those requested.

    With z_k the detectors and x_c the region's centre, the largest disk about x_c has the radius
    min(c t_end - max|z_k - x_c|, min|z_k - x_c| - c t_start), and stays clear of the detectors.
    The highest lambda is π/(c dt) or, if that is less, what nine in ten detectors sample of waves
    from the region: lambda max_x |t_k·(z_k - x)|/|z_k - x| s_k <= π, s_k the mean step to the
    detectors beside it, since they make up for a single missing one. Sources outside the region
    reach the detectors too: pass the region that holds them to see whether their waves are
    sampled.

    Args:
        curve, region: the geometry.
        times: of the record, equispaced, (times,) [time].
        sound_speed: c [length/time].
        dead_time: at the start of the record, useless [time].
        max_frequency: lambda_max that is wanted, if any [rad/length].

    Returns:
        Supported, differentiable in positions, region and sound speed.

    Raises:
        ValueError: for times that are not equispaced, or numbers that are not positive.

    Source: Nyquist's criterion along the curve; for circles e.g. Haltmeier, SIAM J. Imaging Sci. 9
    (2016) 1097-1122.

    >>> from jaxtat import circular_arc, disk
    >>> curve, region = circular_arc(1.3, 1.0, 500), disk(1.0, n_boundary=200)
    >>> possible = supported(curve, region, jnp.linspace(0.0, 2.0, 401), max_frequency=200.0)
    >>> for sentence in possible.shortfalls:
    ...     print(sentence)
    the record ends 0.3 before the far side of the region: a region of radius 1 was requested, up \
to 0.7 is possible
    """
    times = real_array("times", times, ("times",))
    require_equispaced(times)
    sound_speed = real_array("sound_speed", sound_speed, ())
    require_positive("sound_speed", sound_speed)
    dead_time = real_array("dead_time", dead_time, ())
    requested = jax.device_put(np.inf)
    if max_frequency is not None:
        requested = real_array("max_frequency", max_frequency, ())
        require_positive("max_frequency", requested)
    given = curve, region, times, sound_speed, dead_time, requested
    if not is_concrete(given):
        return Supported(*_traced(*given))
    with jax.ensure_compile_time_eval():  # no program for each number of detectors
        return Supported(*jax.device_put(_supported(np, *given)))


def first_arrival(
    curve: DetectorCurve, region: Region, *, sound_speed: Numbers = 1.0
) -> Float[Array, ""]:
    """When the first wave from the region reaches a detector: min |z_k - x| / c [time].

    What was recorded before is noise, if all sources lie in the region.

    >>> from jaxtat import circular_arc, disk
    >>> region = disk(1.0, n_boundary=200)
    >>> round(float(first_arrival(circular_arc(1.3, 1.0, 100), region)), 3)
    0.3
    """
    sound_speed = real_array("sound_speed", sound_speed, ())
    require_positive("sound_speed", sound_speed)
    return _first_arrival(curve, region, sound_speed)


def _up_to(reach: Array) -> str:
    if float(reach) <= 0:
        return "none about its centre is possible"
    return f"up to {float(reach):.4g} is possible"


@eqx.filter_jit
def _first_arrival(curve: DetectorCurve, region: Region, sound_speed: Array) -> Array:
    return jnp.min(_lengths(curve.points[:, None] - region.points)) / sound_speed


def _supported(
    xp: Any,
    curve: DetectorCurve,
    region: Region,
    times: Any,
    sound_speed: Any,
    dead_time: Any,
    requested: Any,
) -> tuple[Any, ...]:
    """The parts of `Supported`; xp is numpy or jax.numpy."""
    where = curve.points, region.points, region.center, region.reach
    points, boundary, center, reach = map(xp.asarray, where)
    times, sound_speed, dead_time, requested = map(
        xp.asarray, (times, sound_speed, dead_time, requested)
    )
    start = sound_speed * xp.maximum(times[0], dead_time)
    end = sound_speed * times[-1]
    lengths = _lengths(points[:, None] - boundary, xp)
    distance = _lengths(points - center, xp)
    nearest = xp.min(distance)
    return (
        reach,
        end,
        end - xp.max(distance),
        xp.minimum(nearest - start, _EDGE * nearest),
        end - xp.max(lengths),
        xp.min(lengths) - start,
        requested,
        sampled_frequency(curve, region, xp),
        np.pi / (sound_speed * (times[1] - times[0])),
    )


_traced = eqx.filter_jit(partial(_supported, jnp))


def sampled_frequency(curve: DetectorCurve, region: Region, xp: Any = jnp) -> Any:
    """lambda up to which nine in ten detectors sample waves of the region, see `supported`.

    Args:
        curve, region: the geometry.
        xp: jax.numpy, or numpy for a concrete geometry.
    """
    points, boundary, normals = map(xp.asarray, (curve.points, region.points, curve.normals))
    between = points[:, None] - boundary
    tangents = normals[:, ::-1] * np.array([-1.0, 1.0])
    along = xp.abs(xp.einsum("kd,kxd->kx", tangents, between)) / _lengths(between, xp)
    return np.pi / xp.quantile(xp.max(along, axis=1) * _spacing(points, curve.closed, xp), 0.9)


def _spacing(points: Any, closed: bool, xp: Any) -> Any:
    """Mean of the steps about each detector, four to either side, gaps in the curve apart."""
    step = _lengths(xp.roll(points, -1, axis=0) - points, xp)
    counts = ~behind_gap(step, closed, xp)
    around = np.arange(-_BESIDE, _BESIDE) + np.arange(len(points))[:, None]
    around %= len(points)
    total, n = xp.sum((counts * step)[around], axis=1), xp.sum(counts[around], axis=1)
    return total / xp.maximum(n, 1)


def _lengths(vectors: Any, xp: Any = jnp) -> Any:
    return xp.sqrt(xp.sum(vectors**2, axis=-1))
