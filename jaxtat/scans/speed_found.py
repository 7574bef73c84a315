"""An estimated speed of sound, and what its estimators share."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..base.choice_table import GUESSED, LIKELY

UNSURE = 0.005  # standard error over the speed, above which it is not believed


class SpeedFound(NamedTuple):
    """A speed over that of water, with reason, grade and standard error (None if not estimated)."""

    stretch: float
    why: str
    grade: str
    standard_error: float | None


def believed(speed: float, error: float, why: str, who: str) -> SpeedFound:
    """A speed with its standard error, if those who show it, in words, agree on it."""
    if error > UNSURE * speed:
        return unknown(f"{who} of different directions do not agree, to {error / speed:.1%}")
    return SpeedFound(speed, why, LIKELY, error)


def unknown(why: str) -> SpeedFound:
    """Water's speed, with the reason why no other is known."""
    return SpeedFound(1.0, why, GUESSED, None)


def beside(k: int, n: int, width: int) -> np.ndarray:
    """Which of n speeds are surroundings of the k-th: more than ``width`` steps away."""
    return np.abs(np.arange(n) - k) > width


def peaks(values: Float[np.ndarray, " speeds"], width: int) -> Iterator[tuple[int, float]]:
    """Number of each peak, and what its surroundings lead one to expect there.

    That is the straight line through all values but those of the peak.

    >>> list(peaks(np.array([0.0, 0.0, 5.0, 0.0, 0.0]), 1))[0][0]
    2
    """
    numbers = np.arange(len(values))
    for k in range(1, len(values) - 1):
        if values[k] >= max(values[k - 1], values[k + 1]):
            around = beside(k, len(values), width)
            yield k, float(np.polyval(np.polyfit(numbers[around], values[around], 1), k))


def summit(speeds: Float[np.ndarray, " speeds"], values: Float[np.ndarray, " speeds"]) -> float:
    """Where the parabola through the three highest values is highest.

    >>> speeds = np.linspace(0.9, 1.1, 5)
    >>> round(summit(speeds, -(speeds - 0.98) ** 2), 12)
    0.98
    """
    best = int(np.argmax(values[1:-1])) + 1
    before, highest, behind = values[best - 1 : best + 2]
    curvature = min(before - 2 * highest + behind, -np.finfo(float).tiny)
    step = float(np.clip((before - behind) / (2 * curvature), -1.0, 1.0))
    return float(speeds[best] + (speeds[1] - speeds[0]) * step)


def jackknife(without: list[float]) -> float:
    """Standard error from estimates that each leave out one of n parts.

    >>> round(jackknife([1.0, 1.0, 1.0]), 12), round(jackknife([0.9, 1.1]), 12)
    (0.0, 0.1)
    """
    n, found = len(without), np.array(without)
    return float(np.sqrt((n - 1) / n * np.sum((found - found.mean()) ** 2)))
