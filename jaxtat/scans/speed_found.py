"""An estimated speed of sound, and what its estimators share: peaks, parabolas, the jackknife."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ..base.choice_table import GUESSED, LIKELY
from .choices import Choices, at_speed
from .estimate import Estimate, Source

UNSURE = 0.005  # standard error over the speed, above which it is not believed


def believed(stretch: float, error: float, why: str, who: str) -> Estimate:
    """A speed over that of water, if those who show it, in words, agree on it."""
    if error > UNSURE * stretch:
        return unknown(f"{who} of different directions do not agree, to {error / stretch:.1%}")
    return Estimate(stretch, why, LIKELY, Source.ESTIMATE, error)


def unknown(why: str) -> Estimate:
    """Water's speed, with the reason why no other is known."""
    return Estimate(1.0, why, GUESSED)


def with_speed(choices: Choices, found: Estimate) -> Choices:
    """Choices of a record at water's speed, at an estimate of the speed over that."""
    error = found.standard_error
    error = None if error is None else choices.sound_speed * error
    told = found.source is Source.ESTIMATE
    sentence = found.sentence(choices.units)
    why = sentence if told else f"water's: {sentence}"
    at = at_speed(choices, found.value)
    return at.with_reason("sound_speed", why, found.grade, error)


def peaks(values: Float[np.ndarray, " speeds"], width: int) -> Iterator[tuple[int, float]]:
    """Number of each peak, and what its surroundings lead one to expect there.

    That is the straight line through all values but those of the peak.

    >>> list(peaks(np.array([0.0, 0.0, 5.0, 0.0, 0.0]), 1))[0][0]
    2
    """
    numbers = np.arange(len(values))
    for k in range(1, len(values) - 1):
        if values[k] >= max(values[k - 1], values[k + 1]):
            around = np.abs(numbers - k) > width
            yield k, float(np.polyval(np.polyfit(numbers[around], values[around], 1), k))


def summit(speeds: Float[np.ndarray, " speeds"], values: Float[np.ndarray, " speeds"]) -> float:
    """Where the parabola through the three highest values is highest.

    >>> speeds = np.linspace(0.9, 1.1, 5)
    >>> round(summit(speeds, -(speeds - 0.98) ** 2), 12)
    0.98
    """
    return top(speeds, values)[0]


def top(
    speeds: Float[np.ndarray, " speeds"], values: Float[np.ndarray, " speeds"]
) -> tuple[float, float]:
    """Where the parabola through the three highest values is highest, and how high.

    >>> speeds = np.linspace(0.9, 1.1, 5)
    >>> where, value = top(speeds, 3.0 - (speeds - 0.98) ** 2)
    >>> round(where, 12), round(value, 12)
    (0.98, 3.0)
    >>> top(speeds, np.array([1.0, 2.0, 2.0, 3.0, 9.0]))[0]  # none: to the higher side
    1.1
    """
    best = int(np.argmax(values[1:-1])) + 1
    before, highest, behind = values[best - 1 : best + 2]
    least = 1e-12 * max(abs(float(highest)), 1e-200)  # of what is flat, or lower in the middle
    curvature = min(before - 2 * highest + behind, -least)
    step = float(np.clip((before - behind) / (2 * curvature), -1.0, 1.0))
    value = highest - step * (before - behind) / 2 + step**2 * curvature / 2
    return float(speeds[best] + (speeds[1] - speeds[0]) * step), float(value)


def jackknife(without: list[float]) -> float:
    """Standard error from estimates that each leave out one of n parts.

    >>> round(jackknife([1.0, 1.0, 1.0]), 12), round(jackknife([0.9, 1.1]), 12)
    (0.0, 0.1)
    """
    n, found = len(without), np.array(without)
    return float(np.sqrt((n - 1) / n * np.sum((found - found.mean()) ** 2)))
