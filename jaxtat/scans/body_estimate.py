"""A body of another speed of sound than the water's, by what the best image leaves unexplained.

The criterion is that of `body_criterion`, with a tenth of the weight and fits that come near their
end. Of all frequencies it has many valleys, of low ones few. So its least is looked for downhill
with the lowest quarter of frequencies, from one speed and from bodies slower and faster than the
water. Where no body makes V fall by more than 2 %, it ends there. Else it goes on with half of the
frequencies, with which it begins in space, then with all. Newton's method, by differences of
slopes, ends it. What is left for each detector beside the end gives the jackknife over sectors of
detectors at no further cost. An ellipse is looked for from what sounds, and from a clear disk too,
with the low frequencies that coarse pixels hold.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..base.checks import real_array, require_positive
from ..base.choice_table import GUESSED, LIKELY, SURE
from ..geometry import Body, DetectorPoints
from ..io import Scan
from ..spherical.visible import covered_share
from .acoustics import rows_of_frame, sound_of
from .acoustics_in_space import HALF
from .angular_coverage import SEEN_TWICE, span
from .body_criterion import RATIOS, SUPPORT, WIDE, BodyFit, Through, through_bodies
from .body_search import BodySearch, NearLeast, units_of
from .choices import Choices
from .misfit import Sound
from .misfit_in_space import sound_in_space
from .preprocess import AcquisitionInSpace
from .region import MARGIN, MARGIN_IN_SPACE
from .sound_speed import SECTORS
from .space import facts_in_space
from .speed_found import jackknife

SMALLER = 0.75  # of the radius: what sounds is a body beside the middle
AROUND = 1.15  # a body over what sounds
OFF = 1.005  # of the speed at which a weight is found: of small weights fits come to no end
PARTS, PARTS_IN_SPACE = (0.25, 0.5), (0.5,)  # of the frequencies, before all of them
LISTENED = 100  # detectors in space, at most
FELL = 0.02  # of V with the fewest frequencies, by which a body makes it fall at least
LIGHT = 0.1  # of the weight: with all of it V was least 34 m/s away from the body of one scan
EDGE = 1e-4  # of the ratio of speeds: nearer it lies at an end of what is tried
NEAR = 5e-3  # change of V over itself with which ways to an ellipse end: Newton's step goes on
COMPARED = 100  # more steps of the two fits that are compared
GAIN, ERRORS = 0.1, 3.0  # least gain, and standard errors, from which two speeds are clear


class BodyEstimate(NamedTuple):
    """A body of another sound speed, estimated from a record.

    Attributes:
        body: the disk, ball, or ellipse.
        standard_errors: of its numbers by name, the jackknife's over sectors of detectors:
            "sound_speed", "radius" (of an ellipse that of the circle of its area), "center", of an
            ellipse "half_axes" and "angle", and, where it was not given, "water_speed"; empty where
            few frequencies already show no body: then all else is of these alone.
        half_axes, angle: of an ellipse, the longer one first [length] and its direction [degrees];
            None of a disk or ball.
        one_speed: the single speed that explains most [length/time].
        share, share_of_one: of the record, that is left unexplained by two speeds and by one.
        gain: 1 - (share / share_of_one)², by which less is left.
        gain_error: its standard error; infinite of few frequencies.
        clear: whether that is clearly more than by one speed: the gain is at least 0.1 and, like
            the difference of the speeds, three standard errors, and the speeds are within what is
            tried.
        grade: "likely" where it is clear and most edges are seen from both sides, else "guessed".
    """

    body: Body
    standard_errors: dict[str, float]
    one_speed: float
    share: float
    share_of_one: float
    gain: float
    gain_error: float
    clear: bool
    grade: str
    half_axes: tuple[float, float] | None = None
    angle: float | None = None

    def __str__(self) -> str:
        few = not self.standard_errors or self.half_axes is not None
        of = "of low frequencies left unexplained" if few else "left unexplained"
        compared = f"{self.share:.1%} {of}, {self.share_of_one:.1%} by one speed"
        return compared if self.clear else f"{compared}: not clearly less"


def estimate_body(
    scan: Scan,
    choices: Choices,
    frame: Float[np.ndarray, "rows samples"],
    *,
    water_speed: float | None = None,
    asked: bool = True,
) -> BodyEstimate | None:
    """The disk, or ball, of another speed of sound by which an image explains most of a frame.

    Takes about 100 fits of a coarse image with derivatives, 40 where low frequencies already show
    that no body makes much less unexplained. `estimate_ellipse` looks for an ellipse too.

    Args:
        scan, choices: of pressure; the choices with one speed of sound, of
            ``choose(scan, two_speeds=False)``, by which model, region and channels are known.
        frame: rows as in the file.
        water_speed: c_2, if it is known [length/time].
        asked: whether someone asked for it; else the search ends at once where bodies of other
            speeds, as large as what sounds and about its middle, explain low frequencies less.

    Returns:
        The body, and whether it explains clearly more than one speed does; None of a record that
        is too short to tell.

    Raises:
        ValueError: for choices of two speeds, integrals, a speed that is not above zero, and
            elements in space that have a size.
    """
    if choices.water_speed is not None:
        raise ValueError("choices have two speeds of sound already, expected choices of one.")
    if water_speed is not None:
        require_positive("water_speed", real_array("water_speed", water_speed, ()))
    in_space = choices.in_space
    sound = (_heard_in_space if in_space else sound_of)(scan, choices, frame)
    if sound is None:
        return None
    through, center, radius, weight = _about_what_sounds(sound, choices)
    speed = choices.sound_speed
    first = np.array([through.distance / speed, radius, *center, water_speed or speed])
    search = BodySearch(
        through=through,
        first=first,
        units=units_of(through, radius, speed),
        weight=LIGHT * weight,
        radius=radius,
        good=sound.good,
        n_free=len(first) - (water_speed is not None),
        parts=PARTS_IN_SPACE if in_space else PARTS,
    )
    first_look = search.low_passed(search.parts[0])
    if not asked and (level := first_look.level()):
        return _hardly_less(first_look, *level, *level)
    end = first_look.lowest_of_starts()
    by_one = first_look.one_speed(end[0])
    if end[1].value > (1 - FELL) * by_one[1].value:
        return _hardly_less(first_look, *end, *by_one)
    two = search.newton(*search.through_frequencies(*end))
    return _estimate(search, two, *search.one_speed(two.numbers))


def _heard_in_space(scan: Scan, choices: Choices, frame: np.ndarray) -> Sound | None:
    """What some of the detectors recorded, whose elements have no size.

    Raises:
        ValueError: for elements of a size, integrals, a frame of another shape, and NaN in it.
    """
    facts = facts_in_space(scan, choices.channels)
    if facts.times is None:
        raise ValueError("the data are integrals over spheres, and a body is told by pressure.")
    used = rows_of_frame(scan, frame, facts.order)
    if facts.detectors.element_radius is not None:
        raise ValueError(
            "two speeds of a scan in space are of elements without a size, and the file has one: "
            "give the speeds and the radius of a ball about the middle of the detectors."
        )
    record = AcquisitionInSpace(scan, facts, used)
    return sound_in_space(record, choices, WIDE * choices.region_radius, LISTENED)


def _about_what_sounds(
    sound: Sound, choices: Choices
) -> tuple[Through, Float[np.ndarray, " space"], float, float]:
    """The criterion, the disk of the sources, that of the region or a much smaller one; a weight.

    A region that was given stays: a body may be silent near its rim.
    """
    margin = MARGIN_IN_SPACE if choices.in_space else MARGIN
    center, radius = np.array(choices.region_center), choices.region_radius / margin
    through = through_bodies(sound, choices, center, radius)
    image, weight = through.by_one(OFF * choices.sound_speed)
    seen = through.sounding(image)
    if choices.grade("region_radius") == SURE or seen[1] > SMALLER * radius:
        return through, center, radius, float(weight)
    center, radius = seen[0], AROUND * seen[1]
    through = through_bodies(sound, choices, center, radius)
    return through, center, radius, float(through.by_one(OFF * choices.sound_speed)[1])


def estimate_ellipse(
    scan: Scan,
    choices: Choices,
    frame: Float[np.ndarray, "rows samples"],
    disk: BodyEstimate,
    *,
    water_speed: float | None = None,
) -> BodyEstimate:
    """The ellipse of another speed of sound by which an image explains most.

    The search begins at what sounds by one speed, and at the disk where that explains clearly more
    than one speed. Takes 60 to 100 fits of an image of 25 x 25 pixels with derivatives, for each of
    which the equations at the outline are solved.

    Args:
        scan, choices, frame, water_speed: as of `estimate_body`, in the plane.
        disk: what that told.

    Returns:
        The ellipse where it explains clearly more than one speed, and than a clear disk; else the
        disk. Shares of an ellipse are of those frequencies that coarse pixels hold.

    Raises:
        ValueError: as `estimate_body`, and for detectors in space.
    """
    if choices.in_space:
        raise ValueError("the detectors lie in space, which tell a ball: use estimate_body.")
    sound = sound_of(scan, choices, frame)
    if sound is None:
        return disk
    search = _search_for_ellipses(sound, choices, disk, water_speed)
    if disk.clear:
        numbers = search.through.numbers(disk.body)  # type: ignore[arg-type]
        best_disk = search.downhill(numbers, search.at(numbers), disks=True)
        near = search.newton(*search.lowest_of_starts(best_disk))
        gain, gain_error, *_ = _gain(search, (near.numbers, near.fit), best_disk)
        if not gain > max(GAIN, ERRORS * gain_error):
            return disk
    else:
        near = search.newton(*search.lowest_of_starts())
    found = _estimate(search, near, *search.one_speed(near.numbers))
    return found if found.clear else disk


def _search_for_ellipses(
    sound: Sound, choices: Choices, disk: BodyEstimate, water_speed: float | None
) -> BodySearch:
    """Begun at the outline of what sounds by one speed; pixels hold a clear disk too.

    The way is far, and ends well before the least: Newton's step goes on.
    """
    center, radius, stretch, about = _outline_of_what_sounds(sound, choices)
    if disk.clear:
        off = float(np.linalg.norm(np.asarray(disk.body.center) - center))
        about = max(about, float(disk.body.radius) + off)
    speed = choices.sound_speed
    through = through_bodies(sound, choices, center, about, ellipses=True)
    first = np.array([through.distance / speed, radius, *center, *stretch, water_speed or speed])
    return BodySearch(
        through=through,
        first=first,
        units=units_of(through, about, first[-1]),
        weight=LIGHT * float(through.by_one(OFF * disk.one_speed)[1]),
        radius=about,
        good=sound.good,
        n_free=len(first) - (water_speed is not None),
        parts=(),  # coarse pixels hold low frequencies alone
        settled=NEAR,
    )


def _outline_of_what_sounds(
    sound: Sound, choices: Choices
) -> tuple[Float[np.ndarray, " 2"], float, Float[np.ndarray, " 2"], float]:
    """Centre, radius and stretch of an ellipse with the moments of an image by one speed.

    The last is a radius around it, for the pixels. A region that was given stays: a body may be
    silent near its rim.
    """
    center, radius = np.array(choices.region_center), choices.region_radius / MARGIN
    if choices.grade("region_radius") == SURE:
        return center, radius, np.zeros(2), radius
    through = through_bodies(sound, choices, center, radius)
    image, _ = through.by_one(OFF * choices.sound_speed)
    center, radius, stretch = through.outline(image)
    return center, radius, stretch, AROUND * radius


def _hardly_less(
    search: BodySearch,
    numbers: Float[np.ndarray, " numbers"],
    fit: BodyFit,
    alike: Float[np.ndarray, " numbers"],
    by_one: BodyFit,
) -> BodyEstimate:
    """A body with which few frequencies are explained hardly better: it is not looked for further.

    Args:
        numbers, fit: the least by two speeds.
        alike, by_one: the numbers of the best single speed, and V there.
    """
    return BodyEstimate(
        body=search.through.body(numbers),
        standard_errors={},
        one_speed=float(alike[-1]),
        share=fit.share,
        share_of_one=by_one.share,
        gain=1 - (fit.share / by_one.share) ** 2,
        gain_error=np.inf,
        clear=False,
        grade=GUESSED,
    )


def _estimate(
    search: BodySearch, near: NearLeast, alike: Float[np.ndarray, " numbers"], by_one: BodyFit
) -> BodyEstimate:
    """The body of least, its errors by leaving out sectors, and how it compares with one speed.

    Args:
        near: the least by two speeds.
        alike, by_one: the numbers of the best single speed, and V there.
    """
    through = search.through
    ways = [near.without(part, int(search.good.sum())) for part in _sectors(search)]
    moved = [search.moved(near.numbers, by) for by in ways]
    body, each = through.body(near.numbers), [_by_name(search, numbers) for numbers in moved]
    gain, gain_error, two, one = _gain(search, (near.numbers, near.fit), (alike, by_one))

    told = _by_name(search, near.numbers)

    def error(name: str) -> float:
        values = np.array([np.atleast_1d(one[name]) for one in each])
        if name == "angle":  # of an axis: a half turn is none
            values = (values - told[name] + 90.0) % 180.0
        return float(np.linalg.norm([jackknife(list(column)) for column in values.T]))

    ratios = [one["sound_speed"] / at[-1] for one, at in zip(each, moved, strict=True)]
    apart = abs(float(body.speed_ratio) - 1) > ERRORS * jackknife(ratios)
    inside = RATIOS[0] + EDGE < float(body.speed_ratio) < RATIOS[1] - EDGE
    axes = told.get("half_axes")
    inside &= axes is None or SUPPORT * axes[0] <= through.reach  # else beyond the pixels
    clear = bool(inside and apart and gain > max(GAIN, ERRORS * gain_error))
    return BodyEstimate(
        body=body,
        standard_errors={name: error(name) for name in told},
        one_speed=float(alike[-1]),
        share=two,
        share_of_one=one,
        gain=gain,
        gain_error=gain_error,
        clear=clear,
        grade=LIKELY if clear and _seen_twice(through, search.good) else GUESSED,
        half_axes=None if axes is None else (float(axes[0]), float(axes[1])),
        angle=told.get("angle"),
    )


def _by_name(search: BodySearch, numbers: Float[np.ndarray, " numbers"]) -> dict[str, Any]:
    """What is told of a body, by name."""
    body, dimension = search.through.body(numbers), len(search.through.center)
    told: dict[str, Any] = {
        "sound_speed": float(body.sound_speed),
        "radius": numbers[1],
        "center": numbers[2 : 2 + dimension],
    }
    if search.through.n_stretch:
        stretch = numbers[2 + dimension : -1]
        told["half_axes"] = numbers[1] * np.exp(np.hypot(*stretch) * np.array([1.0, -1.0]))
        told["angle"] = float(np.rad2deg(np.arctan2(stretch[1], stretch[0]) / 2))
    return told | ({"water_speed": numbers[-1]} if search.water_is_free else {})


def _gain(
    search: BodySearch,
    two: tuple[Float[np.ndarray, " numbers"], BodyFit],
    one: tuple[Float[np.ndarray, " numbers"], BodyFit],
) -> tuple[float, float, float, float]:
    """By how much less numbers leave than others, its standard error, and both shares.

    Args:
        two, one: numbers, and a fit there that may not have come to its end.
    """
    fits = [search.through.least(at, search.weight, COMPARED, fit.image) for at, fit in (two, one)]
    everyone = np.arange(len(search.good))
    others = [search.good & ~np.isin(everyone, part) for part in _sectors(search)]
    gains = [1 - fits[0].left[kept].sum() / fits[1].left[kept].sum() for kept in others]
    least, most = (fit.share for fit in fits)
    return 1 - (least / most) ** 2, jackknife(gains), least, most


def _sectors(search: BodySearch) -> list[Int[np.ndarray, " part"]]:
    """Detectors that count, by azimuth about the body."""
    good = search.good
    points = np.asarray(search.through.place.curve.points)[: len(good)] - search.through.center
    around = np.argsort(np.arctan2(points[:, 1], points[:, 0]), kind="stable")
    return np.array_split(around[good[around]], SECTORS)


def _seen_twice(through: Through, good: Bool[np.ndarray, " detectors"]) -> bool:
    """Whether detectors see most edges from both sides."""
    curve = through.place.curve
    if isinstance(curve, DetectorPoints):
        return covered_share(curve) >= HALF
    points = np.asarray(curve.points)[: len(good)][good]
    return bool(span(points, through.center) >= SEEN_TWICE)
