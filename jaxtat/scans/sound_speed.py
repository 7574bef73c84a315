"""The speed of sound, and when a record starts, by what the best image leaves unexplained.

Least over speeds is searched for in steps, around the best in halves of them, and the parabola
through the last three gives the speed. A start that is wrong by t_0 shifts all arrivals alike, a
wrong speed those from afar more: along c = D / (D/c_0 + t_0), D the distance of the middle,
arrivals from there stay the same, and that line is searched for the start.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from .misfit import Fit, Misfit

STEP = 1 / 120  # between speeds, over water's
FINER = 2  # halvings of it
SECTORS = 8  # of detectors, each of which is left out in turn
BESIDE = 2  # steps to each side of the least share that are no measure of the others
SHIFTS = 0.025 * np.arange(-4, 5)  # of the start, over the time from the middle to the detectors
FINER_SHIFTS = 3  # halvings of their steps


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


def least_share(
    fit_at: Callable[[float], Fit],
    values: np.ndarray,
    good: Bool[np.ndarray, " detectors"],
    finer: int = FINER,
) -> Least:
    """Where the unexplained share is least, between equispaced values.

    Args:
        fit_at: the fit at a value.
        values: that are tried, (some,).
        good: detectors that count.
        finer: halvings of the step around the best.
    """
    fits = {float(value): fit_at(float(value)) for value in values}
    squares = np.array([fit.share**2 for fit in fits.values()])
    k = int(np.argmin(squares))
    elsewhere = np.abs(np.arange(len(values)) - k) > BESIDE
    typical = float(np.median(squares[elsewhere])) if elsewhere.any() else 0.0
    depth = 1 - float(squares[k]) / typical if typical > 0 else 0.0
    step, best = float(values[1] - values[0]), float(values[k])
    if not 0 < k < len(values) - 1:
        return Least(best, np.inf, depth, fits[best])

    def three() -> list[float]:
        return [best - step, best, best + step]

    for _ in range(finer):
        step /= 2
        for value in three():
            if value not in fits:
                fits[value] = fit_at(value)
        best = min(three(), key=lambda value: fits[value].share)
    for value in three():
        if value not in fits:
            fits[value] = fit_at(value)
    left = np.array([fits[value].left for value in three()])
    parts = np.array_split(np.flatnonzero(good), SECTORS)
    without = np.array([_summit(best, step, np.delete(left, part, axis=1)) for part in parts])
    error = np.sqrt((SECTORS - 1) / SECTORS * np.sum((without - np.mean(without)) ** 2))
    return Least(_summit(best, step, left), float(error), depth, fits[best])


def _summit(best: float, step: float, left: np.ndarray) -> float:
    """Where the parabola through three sums over detectors is least, within a step."""
    before, here, behind = map(float, left.sum(axis=1))
    curvature = max(before - 2 * here + behind, 1e-300)
    return best + step * float(np.clip((before - behind) / (2 * curvature), -1.0, 1.0))


class Start(NamedTuple):
    """The best start and the speed with it.

    Attributes:
        shift: t_0, what is added to the times [time].
        speed: c with it.
        gain: by how much of it share² is smaller than without a shift.
    """

    shift: float
    speed: Least
    gain: float


def best_start(
    misfit: Misfit,
    weight: float,
    without: Least,
    distance: float,
    speeds: tuple[float, float],
    good: Bool[np.ndarray, " detectors"],
) -> Start | None:
    """The start with which least is unexplained; None where it is at an end of the range.

    Args:
        misfit, weight: the criterion.
        without: the speed with times as they are.
        distance: of the detectors from the middle [length].
        speeds: least and greatest that are possible.
    """
    arrival = distance / without.value

    def along(shift: float) -> Fit:
        return misfit.best(distance / (arrival + shift), shift, weight=weight)

    possible = distance / (arrival * (1 + SHIFTS))
    shifts = arrival * SHIFTS[(possible >= speeds[0]) & (possible <= speeds[1])]
    if len(shifts) < 3:
        return None
    found = least_share(along, shifts, good, FINER_SHIFTS)
    if not found.inside:
        return None
    speed, shift = distance / (arrival + found.value), found.value
    near = speed * (1 + STEP * np.arange(-2, 3) / 4)
    best = least_share(lambda c: misfit.best(c, shift, weight=weight), near, good, 0)
    gain = 1 - (best.fit.share / without.fit.share) ** 2
    return Start(shift, best._replace(depth=without.depth), gain)
