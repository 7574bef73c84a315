"""Speed of sound, acoustic model and start of a scan in the plane, and what contradicts them.

All by one criterion, `misfit`. The bounds here were set on scans of `benchmarks/scans` with numbers
below 300, small size.
"""

import warnings
from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..base.choice_table import GUESSED, LIKELY
from ..geometry import ArcFit, detector_curve
from ..io import Scan
from ..steps import AccuracyWarning, Contradiction
from .acquisition import FASTEST, SLOWEST, arc_through, facts_of
from .choices import Choices
from .found import RIM, Found
from .frames import shifted_times
from .misfit import Misfit, Sound, misfit_of
from .one_side import SEEN_TWICE, span
from .region_in_plane import circle_without_detectors
from .sound_speed import STEP, Least, Start, best_start, least_share
from .speed_found import UNSURE

FEWEST_SAMPLES = 64  # in which sound passes
DISTINCT = 0.3  # depth from which a speed is believed, of detectors on most sides
LATE = 1.0 / 13  # of the arrival from the middle: a start may be wrong by that
CLEARLY = 0.5  # share² that the right model must spare, to be likely
MUCH_LESS = 0.3  # and another start
UNEQUAL = 0.02  # distances of detectors from the middle, of which a start can be told
MICROSECOND = 1e-6  # s
EXPLAINED = 0.4  # share, below which an image explains most of a record
NO_IMAGE = 0.88  # share² over that of rows in another order, from which no image explains
HARDLY = 0.5  # of that ratio, from which other speeds than the file's are tried
STRETCHES = np.arange(SLOWEST, FASTEST + STEP / 2, STEP)  # speeds that are tried, over nominal
WHAT = {"2d": "two-dimensional waves", "in-plane": "sound in the plane"}


class Told(NamedTuple):
    """The best image of a record by one model.

    Attributes:
        model: "2d" or "in-plane".
        misfit, weight: the criterion.
        speed: where least is unexplained.
    """

    model: str
    misfit: Misfit
    weight: float
    speed: Least


def sound_within(
    arc: ArcFit,
    points: Float[np.ndarray, "detectors 2"],
    record: Float[np.ndarray, "detectors samples"],
    times: Float[np.ndarray, " samples"],
    good: Bool[np.ndarray, " detectors"],
    begin: float,
    speed: float,
) -> Sound | None:
    """The part of a record that holds sound from within the detectors; None if that is too short,
    or nothing.

    Args:
        arc: circle of the detectors, or the largest without any.
        points, record, times: of the detectors in order along the curve.
        good: those that count.
        begin: when sound may begin [time].
        speed: of sound, nominal [length/time].
    """
    center, reach = np.array(arc.center), RIM * arc.radius
    farthest = float(np.hypot(*(points - center).T).max())
    end = min(float(times[-1]), (farthest + reach) / ((1 - LATE) * SLOWEST * speed))
    begin = max(begin, float(times[0]))
    within = (times >= begin) & (times <= end)
    if np.count_nonzero(within) < FEWEST_SAMPLES or not record[good][:, within].any():
        return None
    return Sound(detector_curve(points), record, times, good, begin, end, center, reach)


def shares_by_speed(
    scan: Scan,
    choices: Choices,
    frame: Float[np.ndarray, "rows samples"],
    speeds: Float[np.ndarray, " speeds"],
) -> Float[np.ndarray, " speeds"] | None:
    """What share of a frame the best image leaves unexplained at each speed of sound.

    Args:
        scan, choices: in the plane, of pressure.
        frame: rows as in the file.
        speeds: (speeds,) [length/time].

    Returns:
        ||record of the image - record|| / ||record||, see `misfit`; None of a record that is too
        short to tell.
    """
    sound, speed = sound_of(scan, choices, frame), choices.sound_speed
    if sound is None:
        return None
    misfit = misfit_of(sound, choices.model, (float(min(speeds)), float(max(speeds))))
    weight = misfit.best(speed).weight
    return np.array([misfit.best(float(c), weight=weight).share for c in speeds])


def sound_of(
    scan: Scan, choices: Choices, frame: Float[np.ndarray, "rows samples"]
) -> Sound | None:
    """The part of a frame that counts, once choices are made; None of one that is too short.

    Args:
        scan, choices: in the plane, of pressure.
        frame: rows as in the file.
    """
    facts, rows = facts_of(scan), list(choices.channels)
    times = shifted_times(scan, choices)
    if times is None:
        raise ValueError("the speed of sound is of pressure records, and the data are integrals.")
    points = facts.points[rows]
    arc = arc_through(points) or circle_without_detectors(points, choices.region_center)
    good = np.ones(len(rows), bool)
    begin, speed = 2 * choices.dead_time, choices.sound_speed
    return sound_within(arc, points, np.asarray(frame, float)[rows], times, good, begin, speed)


def tell_acoustics(
    sound: Sound, arc: ArcFit, found: Found, nominal: float, start_known: bool
) -> None:
    """Take what the record tells of speed, model and start, and warn of what it contradicts.

    Args:
        sound: the record.
        arc: circle of the detectors, or the largest without any.
        found: with the speed of the file, the one given, or water's.
        nominal: that speed, of two the single one that comes nearest [length/time].
        start_known: whether the file or the user says when the record starts.
    """
    distance = arc.radius
    seen = span(np.asarray(sound.curve.points)[sound.good], sound.center)
    unknown = "sound_speed" in found.to_estimate and seen >= SEEN_TWICE
    models = [str(found.values["model"])]
    if "model" in found.to_estimate and seen >= SEEN_TWICE:
        models = list(WHAT)
    elif "model" in found.to_estimate:
        _keep_model(found, seen)
    told = [_told(sound, model, nominal, sought=unknown) for model in models]
    best = told[0]
    if len(told) > 1:
        # each with the weight that goes with it: those of water's speed are too large
        shares = [each.misfit.best(each.speed.value).share for each in told]
        best, other = (told[k] for k in np.argsort(shares))
        _take_model(found, best, other, min(shares), max(shares))
    chance = cache(partial(_share_by_chance, best))
    told_by_user = any(found.given.get(name) is not None for name in ("sound_speed", "water_speed"))
    of_file = not told_by_user and "sound_speed" not in found.to_estimate
    if of_file and seen >= SEEN_TWICE and (best.speed.fit.share / chance()) ** 2 > HARDLY:
        best = _told(sound, best.model, nominal, sought=True)
        _compare(found, best, nominal)
    reason = _contradiction(best, chance)
    if reason:
        warnings.warn(f"{reason}.", Contradiction, stacklevel=6)
        if seen >= SEEN_TWICE:
            found.settle_all(reason)
        found.doubt()
        return
    if unknown:
        start = None
        if not start_known and _tells_start(sound):
            best, start = _with_start(sound, best, nominal, distance)
        elif not start_known:
            _say_what_start_does(found, best.speed.value, distance)
        _take_speed(found, best, start)


def _told(sound: Sound, model: str, nominal: float, *, sought: bool) -> Told:
    """The best image, at the speed of which least is unexplained, or at the nominal one."""
    ends = (SLOWEST * (1 - LATE) * nominal, FASTEST * (1 + LATE) * nominal)
    misfit = misfit_of(sound, model, ends)
    first = misfit.best(nominal)
    if not sought:
        return Told(model, misfit, first.weight, Least(nominal, np.inf, 0.0, first))
    fit_at = partial(misfit.best, weight=first.weight)
    speed = least_share(fit_at, nominal * STRETCHES, sound.good)
    return Told(model, misfit, first.weight, speed)


def _take_model(found: Found, best: Told, other: Told, least: float, most: float) -> None:
    """The model by which the best image leaves less unexplained."""
    clear = (least / most) ** 2 < 1 - CLEARLY
    why = (
        f"the best image leaves {least:.0%} of the record unexplained as {WHAT[best.model]}, "
        f"{most:.0%} as {WHAT[other.model]}"
    )
    _settle_model(found, best.model, why, LIKELY if clear else GUESSED)


def _keep_model(found: Found, seen: float) -> None:
    """The model that the record alone spoke for: seen once, edges fit either."""
    model = found.values["model"]
    why = f"{found.reasons['model']}; from {seen:.0f} degrees images do not tell"
    _settle_model(found, model, why, GUESSED)


def _settle_model(found: Found, model: str, why: str, grade: str) -> None:
    if model == "2d":
        warnings.warn(f"{why}; a scanner's record needs model in-plane.", AccuracyWarning, 8)
    found.settle("model", model, why, grade)


def _tells_start(sound: Sound) -> bool:
    """Whether detectors are not all as far from the middle: else another speed does as well."""
    offset = np.asarray(sound.curve.points)[sound.good] - sound.center
    distances = np.hypot(*offset.T)
    return bool(distances.min() < (1 - UNEQUAL) * distances.max())


def _say_what_start_does(found: Found, speed: float, distance: float) -> None:
    """The line that joins speeds and starts: sound from the middle arrives when it does."""
    units = found.values["units"]
    later = MICROSECOND / units.in_si("time")[0]
    faster = distance / (distance / speed - later) - speed
    why = (
        f"{found.reasons['time_shift']}, which a circle of detectors does not tell: "
        f"{units.of_time(later)} more would make the speed {units.of_speed(faster)} more"
    )
    found.explain("time_shift", why, LIKELY)


def _with_start(
    sound: Sound, told: Told, nominal: float, distance: float
) -> tuple[Told, Start | None]:
    """The speed with another start of the record, where that spares much."""
    speed, misfit = told.speed, told.misfit
    if not speed.inside or speed.depth < DISTINCT:
        ends = (1 - LATE) * SLOWEST, (1 + LATE) * FASTEST
        stretch = np.arange(*ends, STEP)
        fit_at = partial(misfit.best, weight=told.weight)
        wide = least_share(fit_at, nominal * stretch, sound.good)
        speed = wide if wide.inside and wide.depth > speed.depth else speed
    if not speed.inside:
        return told, None
    possible = nominal * SLOWEST, nominal * FASTEST
    start = best_start(misfit, told.weight, speed, distance, possible, sound.good)
    if start is None or start.gain < MUCH_LESS:
        return told, None
    return told._replace(speed=start.speed), start


def _take_speed(found: Found, told: Told, start: Start | None) -> None:
    speed, units = told.speed, found.values["units"]
    error = speed.standard_error
    if start is not None:
        found.values["time_shift"] = start.shift
        gone = units.of_time(abs(start.shift))
        when = "late" if start.shift > 0 else "early"
        why = (
            f"the record starts {gone} {when}: {start.gain:.0%} less is left unexplained; "
            "--start-time gives another start"
        )
        found.explain("time_shift", why, GUESSED)
    if not speed.inside:
        why = "water's: no speed within 10 % of it leaves least unexplained"
        found.settle("sound_speed", found.values["sound_speed"], why, GUESSED)
        return
    sure = speed.depth >= DISTINCT and error <= UNSURE * speed.value
    sure = sure and found.grades["model"] != GUESSED
    why = f"the best image leaves {speed.fit.share:.0%} unexplained, least of all speeds"
    if not sure:
        why += f", but by {max(speed.depth, 0.0):.0%} only"
    if start is not None:
        sure, why = False, f"{why}, with the shift of times"
    grade = LIKELY if sure else GUESSED
    found.settle("sound_speed", speed.value, f"{why}; none in the file", grade, error)


def _compare(found: Found, told: Told, nominal: float) -> None:
    """Doubt the speed of the file where another one leaves much less unexplained."""
    speed, own = told.speed, told.misfit.best(nominal, weight=told.weight)
    spared = 1 - (speed.fit.share / max(own.share, 1e-300)) ** 2
    other = speed.inside and abs(speed.value / nominal - 1) > UNSURE and spared > MUCH_LESS
    if other:
        units = found.values["units"]
        why = f"{found.reasons['sound_speed']}; but at {units.of_speed(speed.value)}"
        found.explain("sound_speed", f"{why} {spared:.0%} less is unexplained: try that", GUESSED)


def _contradiction(told: Told, chance: Callable[[], float]) -> str:
    """That little is explained, and of mixed rows as much, in a sentence; "" if not."""
    least = told.speed.fit.share
    if told.speed.inside and told.speed.depth >= DISTINCT:
        return ""  # mixed rows have no such speed, 0.27 at most
    # what is round about the middle gives all detectors the same record
    if least < EXPLAINED or (least / chance()) ** 2 < NO_IMAGE:
        return ""
    return (
        f"no image explains this record: the best leaves {least:.0%} of it, and {chance():.0%} "
        "with its rows mixed. Check the order of the rows, the sampling rate, the start of the "
        "record, the units of positions and times, and whether there is more than noise"
    )


def _share_by_chance(told: Told) -> float:
    """The share that the same kind of fit leaves of the record with its rows mixed."""
    mixed = told.misfit.with_rows_mixed()
    return max(mixed.best(told.speed.value, weight=told.weight).share, 1e-300)
