"""Speed of sound and acoustic model of a scan in the plane, and what contradicts them.

All by one criterion, `misfit`. The bounds here were set on scans of `benchmarks/scans` with numbers
below 300, small size.
"""

import warnings
from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..base.checks import real_array
from ..base.choice_table import GUESSED, LIKELY
from ..geometry import ArcFit, detector_curve
from ..io import Scan
from ..steps import AccuracyWarning, Contradiction
from .acquisition import FASTEST, SLOWEST, arc_through, facts_of, nominal_water_speed
from .angular_coverage import SEEN_TWICE, span
from .arrival_times import early_or_late
from .choices import Choices
from .estimate import Estimate, Source
from .frames import shifted_times
from .medium import single_speed
from .misfit import Misfit, Sound, misfit_of
from .parameters import Parameters
from .preprocess import RIM, Acquisition
from .region import circle_without_detectors, free_circle
from .sound_speed import STEP, Least, least_share
from .speed_found import UNSURE

FEWEST_SAMPLES = 64  # in which sound passes
LATE = 1.0 / 13  # of the arrival from the middle: a start may be wrong by that
# ends of the speeds for which a record is cut, over nominal
SLOWEST_SOUGHT, FASTEST_SOUGHT = SLOWEST * (1 - LATE), FASTEST * (1 + LATE)
CLEARLY = 0.5  # share² that the right model must spare, to be likely
MUCH_LESS = 0.3  # and another speed than the file's
EXPLAINED = 0.4  # share, below which an image explains most of a record
NO_IMAGE = 0.88  # share² over that of rows in another order, from which no image explains
HARDLY = 0.5  # of that ratio, from which other speeds than the file's are tried
STRETCHES = np.arange(SLOWEST, FASTEST + STEP / 2, STEP)  # speeds that are tried, over nominal
WHAT = {"2d": "two-dimensional waves", "in-plane": "sound in the plane"}
OPEN = ("sound_speed", "model")  # what images tell
NO_IMAGE_SAYS = (
    "no image explains this record: the best leaves {least:.0%} of it, and {chance:.0%} with its "
    "rows mixed. Check the order of the rows, the sampling rate, the start of the record, the "
    "units of positions and times, and whether there is more than noise"
)


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
    ends: tuple[float, float] | None = None,
) -> Float[np.ndarray, " speeds"] | None:
    """What share of a frame the best image leaves unexplained at each speed of sound.

    Args:
        scan, choices: in the plane, of pressure.
        frame: rows as in the file.
        speeds: (speeds,) [length/time].
        ends: least and greatest that could be asked for; by default of these [length/time].

    Returns:
        ||record of the image - record|| / ||record||, see `misfit`; None of a record that is too
        short to tell.
    """
    sound, speed = sound_of(scan, choices, frame), choices.sound_speed
    if sound is None:
        return None
    ends = ends or (float(min(speeds)), float(max(speeds)))
    misfit = misfit_of(sound, choices.model, ends)
    weight = misfit.best(speed).weight
    return np.array([misfit.best(float(c), weight=weight).share for c in speeds])


def sound_of(
    scan: Scan, choices: Choices, frame: Float[np.ndarray, "rows samples"]
) -> Sound | None:
    """The part of a frame that counts, once choices are made; None of one that is too short.

    Args:
        scan, choices: in the plane, of pressure.
        frame: rows as in the file.

    Raises:
        ValueError: for integrals, a frame of another shape, and NaN in the rows that are used.
    """
    facts, rows = facts_of(scan), list(choices.channels)
    times = shifted_times(scan, choices)
    if times is None:
        raise ValueError("the speed of sound is of pressure records, and the data are integrals.")
    used = rows_of_frame(scan, frame, rows)
    points = facts.points[rows]
    arc = arc_through(points) or circle_without_detectors(points, choices.region_center)
    good = np.ones(len(rows), bool)
    begin, speed = 2 * choices.dead_time, choices.sound_speed
    return sound_within(arc, points, used, times, good, begin, speed)


def rows_of_frame(
    scan: Scan, frame: np.ndarray, rows: np.ndarray | list[int]
) -> Float[np.ndarray, "used samples"]:
    """Some rows of a frame.

    Raises:
        ValueError: for a frame of another shape than the file's, and NaN in these rows.
    """
    size = scan.n_detectors, scan.n_samples
    if np.shape(frame) != size:
        raise ValueError(f"frame has shape {np.shape(frame)}, expected {size}, as in the file.")
    return np.asarray(real_array("frame", np.asarray(frame)[rows], None))


def tell_acoustics(record: Acquisition, p: Parameters) -> Parameters:
    """Model, sound speed and start estimated from the record, with a warning of contradictions.

    Of records of a scanner's size, by the best image of all that may sound within the detectors: of
    others nothing is estimated. Nor where sound arrives when the positions do not allow it.
    """
    said = early_or_late(record, float(p["sound_speed"]))
    if said:
        warnings.warn(f"{said}.", Contradiction, stacklevel=5)
        return p.doubted(said, OPEN)
    if nominal_water_speed(record.facts.units) is None:
        return p
    arc, whole = free_circle(record.facts, p), record.facts.arc
    speed = single_speed(None if whole is None else whole.radius, p)
    sound = sound_within(
        arc, record.points, record.frame, record.times, record.good, record.begin, speed
    )
    if sound is None:
        return p.settled("the record is too short to tell it", OPEN)
    return _told_by_images(sound, record, p, speed)


def _told_by_images(sound: Sound, record: Acquisition, p: Parameters, nominal: float) -> Parameters:
    """By the best images of the record.

    Args:
        nominal: the speed of the file, the one given, or water's; of two the single one that comes
            nearest [length/time].
    """
    seen = span(np.asarray(sound.curve.points)[sound.good], sound.center)
    twice = seen >= SEEN_TWICE
    unknown = p.nominal("sound_speed") and twice
    models = list(WHAT) if p.nominal("model") and twice else [str(p["model"])]
    if p.nominal("model") and not twice:
        p = _with_model(p, _kept_model(p.estimates["model"], seen))
    told = [_told(sound, model, nominal, sought=unknown) for model in models]
    best = told[0]
    if len(told) > 1:
        # each with the weight that goes with it: those of water's speed are too large
        shares = [each.misfit.best(each.speed.value).share for each in told]
        best, other = (told[k] for k in np.argsort(shares))
        p = _with_model(p, _better_model(best, other, min(shares), max(shares)))
    chance = cache(partial(_share_by_chance, best))
    told_by_user = p.gives("sound_speed") or p.gives("water_speed")
    of_file = not told_by_user and not p.nominal("sound_speed")
    if of_file and twice and (best.speed.fit.share / chance()) ** 2 > HARDLY:
        best = _told(sound, best.model, nominal, sought=True)
        p = _compared(p, best, nominal)
    if _contradicted(best, chance):
        data = {"least": best.speed.fit.share, "chance": chance()}
        warnings.warn(f"{NO_IMAGE_SAYS.format(**data)}.", Contradiction, stacklevel=6)
        return p.doubted(NO_IMAGE_SAYS, OPEN if twice else (), **data)
    return p.with_(sound_speed=_speed(best.speed, p)) if unknown else p


def _told(sound: Sound, model: str, nominal: float, *, sought: bool) -> Told:
    """The best image, at the speed of which least is unexplained, or at the nominal one.

    Args:
        sought: whether the speed is.
    """
    misfit = misfit_of(sound, model, (SLOWEST_SOUGHT * nominal, FASTEST_SOUGHT * nominal))
    first = misfit.best(nominal)
    if not sought:
        return Told(model, misfit, first.weight, Least(nominal, np.inf, 0.0, first))
    fit_at = partial(misfit.best, weight=first.weight)
    speed = least_share(fit_at, nominal * STRETCHES, sound.good)
    return Told(model, misfit, first.weight, speed)


def _better_model(best: Told, other: Told, least: float, most: float) -> Estimate:
    """The model by which the best image leaves less unexplained."""
    clear = (least / most) ** 2 < 1 - CLEARLY
    why = (
        f"the best image leaves {{least:.0%}} of the record unexplained as {WHAT[best.model]}, "
        f"{{most:.0%}} as {WHAT[other.model]}"
    )
    grade, data = LIKELY if clear else GUESSED, {"least": least, "most": most}
    return Estimate(best.model, why, grade, Source.ESTIMATE, data=data)


def _kept_model(model: Estimate, seen: float) -> Estimate:
    """The model that the record alone spoke for: seen once, edges fit either."""
    why = "; from {seen:.0f} degrees images do not tell"
    return model.but(why, GUESSED, seen=seen)._replace(source=Source.ESTIMATE)


def _with_model(p: Parameters, model: Estimate) -> Parameters:
    if model.value == "2d":
        why = model.sentence(p.units)
        warnings.warn(
            f"the record is taken for two-dimensional waves: {why}. If its detectors are focused "
            "into the plane, it needs model in-plane.",
            AccuracyWarning,
            7,
        )
    return p.with_(model=model)


def _speed(speed: Least, p: Parameters) -> Estimate:
    """Where least is unexplained; water's where that is at an end of the range."""
    if not speed.inside:
        why = "water's: no speed within 10 % of it leaves least unexplained"
        return Estimate(p["sound_speed"], why, GUESSED, Source.ESTIMATE)
    error = speed.standard_error
    sure = speed.distinct and error <= UNSURE * speed.value
    sure = sure and p.estimates["model"].grade != GUESSED
    why = "the best image leaves {share:.0%} unexplained, least of all speeds"
    if not sure:
        why += ", but by {depth:.0%} only"
    data = {"share": speed.fit.share, "depth": max(speed.depth, 0.0)}
    grade = LIKELY if sure else GUESSED
    return Estimate(speed.value, f"{why}; none in the file", grade, Source.ESTIMATE, error, data)


def _compared(p: Parameters, told: Told, nominal: float) -> Parameters:
    """Doubt the speed of the file where another one leaves much less unexplained."""
    speed, own = told.speed, told.misfit.best(nominal, weight=told.weight)
    spared = 1 - (speed.fit.share / max(own.share, 1e-300)) ** 2
    if not (speed.inside and abs(speed.value / nominal - 1) > UNSURE and spared > MUCH_LESS):
        return p
    why = "; but at {better:speed} {spared:.0%} less is unexplained: try that"
    of_file = p.estimates["sound_speed"].but(why, GUESSED, better=speed.value, spared=spared)
    return p.replaced(sound_speed=of_file)


def _contradicted(told: Told, chance: Callable[[], float]) -> bool:
    """Whether little is explained, and of mixed rows as much."""
    least = told.speed.fit.share
    if told.speed.distinct:
        return False  # mixed rows have no such speed, 0.27 at most
    # what is round about the middle gives all detectors the same record
    return least >= EXPLAINED and (least / chance()) ** 2 >= NO_IMAGE


def _share_by_chance(told: Told) -> float:
    """The share that the same kind of fit leaves of the record with its rows mixed."""
    mixed = told.misfit.with_rows_mixed()
    return max(mixed.best(told.speed.value, weight=told.weight).share, 1e-300)
