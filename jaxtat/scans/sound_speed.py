"""The speed of sound by what the best image leaves unexplained.

Least over speeds is searched for in steps by fits that are hardly begun, and from the best of these
downhill in quarters of a step by whole ones; the parabola through the last three gives the speed.
Few steps leave more, but least at the same speed to a step where that speed is distinct (by 6, 10
and 15 of 25, on simulated scans); where it is not, as from half a circle, fits at all speeds are
whole ones. Every second speed would not do: a dip can lie between.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from .misfit import IN_PLANE, Effort, Fit
from .speed_found import jackknife, summit

STEP = 1 / 120  # between speeds, over water's
FINER = 4  # parts of it
DISTINCT = 0.3  # depth from which a speed is believed, of detectors on most sides
SECTORS = 8  # of detectors, each of which is left out in turn
TELLING = 0.4  # depth from which fits that are hardly begun tell where the least is
BESIDE = 2  # steps to each side of the least share that are no measure of the others


class Least(NamedTuple):
    """Where the unexplained share is least.

    Attributes:
        value: there.
        standard_error: the jackknife's over sectors of detectors; infinite at an end of the range.
        depth: 1 - share² there over the typical share² elsewhere.
        fit: the nearest to it.
    """

    value: float
    standard_error: float
    depth: float
    fit: Fit

    @property
    def inside(self) -> bool:
        """Whether it is not at an end of the range."""
        return bool(np.isfinite(self.standard_error))

    @property
    def distinct(self) -> bool:
        """Whether it is believed, of detectors on most sides."""
        return self.inside and self.depth >= DISTINCT


def least_share(
    fit_at: Callable[..., Fit],
    values: np.ndarray,
    good: Bool[np.ndarray, " detectors"],
    effort: Effort = IN_PLANE,
) -> Least:
    """Where the unexplained share is least, between equispaced values.

    Args:
        fit_at: the fit at a value, by a number of ``steps``.
        values: that are tried, (some,).
        good: detectors that count.
        effort: of fits that are hardly begun, and of whole ones.
    """
    step = float(values[1] - values[0]) / FINER
    last = FINER * (len(values) - 1)

    @cache
    def whole(part: int) -> Fit:
        return fit_at(float(values[0] + part * step), steps=effort.whole)

    shares = np.array([fit_at(float(value), steps=effort.few).share for value in values])
    k, typical = _least_and_typical(shares)
    if _depth(shares[k], shares[typical]) < TELLING:
        shares = np.array([whole(FINER * i).share for i in range(len(values))])
        k, typical = _least_and_typical(shares)
    best = _downhill(lambda part: whole(part).share, FINER * k, last)
    depth = _depth(whole(FINER * k).share, whole(FINER * typical).share)
    if not 0 < best < last:
        return Least(float(values[0] + best * step), np.inf, depth, whole(best))
    three = np.arange(best - 1, best + 2)
    near, left = values[0] + step * three, np.array([whole(int(part)).left for part in three])

    def where_least(left: np.ndarray) -> float:
        return summit(near, -left.sum(axis=1))

    parts = np.array_split(np.flatnonzero(good), SECTORS)
    error = jackknife([where_least(np.delete(left, part, axis=1)) for part in parts])
    return Least(where_least(left), error, depth, whole(best))


def _least_and_typical(shares: np.ndarray) -> tuple[int, int]:
    """Which share is least, and which is in the middle of those that are not beside it."""
    k = int(np.argmin(shares))
    elsewhere = np.flatnonzero(np.abs(np.arange(len(shares)) - k) > BESIDE)
    if not elsewhere.size:
        return k, k
    return k, int(elsewhere[np.argsort(shares[elsewhere])[elsewhere.size // 2]])


def _depth(least: float, typical: float) -> float:
    return 1 - (least / typical) ** 2 if typical > 0 else 0.0


def _downhill(height: Callable[[int], float], start: int, last: int) -> int:
    """From one whole number to the next lower one beside it, from 0 to the last."""
    here = start
    while True:
        beside = [k for k in (here, here - 1, here + 1) if 0 <= k <= last]
        lowest = min(beside, key=height)
        if lowest == here:
            return here
        here = lowest
