"""Bad channels of a record, and the noise of the others.

If a detector is left out, the curve has fewer detectors, with weights that are again the arcs
around each (`keep_detectors`). Zeros in place of its record would be wrong data.
"""

from functools import partial
from math import comb
from statistics import NormalDist
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..base.checks import Numbers, by_library, is_concrete, real_array, require_positive
from ..special import root
from .pressure import require_equispaced

BLOCKS = 16  # pieces of the record, of which the quietest gives the noise
SHORTEST_BLOCK = 64  # samples: the noise of a block is then known to a seventh
SATURATED = 0.003  # share of samples held at a level; of good ones hardly any are
FEWEST_HELD = 4  # samples: a record may meet its peak twice in a row
FEWEST_COUNTS = 64  # from lowest to highest sample: coarser signals rest wherever they are
HIDDEN = 1.0  # counts of noise, rounding included, up to which a quiet record rests by chance
CUT_OFF = 5.0  # counts by which a record leaves its limit; beside a crest it is 10/3, see `_cut`
SILENT = 1e-3  # of the typical signal: noise below it (-60 dB) is not worth a detector
RESTS = 0.02  # of a channel's range: as near to its median lies the level at which it is silent


class ChannelQuality(eqx.Module):
    """The result of `channel_quality`, for each detector.

    Attributes:
        noise: standard deviation of the noise, if it is white [unit of the record].
        signal: root mean square of the record without offset and drift [unit of the record].
        dead: no signal: constant, zero, or noise alone.
        saturated: held at one level again and again, as at the rails of a converter.
        noisy: far noisier than the others.
    """

    noise: Float[Array, " detectors"]
    signal: Float[Array, " detectors"]
    dead: Bool[Array, " detectors"]
    saturated: Bool[Array, " detectors"]
    noisy: Bool[Array, " detectors"]

    @property
    def good(self) -> Bool[Array, " detectors"]:
        """Detectors to keep."""
        masks = self.dead, self.saturated, self.noisy
        return by_library(lambda xp, *masks: ~(masks[0] | masks[1] | masks[2]), masks)

    @property
    def weights(self) -> Float[Array, " detectors"]:
        """1 for detectors to keep, 0 for others: factors of residuals, not of data."""
        return self.good.astype(float)

    def __str__(self) -> str:
        reasons = [
            f"{int(mask.sum())} {name} ({ranges(np.flatnonzero(mask))})"
            for name in ("dead", "saturated", "noisy")
            if (mask := np.asarray(getattr(self, name))).any()
        ]
        bad = "; ".join(reasons) or "all good"
        return f"{self.noise.shape[0]} detectors: {bad}"


def channel_quality(
    pressure: Numbers,
    times: Numbers,
    *,
    dead_time: Numbers = 0.0,
    dead: Numbers = 0.05,
    noisy: Numbers = 5.0,
) -> ChannelQuality:
    """Dead, saturated and noisy channels of a raw record, and every channel's noise.

    *Noise*: by fourth differences d, sigma² = mean d²/70, in the quietest of 16 pieces of the
    record, corrected for the bias of the least of 16 estimates. Fourth differences weaken waves of
    n samples' length (n/2π)⁴ times, so that little of the signal is left in them.
    *Noisy*: more than 5 times the median noise, more than rounding to counts makes, and more than a
    thousandth of the typical signal, so that exact data raise no alarm. Such a detector adds as
    much noise as 25 others.
    *Dead*: a signal below a twentieth of the upper quartile of all detectors. Different distances
    within a scanner explain a factor of about 4, no more.
    *Saturated*: held at one level, the highest, the lowest or any other, for three in a thousand
    samples and 5 times as often as the median. Silence is no such level: neither the one at which
    all channels begin, nor zero between both signs, nor, in a record without noise, a channel's
    median; signals of less than 64 counts are not judged. A record whose noise is less than a count
    rests wherever it is silent, and at its crests: there only the highest and the lowest level
    count, if more than a crest is cut off.

    Args:
        pressure: as recorded, before any filter, (..., detectors, times); frames are judged
            together.
        times: equispaced, (times,) [time].
        dead_time: before it all is left out, where a laser's artefact saturates [time].
        dead: share of the upper quartile below which a signal is none.
        noisy: multiple of the median noise.

    Returns:
        ChannelQuality; ``noise`` and ``signal`` have derivatives.

    Raises:
        ValueError: for shapes that do not fit, times that are not equispaced or traced, thresholds
            that are not positive, or fewer than 68 samples after the dead time.

    Source: differences as estimates of noise: von Neumann, Kent, Bellinson and Hart, Ann. Math.
    Statist. 12 (1941) 153-162, where the first ones are taken.

    >>> rng, times = np.random.default_rng(0), np.arange(400) / 40e6
    >>> record = 100 * np.sin(1e6 * times) + rng.standard_normal((12, 400))
    >>> record[3] = 512.0
    >>> record[7] += 20 * rng.standard_normal(400)
    >>> print(channel_quality(record, times))
    12 detectors: 1 dead (3); 1 noisy (7)
    """
    times = real_array("times", times, ("times",))
    record = real_array("pressure", pressure, ("...", "detectors", times.shape[0]))
    require_equispaced(times)
    dead, noisy = real_array("dead", dead, ()), real_array("noisy", noisy, ())
    require_positive("dead", dead)
    require_positive("noisy", noisy)
    dead_time = real_array("dead_time", dead_time, ())
    if not is_concrete(times, dead_time):
        raise ValueError("times or dead_time are traced, expected concrete ones: trace pressure.")
    first = int(np.searchsorted(np.asarray(times), float(dead_time)))
    if times.shape[0] - first < SHORTEST_BLOCK + 4:
        raise ValueError(
            f"{times.shape[0] - first} samples are left after dead_time, expected at least "
            f"{SHORTEST_BLOCK + 4}: check that dead_time and times have the same unit."
        )
    known = is_concrete(record, dead, noisy)  # which need no program for each size of record
    judged = partial(by_library, _quality) if known else _traced
    return ChannelQuality(*judged((record, dead, noisy), first))


def _quality(xp: Any, record: Any, dead: Any, noisy: Any, first: int) -> tuple[Any, ...]:
    """The parts of `ChannelQuality`; xp is numpy or jax.numpy."""
    record = record.reshape(-1, *record.shape[-2:])[..., first:]
    noise, signal = _noise(xp, record), _signal(xp, record)
    typical = xp.quantile(signal, 0.75)
    is_dead = signal <= dead * typical
    usual = _median_of(xp, noise, ~is_dead)
    count = _count(xp, record)
    loudest = xp.maximum(noisy * xp.maximum(usual, count / 12**0.5), SILENT * typical)  # rounding
    held = _held(xp, record, count, usual < HIDDEN * count, usual < SILENT * typical)
    least = max(SATURATED, FEWEST_HELD / record.shape[-1])
    fine = xp.max(xp.ptp(record, axis=-1), axis=0) > FEWEST_COUNTS * count
    is_saturated = ~is_dead & fine & (held >= least) & (held > 5 * xp.median(held))
    is_noisy = ~is_dead & ~is_saturated & (noise > loudest)
    return noise, signal, is_dead, is_saturated, is_noisy


@partial(jax.jit, static_argnums=1)
def _traced(arrays: tuple[Array, Array, Array], first: int) -> tuple[Array, ...]:
    return _quality(jnp, *arrays, first)


def _median_of(xp: Any, values: Any, counted: Any) -> Any:
    """Median of the values that count; infinite if none does."""
    ordered, n = xp.sort(xp.where(counted, values, np.inf)), xp.sum(counted)
    return (ordered[(n - 1) // 2] + ordered[n // 2]) / 2


def _noise(xp: Any, record: Any) -> Any:
    """Noise of each detector; a record is (frames, detectors, times), here and below."""
    n = record.shape[-1] - 4
    blocks = min(BLOCKS, n // SHORTEST_BLOCK)
    size = n // blocks
    differences = xp.diff(record, 4, axis=-1)[..., : blocks * size]
    pieces = differences.reshape(*record.shape[:2], blocks, size)
    quietest = xp.min(xp.mean(pieces**2, axis=-1), axis=-1) / 70  # 1 + 16 + 36 + 16 + 1
    return root(xp.mean(quietest, axis=0), xp) / _least_of(blocks, size)


def _least_of(blocks: int, size: int) -> float:
    """Expected least of several estimates of 1, by Blom's order statistics of normal numbers.

    Fourth differences have the correlations C(8, 4 + k)/70, so that n of them are worth 0.38 n.
    """
    worth = size * 70**2 / sum(comb(8, k) ** 2 for k in range(9))
    return 1 + NormalDist().inv_cdf(0.625 / (blocks + 0.25)) / (2 * worth) ** 0.5


def _signal(xp: Any, record: Any) -> Any:
    """Root mean square of each detector about the straight line of least squares."""
    along = xp.linspace(-1.0, 1.0, record.shape[-1])
    centred = record - xp.mean(record, axis=-1, keepdims=True)
    slope = (centred @ along) / (along @ along)
    rest = centred - slope[..., None] * along
    return root(xp.mean(rest**2, axis=(0, -1)), xp)


def _held(xp: Any, record: Any, count: Any, hidden: Any, exact: Any) -> Any:
    """Share of samples of each detector that repeat one value.

    At the channel's own highest and lowest level a sample counts if it equals the one before. At
    other levels it must equal all of the eight before, and not be the level at which the channel
    begins: noise of few counts repeats itself by chance, and quiet parts are constant. Levels of
    silence do not count: those that channels share, zero in a channel of both signs, and what is
    near the median of a channel without noise.

    Args:
        xp, record: as above.
        count: the least step.
        hidden: whether counts hide the noise. Then drift makes a staircase of the quiet parts, and
            waves rest at their crests.
        exact: whether there is hardly any noise, so that a silent channel stands still.
    """
    least, most = xp.min(record, axis=-1, keepdims=True), xp.max(record, axis=-1, keepdims=True)
    same = record[..., 1:] == record[..., :-1]
    run = same[..., 7:]
    for back in range(1, 8):
        run = run & same[..., 7 - back : same.shape[-1] - back]
    here = record[..., 8:]
    limits = [
        (below == 0) & (~hidden | _cut(xp, below, count))
        for below in (most - record, record - least)
    ]
    at_rails = same[..., 7:] & (limits[0] | limits[1])[..., 8:]
    run = run & ~hidden & (xp.abs(here - record[..., :1]) > 2 * count)
    shared = (here == xp.median(record[..., 0])) | (here == xp.median(record))
    middle = xp.median(record, axis=-1, keepdims=True)
    at_rest = exact & (xp.abs(here - middle) < RESTS * (most - least))
    silent = shared | at_rest | ((here == 0) & (least < 0) & (most > 0))
    return xp.mean((run | at_rails) & ~silent, axis=(0, -1))


def _cut(xp: Any, below: Any, count: Any) -> Any:
    """Whether more samples are clipped at the limit, where ``below`` is 0, than by rounding.

    The crest h - κ t²/2 of a wave stays within a count of its height for L = √(8/κ) samples. In the
    L samples beside them it is 10/3 counts lower, in the mean; on both sides, since it is a crest.
    """
    n = below.shape[-1]
    here, away = xp.arange(n), below > 0
    first = _largest_so_far(xp, xp.where(away, here, -1)) + 1
    stop = n - _largest_so_far(xp, xp.where(away, n - here, 0)[..., ::-1])[..., ::-1]
    sums = xp.pad(xp.cumsum(below, axis=-1), [(0, 0)] * (below.ndim - 1) + [(1, 0)])

    def leaves(start: Any, end: Any) -> Any:
        total = xp.take_along_axis(sums, end, -1) - xp.take_along_axis(sums, start, -1)
        return (total > CUT_OFF * count * (end - start)) | (start == end)

    length = xp.maximum(stop - first, 0)
    before = leaves(xp.maximum(first - length, 0), first)
    return before & leaves(stop, xp.minimum(stop + length, n))


def _largest_so_far(xp: Any, values: Any) -> Any:
    if xp is np:
        return np.maximum.accumulate(values, axis=-1)
    return jax.lax.cummax(values, axis=values.ndim - 1)


def _count(xp: Any, record: Any) -> Any:
    """The smallest step between samples: one count of a converter, or next to nothing."""
    steps = xp.abs(xp.diff(record, axis=-1))
    least = xp.min(xp.where(steps > 0, steps, np.inf))
    return xp.where(xp.isfinite(least), least, 0.0)


def ranges(numbers: np.ndarray) -> str:
    """Numbers in increasing order, neighbours joined.

    >>> ranges(np.array([3, 7, 8, 9, 20]))
    '3, 7-9, 20'
    """
    pieces = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(str(p[0]) if len(p) == 1 else f"{p[0]}-{p[-1]}" for p in pieces)
