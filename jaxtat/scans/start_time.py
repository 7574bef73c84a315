"""When a record starts, and the speed of sound with it, by what no image in the region explains.

A start that is wrong by t_0 shifts all arrivals alike, a wrong speed those from afar more. To first
order in the region's radius over the detectors' distance D both are the same along

    c = D / (D / c_0 + t_0),

on which sound from the middle arrives when it does. To second order they are not: along that line
the image of a detector is stretched along its line of sight and bent across, and detectors on most
sides contradict each other. E(c, t_0), what no image in the region explains (`best_explained`), is
a least-squares problem with an exact solution, and so smooth, where fits of a few steps are not.
Its least value over speeds at each of some shifts is looked for, thrice, ever closer.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..base.choice_table import GUESSED, LIKELY
from ..io import Scan
from .acquisition import FASTEST, SLOWEST, nominal_water_speed
from .all_speeds import about_center, problem_for_speeds
from .best_explained import by_band, share_by_speed, with_long_waves
from .choices import Choices
from .estimate import Estimate, Source
from .frames import shifted_times
from .speed_found import jackknife, summit, top

SHIFTS = np.arange(-4, 5)  # steps of the start
ACROSS = np.arange(-2, 3)  # steps of the speed
# these: over the time from the middle to the detectors, over the speed; three times closer
STEPS = (0.025, 2e-3), (0.012, 5e-4), (0.006, 2e-4)
SPEEDS = np.linspace(0.83, 1.18, 71)  # over that of the choices, of which the first is taken
MOVES = 4  # along the ridge, at most, where it goes on beyond the shifts
FREQUENCIES = 32  # at most
UNEVEN = 0.1  # of the range of what is explained along the ridge, by which it may rise elsewhere
LEFT = 0.05  # of the power at a frequency, from which more than a wrong start is amiss
DEEP = 0.04  # log of what is left two close steps across the ridge, over that on it
SURE_TO = 2.5e-3  # standard error over the speed, to be likely
DIFFERENT = 3.0  # standard errors
MICROSECOND = 1e-6  # s


class Start(NamedTuple):
    """The start of which least of a record is unexplained, and the speed with it.

    Attributes:
        shift: t_0, what is added to the times [time].
        standard_error: its, the jackknife's over bands of frequencies [time].
        speed: c with it [length/time].
        speed_error: that of the speed, along the ridge and across it [length/time].
        even: whether less is unexplained the nearer to it, without exception.
    """

    shift: float
    standard_error: float
    speed: float
    speed_error: float
    even: bool = True

    @property
    def differs(self) -> bool:
        """Whether the record contradicts the file's start time."""
        return abs(self.shift) > DIFFERENT * self.standard_error

    @property
    def grade(self) -> str:
        return LIKELY if self.even and self.speed_error <= SURE_TO * self.speed else GUESSED

    def estimates(self, model: Estimate) -> dict[str, Estimate]:
        """Start and speed for the table, with the model by which they were estimated."""
        when = "late" if self.shift > 0 else "early"
        why = (
            f"the record starts {{gone:time}} {when}: with that an image explains it best; "
            "--start-time gives another start"
        )
        of_speed = "an image explains the record best, with the shift of times; none in the file"
        found = GUESSED, Source.ESTIMATE
        data = {"gone": abs(self.shift)}
        return {
            "model": model._replace(source=Source.ESTIMATE),
            "time_shift": Estimate(self.shift, why, *found, self.standard_error, data),
            "sound_speed": Estimate(
                self.speed, of_speed, self.grade, Source.ESTIMATE, self.speed_error
            ),
        }


def with_start_untold(choices: Choices, distance: float) -> Choices:
    """Choices whose start and speed are guesses, with the line that joins them.

    Args:
        distance: of the detectors from the middle [length].
    """
    units, speed = choices.units, choices.sound_speed
    later = MICROSECOND / units.in_si("time")[0]
    faster = distance / (distance / speed - later) - speed
    why = (
        f"as the file says, which the record does not tell: {units.of_time(later)} more would make "
        f"the speed {units.of_speed(faster, 3)} more; --start-time gives another start"
    )
    reason = dict(choices.reasons)["sound_speed"]
    if choices.grade("sound_speed") != GUESSED:
        reason += "; if the record starts when the file says"
    error = dict(choices.standard_errors).get("sound_speed")
    guessed = choices.with_reason("time_shift", why, GUESSED)
    return guessed.with_reason("sound_speed", reason, GUESSED, error)


def with_start_confirmed(choices: Choices, start: Start) -> Choices:
    """Choices whose start an image speaks for too."""
    units = choices.units
    why = f"as the file says; images tell the same to {units.of_time(start.standard_error)}"
    told = choices.with_reason("time_shift", why, start.grade, start.standard_error)
    if start.grade == LIKELY:
        return told
    speed = "sound_speed", dict(choices.reasons)["sound_speed"]
    return told.with_reason(*speed, GUESSED, start.speed_error)


def start_and_speed(scan: Scan, choices: Choices) -> Start | None:
    """The start t_0 and the speed c at which an image in the region explains most of a record,

        E(c, t_0) = mean over lambda of log min_y (|√w G - A^T y|² + alpha |y|²) / |√w G|²,

    G the transforms over circles of the radii c (t + t_0), and all else as in `best_explained`.

    Args:
        scan: of pressure in the plane; its typical frame is taken.
        choices: for it, with one speed of sound, of ``choose(scan, two_speeds=False)``, at most a
            sixth off for times as they are.

    Returns:
        None where the record is too short to tell, hardly any speed is better than others, no image
        explains most of it, or the speed is none of tissue: two speeds look like a start, too.

    Raises:
        ValueError: for circular integrals, detectors in space, and a body of another speed.
    """
    times = shifted_times(scan, choices)
    if times is None or choices.in_space or choices.water_speed is not None:
        raise ValueError(
            "start and speed are told together by pressure records in the plane, through one speed "
            "of sound."
        )
    distance = float(np.hypot(*about_center(scan, choices).T).mean())
    known = choices.sound_speed
    earliest = distance / known * SHIFTS[0] * sum(step for step, _ in STEPS)
    heard = known * (float(times[-1]) + earliest)
    n_radii = int(np.count_nonzero(np.asarray(choices.radii) <= heard))
    whole = with_long_waves(scan, replace(choices, n_radii=n_radii))
    problem = problem_for_speeds(scan, whole)
    if problem.geometry is None or not problem.setup.complete:
        return None
    share_at = share_by_speed(scan, whole, problem, FREQUENCIES)
    ridge = _highest(share_at, known, distance, earliest)
    water = nominal_water_speed(choices.units) or known
    if ridge is None or not SLOWEST * water <= ridge.speed <= FASTEST * water:
        return None
    if ridge.depth < DEEP or ridge.left > LEFT:
        return None
    error = np.hypot(ridge.across_error, ridge.error * ridge.slope * ridge.speed**2)
    return Start(ridge.shift, ridge.error, ridge.speed, float(error), ridge.even)


def _highest(
    share_at: Callable[..., np.ndarray], known: float, distance: float, earliest: float
) -> "_SpeedStartRidge | None":
    """The highest point, ever closer; None where the record is too short or there is none.

    Args:
        share_at: of `share_by_speed`.
        known: speed of which speeds are shares [length/time].
        distance: of the detectors from the middle [length].
        earliest: shift for which there are radii [time].
    """
    first = float(SPEEDS[np.argmax(-np.log(share_at(SPEEDS)).mean(axis=0))]) * known
    ridge: _SpeedStartRidge | None = _SpeedStartRidge(
        0.0, first, 1 / distance, np.inf, np.inf, 0.0, 1.0
    )
    even = True
    for step, step_across in STEPS:
        for _ in range(MOVES):
            shifts = ridge.shift + step * distance / known * SHIFTS
            if shifts[0] < earliest:
                return None
            line = 1 / (1 / ridge.speed + ridge.slope * (shifts - ridge.shift))
            speeds = line[:, None] * (1 + step_across * ACROSS)
            every = np.repeat(shifts, len(ACROSS))
            explained = -np.log(share_at(speeds.ravel() / known, every))
            ridge = _along_ridge(shifts, speeds, explained.reshape(-1, *speeds.shape))
            if ridge is None or ridge.inside:
                break
        if ridge is None or not ridge.inside:
            return None
        even = even and ridge.even
    return ridge._replace(even=even)


class _SpeedStartRidge(NamedTuple):
    """The highest point of what is explained, by the highest speed of each shift.

    Attributes:
        shift, speed: there.
        slope: by which slowness grows with the shift along the ridge [1/length].
        error, across_error: the jackknife's over bands, of the shift and of the speed with it.
        depth: of the highest point over the ends across.
        left: share of the power at a frequency that is unexplained there.
        inside: whether it lies between the shifts.
        even: whether what is explained grows up to it and falls behind it.
    """

    shift: float
    speed: float
    slope: float
    error: float
    across_error: float
    depth: float
    left: float
    inside: bool = True
    even: bool = True


def _along_ridge(
    shifts: Float[np.ndarray, " shifts"],
    speeds: Float[np.ndarray, "shifts speeds"],
    explained: Float[np.ndarray, "frequencies shifts speeds"],
) -> _SpeedStartRidge | None:
    """None where it is not between ups before and downs behind, but for small ones.

    Sound that the model does not hold, as from out of the plane, makes several heights.
    """
    bands = by_band(explained)
    total = bands.sum(axis=0)
    tops = np.array([top(*pair) for pair in zip(speeds, total, strict=True)])
    k = int(np.argmax(tops[:, 1]))
    rises = np.diff(tops[:, 1])
    against = max(-rises[:k].min(initial=0.0), rises[k:].max(initial=0.0))
    if against > UNEVEN * np.ptp(tops[:, 1]):
        return None
    if not 0 < k < len(shifts) - 1:
        slope = float(np.polyfit(shifts, 1 / tops[:, 0], 1)[0])
        return _SpeedStartRidge(
            float(shifts[k]), float(tops[k, 0]), slope, np.inf, np.inf, 0.0, 1.0, False
        )

    def highest(heights: np.ndarray) -> float:
        found = [top(*pair)[1] for pair in zip(speeds, heights, strict=True)]
        return summit(shifts, np.array(found))

    shift = highest(total)
    slope, offset = np.polyfit(shifts - shift, 1 / tops[:, 0], 1, w=_near(len(shifts), k))
    error = jackknife([highest(total - band) for band in bands])
    across = jackknife([top(speeds[k], total[k] - band[k])[0] for band in bands])
    n = explained.shape[0]
    depth = float(total[k].max() - max(total[k, 0], total[k, -1])) / n
    left = float(np.exp(-total[k].max() / n))
    here = shift, float(1 / offset), float(slope)
    return _SpeedStartRidge(*here, error, across, depth, left, even=bool(against <= 0))


def _near(n: int, k: int) -> Float[np.ndarray, " shifts"]:
    """1 for the shifts beside the k-th, little for others."""
    return np.where(np.abs(np.arange(n) - k) <= 2, 1.0, 1e-3)
