"""Where the sound of a record comes from, by the first and last times at which it is recorded.

Detector k records a body of radius a about m from (|y_k - m| - a)/c to (|y_k - m| + a)/c. Half the
time between is a/c, which depends little on an error of c. The first times alone would give a wrong
size if c is wrong, and on a short arc they do not determine the position across.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .power import RecordPower

BEGINS, CEASES = 0.02, 0.05  # share of a detector's highest power that counts as sound
QUIETEST, QUIET = 0.05, 0.25  # shares of a record, from which noise and its scatter are taken
ABOVE_NOISE, ABOVE_SCATTER = 2.0, 4.0  # times the quiet power, and times its scatter over that
CLEARLY = 0.5  # of the highest power, below which the least that counts has to be
SILENCE, FAINTEST = 1e-10, 1e-4  # where quiet is less than that, the faintest share counts
NEIGHBOURS, AT_MOST = 60, 8  # detectors over those to each side, with which one is averaged
# what is supposed of the disk, over the radius on which the detectors lie
OFF_MIDDLE, DEVIATION, SPEEDS = 0.2, 0.02, 0.03
INDEPENDENT = 10  # detectors that err by themselves; others err as those beside them
STEPS = 60


class Heard(NamedTuple):
    """First and last times at which detectors record sound.

    Attributes:
        first, last: (detectors,) [time].
        begins, ceases: whether these are known: the record is silent before, and after.

    `tells` is whether one or the other is known for most detectors.
    """

    first: Float[np.ndarray, " detectors"]
    last: Float[np.ndarray, " detectors"]
    begins: Bool[np.ndarray, " detectors"]
    ceases: Bool[np.ndarray, " detectors"]

    @property
    def tells(self) -> bool:
        return bool(max(self.begins.mean(), self.ceases.mean()) > 0.5)


def heard(power: RecordPower, pause: float) -> Heard:
    """First and last time of a share of each detector's highest power, above its noise.

    Fainter sound from holders, membranes and walls is ignored; in a record without noise all sound
    counts. Pauses divide the sound into parts, and parts after a pause are echoes: the last time is
    the end of the part with the largest total power.

    Args:
        power: in order along the curve, since neighbours are averaged.
        pause: the shortest that separates an echo [time].

    >>> times = np.arange(100.0)
    >>> power = np.where(abs(times - 40) < 10, 1.0, 1e-3) * np.ones((5, 1))
    >>> found = heard(RecordPower(times, power), 5.0)
    >>> float(found.first[0]), float(found.last[0]), bool(found.begins.all())
    (31.0, 49.0, True)
    """
    values = _with_neighbours(power.power)
    highest = values.max(axis=1)
    quietest, quiet = np.quantile(values, [QUIETEST, QUIET], axis=1)
    if np.median(quiet) < SILENCE * np.median(highest):
        least = [FAINTEST * highest] * 2
    else:
        noise = np.maximum(ABOVE_NOISE * quiet, quiet + ABOVE_SCATTER * (quiet - quietest))
        least = [np.maximum(noise, quiet + share * highest) for share in (BEGINS, CEASES)]
    first = np.argmax(values > least[0][:, None], axis=1)
    pieces = int(np.ceil(pause / (power.times[1] - power.times[0])))
    last = np.array([_end_of_loudest(*of, pieces) for of in zip(values, least[1], strict=True)])
    sounds = least[1] < CLEARLY * highest  # not the highest of the noise alone
    return Heard(
        power.times[first],
        power.times[last],
        sounds & (first > 0),
        sounds & (last < len(power.times) - 1),
    )


def _end_of_loudest(values: Float[np.ndarray, " pieces"], least: float, pause: int) -> int:
    """Number of the last piece of the part, between pauses, with the largest total power."""
    sounds = np.flatnonzero(values > least)
    if not len(sounds):
        return len(values) - 1
    parts = np.split(sounds, np.flatnonzero(np.diff(sounds) > pause) + 1)
    return int(max(parts, key=lambda part: values[part].sum())[-1])


def _with_neighbours(
    power: Float[np.ndarray, "detectors pieces"],
) -> Float[np.ndarray, "detectors pieces"]:
    each = min(max(1, len(power) // NEIGHBOURS), AT_MOST)
    sums = np.cumsum(np.pad(power, ((each + 1, each), (0, 0)), mode="edge"), axis=0)
    return (sums[2 * each + 1 :] - sums[: -2 * each - 1]) / (2 * each + 1)


class SoundingDisk(NamedTuple):
    """A disk, or ball, from which sound comes; `speed` is the fitted speed over the assumed one."""

    middle: Float[np.ndarray, " space"]
    radius: float
    speed: float


def sounding_disk(
    points: Float[np.ndarray, "detectors space"],
    when: Heard,
    speed: float,
    speed_known: bool,
) -> SoundingDisk:
    """The disk |x - m| < a that fits |y_k - m| ∓ a = s c t to the first and last times t.

    The sum of absolute differences is minimised, so that up to half of the detectors may record
    something else, such as a holder or an echo. Priors keep the middle within about a fifth of the
    detectors' radius of the origin, and s within about 3 % of 1: on short arcs a nearer body and a
    faster sound have almost the same times.

    Args:
        points: y_k, from the middle of the array [length].
        when: from `heard`.
        speed: c [length/time].
        speed_known: s is 1.

    >>> theta = np.linspace(0.0, 2.0, 60)
    >>> y = 40 * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    >>> d, told = np.linalg.norm(y - [5.0, 2.0], axis=1), np.ones(60, bool)
    >>> first = d - 9.0
    >>> first[::4] = 20.0  # a quarter of the detectors
    >>> found = sounding_disk(y, Heard(first, d + 9.0, told, told), 1.0, True)
    >>> found.middle.round(1).tolist(), round(found.radius, 1), found.speed
    ([5.0, 2.0], 9.0, 1.0)
    """
    size, n = float(np.median(np.linalg.norm(points, axis=1))), len(points)
    points, first, last = points / size, speed / size * when.first, speed / size * when.last
    told = np.concatenate([when.begins, when.ceases]) * (INDEPENDENT / n)
    supposed = np.full(points.shape[1] + 2, 1 / OFF_MIDDLE**2)
    supposed[-2:] = 0.0, 1 / SPEEDS**2
    found = np.zeros(len(supposed))  # middle, radius, s - 1
    found[-2] = max(float(np.median(last - first)) / 2, DEVIATION)
    one, stretched = np.ones(n), 0.0 if speed_known else 1.0
    for _ in range(STEPS):  # weighted least squares with weights 1/|difference|, linearised
        offset = points - found[:-2]
        distance = np.linalg.norm(offset, axis=1)
        away = -offset / distance[:, None]
        near, far = distance - found[-2], distance + found[-2]
        difference = np.concatenate([near, far]) - (1 + found[-1]) * np.concatenate([first, last])
        slopes = np.concatenate(
            [
                np.column_stack([away, -one, -stretched * first]),
                np.column_stack([away, one, -stretched * last]),
            ]
        )
        weights = told / (DEVIATION * (np.abs(difference) + DEVIATION / 4))
        system = slopes.T @ (weights[:, None] * slopes) + np.diag(supposed)
        found -= np.linalg.lstsq(system, slopes.T @ (weights * difference) + supposed * found)[0]
    found[:-1] *= size
    return SoundingDisk(found[:-2], max(float(found[-2]), 0.0), float(1 + found[-1]))
