"""A body of another speed of sound than the water's, by what the best image leaves unexplained.

The criterion is that of `body_criterion`, with a tenth of the weight and fits that come near their
end. Of all frequencies it has many valleys, of low ones few. So its least is looked for downhill
with the lowest quarter of frequencies, from one speed and from bodies slower and faster than the
water. Where no body makes V fall by more than 2 %, it ends there. Else it goes on with half of the
frequencies, with which it begins in space, then with all. Newton's method, by differences of
slopes, ends it. What is left for each detector beside the end gives the jackknife over sectors of
detectors at no further cost.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.optimize
from jaxtyping import Bool, Float, Int

from ..base.checks import real_array, require_positive
from ..base.choice_table import GUESSED, LIKELY, SURE
from ..geometry import BallBody, DetectorPoints, DiskBody
from ..io import Scan
from ..spherical.visible import covered_share
from .acoustics import rows_of_frame, sound_of
from .acoustics_in_space import HALF
from .angular_coverage import SEEN_TWICE, span
from .body_criterion import RATIOS, SUPPORT, WIDE, BodyFit, Through, through_bodies
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
CONTRASTS, BEST = (0.98, 1.0, 1.02, 1.04), 2  # c_1/c_2 of starts; how many of them are followed
BESIDE_ONE, LEVEL = 0.01, 4e-3  # of c_1/c_2 - 1: tried, and as small where there is no body
FELL = 0.02  # of V with the fewest frequencies, by which a body makes it fall at least
UNITS = 0.004, 0.04, 0.05, 0.002  # of T, a, the centre, c_2
LIGHT = 0.1  # of the weight: with all of it V was least 34 m/s away from the body of one scan
COLD, WARM = 60, 25  # steps of fits from zeros, and from the best image so far
# Of the way downhill: fits after which it ends, change of V over itself, units from its start
MOST, SETTLED, FARTHEST = 20, 1e-5, (25.0, np.inf, 5.0, 25.0)
SIZES = 0.6, 1.22  # least and greatest radius, over that of what sounds
FARTHER, BESIDE = 4.0, 0.5  # greatest of Newton's steps, half the width of differences, in units
EDGE = 1e-4  # of the ratio of speeds: nearer it lies at an end of what is tried
COMPARED = 100  # more steps of the two fits that are compared
FLAT = 1e-3  # curvature over the largest, below which nothing is told
GAIN, ERRORS = 0.1, 3.0  # least gain, and standard errors, from which two speeds are clear


class BodyEstimate(NamedTuple):
    """A body of another sound speed, estimated from a record.

    Attributes:
        body: the disk, or ball.
        standard_errors: of its numbers by name, the jackknife's over sectors of detectors:
            "sound_speed", "radius", "center" and, where it was not given, "water_speed"; empty
            where few frequencies already show no body: then all else is of these alone.
        one_speed: the single speed that explains most [length/time].
        share, share_of_one: of the record, that is left unexplained by two speeds and by one.
        gain: 1 - (share / share_of_one)², by which less is left.
        gain_error: its standard error; infinite of few frequencies.
        clear: whether that is clearly more than by one speed: the gain is at least 0.1 and, like
            the difference of the speeds, three standard errors, and the speeds are within what is
            tried.
        grade: "likely" where it is clear and most edges are seen from both sides, else "guessed".
    """

    body: DiskBody | BallBody
    standard_errors: dict[str, float]
    one_speed: float
    share: float
    share_of_one: float
    gain: float
    gain_error: float
    clear: bool
    grade: str

    def __str__(self) -> str:
        of = "left unexplained" if self.standard_errors else "of low frequencies left unexplained"
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
    that no body makes much less unexplained.

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
    speed, dim = choices.sound_speed, len(center)
    first = np.array([through.distance / speed, radius, *center, water_speed or speed])
    search = _Search(
        through=through,
        first=first,
        units=_each(UNITS, dim) * _each((radius / speed, radius, radius, speed), dim),
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


def _each(values: tuple[float, float, float, float], dim: int) -> Float[np.ndarray, " numbers"]:
    """For T, a, each coordinate of the centre and c_2."""
    arrival, radius, center, water = values
    return np.array([arrival, radius, *[center] * dim, water])


class _Near(NamedTuple):
    """V near its least to second order, in units of those numbers that are free.

    Attributes:
        numbers: where it is least.
        fit: there.
        gradient: (free,).
        hessian: (free, free).
        of_left: derivatives of half of what is left, (free, detectors).
    """

    numbers: Float[np.ndarray, " numbers"]
    fit: BodyFit
    gradient: Float[np.ndarray, " free"]
    hessian: Float[np.ndarray, "free free"]
    of_left: Float[np.ndarray, "free detectors"]

    def step(self) -> Float[np.ndarray, " free"]:
        """Newton's; none where V is flat."""
        curvatures, axes = np.linalg.eigh(self.hessian)
        told = curvatures > FLAT * max(float(curvatures[-1]), 1e-300)
        steps = np.where(told, -(axes.T @ self.gradient) / np.where(told, curvatures, 1.0), 0.0)
        return axes @ np.clip(steps, -FARTHER, FARTHER)

    def without(self, part: Int[np.ndarray, " part"], n: int) -> Float[np.ndarray, " free"]:
        """By how much the least moves without some of n detectors.

        What they weigh in V is half of what is left of them, to the first order: the image is
        least, so that its change counts in the second.
        """
        gradient = self.gradient - self.of_left[:, part].sum(axis=1)
        hessian = (1 - len(part) / n) * self.hessian
        return self._replace(gradient=gradient, hessian=hessian).step() - self.step()


class _Search(NamedTuple):
    """The search for the numbers of a body.

    Attributes:
        through: the criterion.
        first: numbers near which all are looked for.
        units: of all numbers.
        weight: of total variation, light.
        radius: of what sounds [length].
        good: detectors that count.
        n_free: how many of the numbers are searched for; the last is the water's speed.
        parts: of the frequencies, before all of them.
    """

    through: Through
    first: Float[np.ndarray, " numbers"]
    units: Float[np.ndarray, " numbers"]
    weight: float
    radius: float
    good: Bool[np.ndarray, " detectors"]
    n_free: int
    parts: tuple[float, ...]

    def level(self) -> tuple[Float[np.ndarray, " numbers"], BodyFit] | None:
        """The numbers of one speed, and V there, if it is least there of speeds beside; else None.

        Of bodies through which sound from the middle takes as long: to first order V falls towards
        the true one. No slope is needed, and so half as much is compiled.
        """
        tried = self._contrasts((1 - BESIDE_ONE, 1.0, 1 + BESIDE_ONE))
        fits = [self.through.without_slopes(one, self.weight, COLD) for one in tried]
        below, here, above = (fit.value for fit in fits)
        bend = below - 2 * here + above
        contrast = BESIDE_ONE * (below - above) / (2 * bend) if bend > 0 else np.inf
        return (tried[1], fits[1]) if abs(contrast) <= LEVEL else None

    def lowest_of_starts(self) -> tuple[Float[np.ndarray, " numbers"], BodyFit]:
        """Where V is least downhill from the starts, and V there."""
        ends = [self.downhill(*start) for start in self.starts()]
        return min(ends, key=lambda end: end[1].value)

    def through_frequencies(
        self, numbers: Float[np.ndarray, " numbers"], fit: BodyFit
    ) -> tuple[Float[np.ndarray, " numbers"], BodyFit]:
        """Where V is least, downhill from where it is so with the fewest; V there."""
        for search in (*map(self.low_passed, self.parts[1:]), self):
            numbers, fit = search.downhill(numbers, search.at(numbers, fit))
        return numbers, fit

    @property
    def water_is_free(self) -> bool:
        """Whether the water's speed is searched for."""
        return self.n_free == len(self.first)

    def low_passed(self, part: float) -> "_Search":
        """The search in which frequencies fade above a part of the highest one."""
        through, energy = self.through.low_passed(part)
        return self._replace(through=through, weight=energy * self.weight)

    def starts(self) -> list[tuple[Float[np.ndarray, " numbers"], BodyFit]]:
        """Numbers from which ways downhill begin, those of least V, and what it is there.

        Of a body as fast as the water, and slower and faster ones, by the water's speed that sound
        from the middle takes the time of the first numbers with, or by that time where the water's
        speed is known.
        """
        begun = [(start, self.at(start)) for start in self._contrasts(CONTRASTS)]
        return sorted(begun, key=lambda start: start[1].value)[:BEST]

    def _contrasts(self, contrasts: tuple[float, ...]) -> list[Float[np.ndarray, " numbers"]]:
        """The first numbers, but for the body's speed over that of the water."""
        arrival, radius, *_, water = self.first
        away = [self.through.distance - radius * (1 - 1 / ratio) for ratio in contrasts]
        if self.water_is_free:
            return [np.append(self.first[:-1], way / arrival) for way in away]
        return [np.append(way / water, self.first[1:]) for way in away]

    def moved(self, numbers: np.ndarray, by: np.ndarray) -> Float[np.ndarray, " numbers"]:
        """Numbers that differ by so many units in those that are free."""
        return numbers + self.units * np.concatenate([by, np.zeros(len(self.units) - self.n_free)])

    def fit(self, numbers: np.ndarray, like: BodyFit | None) -> BodyFit:
        """V after some steps from zeros, or fewer from the image of another fit."""
        start = (COLD, None) if like is None else (WARM, like.image)
        return self.through.least(numbers, self.weight, *start)

    def at(self, numbers: np.ndarray, like: BodyFit | None = None) -> BodyFit:
        """V, its slopes in units of those numbers that are free."""
        found = self.fit(numbers, like)
        return found._replace(slopes=(found.slopes * self.units)[: self.n_free])

    def downhill(
        self, numbers: Float[np.ndarray, " numbers"], begun: BodyFit
    ) -> tuple[Float[np.ndarray, " numbers"], BodyFit]:
        """Where V is least near some numbers, and what it is there.

        Args:
            begun: V at the numbers.
        """
        ends = SIZES[0] * self.radius, min(SIZES[1] * self.radius, self.through.reach / SUPPORT)
        sizes = (np.array(ends) - numbers[1]) / self.units[1]
        farthest = _each(FARTHEST, len(numbers) - 3)
        way = (self.first - numbers) / self.units
        bounds = way[:, None] + np.stack([-farthest, farthest], axis=1)
        bounds[1] = sizes
        bounds = np.stack([np.minimum(bounds[:, 0], 0.0), np.maximum(bounds[:, 1], 0.0)], axis=1)

        def at(by: np.ndarray, like: BodyFit) -> BodyFit:
            return self.at(self.moved(numbers, by), like)

        by, end = _lowest(at, begun, bounds[: self.n_free])
        return self.moved(numbers, by), end

    def one_speed(
        self, numbers: Float[np.ndarray, " numbers"]
    ) -> tuple[Float[np.ndarray, " numbers"], BodyFit]:
        """The single speed with which V is least, with sound where a body has it; V there.

        From the one with which sound from the middle takes as long as through the body.

        Args:
            numbers: of the body.
        """
        distance = self.through.distance
        speed = distance / numbers[0]

        def alike(by: np.ndarray) -> Float[np.ndarray, " numbers"]:
            c = speed + self.units[-1] * by[0]
            return np.array([distance / c, *numbers[1:-1], c])

        def at(by: np.ndarray, like: BodyFit | None) -> BodyFit:
            fit = self.fit(alike(by), like)
            slope = fit.slopes[-1] - fit.slopes[0] * distance / alike(by)[-1] ** 2
            return fit._replace(slopes=self.units[-1:] * slope)

        bounds = FARTHEST[-1] * np.array([[-1.0, 1.0]])
        by, end = _lowest(at, at(np.zeros(1), None), bounds)
        return alike(by), end

    def newton(self, numbers: Float[np.ndarray, " numbers"], fit: BodyFit) -> _Near:
        """V near its least, to which a step is taken if V falls by it.

        By differences of slopes to both sides.
        """
        fit = self.at(numbers, fit)
        sides = BESIDE * np.eye(self.n_free)
        pairs = [[self.at(self.moved(numbers, by), fit) for by in (x, -x)] for x in sides]
        rows = np.array([ahead.slopes - behind.slopes for ahead, behind in pairs]) / (2 * BESIDE)
        of_left = np.array([ahead.left - behind.left for ahead, behind in pairs]) / (4 * BESIDE)
        near = _Near(numbers, fit, fit.slopes, (rows + rows.T) / 2, of_left)
        there = self.moved(numbers, near.step())
        ahead = self.at(there, fit)
        if not ahead.value < fit.value:
            return near
        return near._replace(numbers=there, fit=ahead, gradient=ahead.slopes)


def _lowest(
    at: Callable[[np.ndarray, BodyFit], BodyFit],
    begun: BodyFit,
    bounds: Float[np.ndarray, "free 2"],
) -> tuple[Float[np.ndarray, " free"], BodyFit]:
    """Where V is least of what is tried on a way from zero downhill, and what it is there.

    Args:
        at: V and its slopes, from the image of another fit.
        begun: V at zero.
        bounds: of the way.
    """
    best = np.zeros(len(bounds)), begun

    def height(by: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal best
        found = at(by, best[1])
        best = min(best, (by.copy(), found), key=lambda one: one[1].value)
        return found.value, found.slopes

    most = {"maxfun": MOST, "ftol": SETTLED}
    scipy.optimize.minimize(
        height, best[0], jac=True, method="L-BFGS-B", bounds=bounds, options=most
    )
    return best


def _hardly_less(
    search: _Search,
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
    search: _Search, near: _Near, alike: Float[np.ndarray, " numbers"], by_one: BodyFit
) -> BodyEstimate:
    """The body of least, its errors by leaving out sectors, and how it compares with one speed.

    Args:
        near: the least by two speeds.
        alike, by_one: the numbers of the best single speed, and V there.
    """
    through, good = search.through, search.good
    points = np.asarray(through.place.curve.points)[: len(good)] - through.center
    around = np.argsort(np.arctan2(points[:, 1], points[:, 0]), kind="stable")
    sectors = np.array_split(around[good[around]], SECTORS)
    others = [good & ~np.isin(np.arange(len(good)), part) for part in sectors]
    ways = [near.without(part, int(good.sum())) for part in sectors]
    body = through.body(near.numbers)
    each = [through.body(search.moved(near.numbers, by)) for by in ways]
    ends = (near.numbers, near.fit), (alike, by_one)
    two, one = (through.least(at, search.weight, COMPARED, fit.image) for at, fit in ends)

    def error(number: str) -> float:
        values = np.array([np.atleast_1d(getattr(one, number)) for one in each])
        return float(np.linalg.norm([jackknife(list(column)) for column in values.T]))

    names = "sound_speed", "radius", "center", *(["water_speed"] if search.water_is_free else [])
    gains = [1 - two.left[kept].sum() / one.left[kept].sum() for kept in others]
    gain, gain_error = 1 - (two.share / one.share) ** 2, jackknife(gains)
    ratios = [float(one.speed_ratio) for one in each]
    apart = abs(float(body.speed_ratio) - 1) > ERRORS * jackknife(ratios)
    inside = RATIOS[0] + EDGE < float(body.speed_ratio) < RATIOS[1] - EDGE
    clear = bool(inside and apart and gain > max(GAIN, ERRORS * gain_error))
    return BodyEstimate(
        body=body,
        standard_errors={name: error(name) for name in names},
        one_speed=float(alike[-1]),
        share=two.share,
        share_of_one=one.share,
        gain=gain,
        gain_error=gain_error,
        clear=clear,
        grade=LIKELY if clear and _seen_twice(through, good) else GUESSED,
    )


def _seen_twice(through: Through, good: Bool[np.ndarray, " detectors"]) -> bool:
    """Whether detectors see most edges from both sides."""
    curve = through.place.curve
    if isinstance(curve, DetectorPoints):
        return covered_share(curve) >= HALF
    points = np.asarray(curve.points)[: len(good)][good]
    return bool(span(points, through.center) >= SEEN_TWICE)
