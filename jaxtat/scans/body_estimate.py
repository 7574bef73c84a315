"""A body of another speed of sound than the water's, by what the best image leaves unexplained.

The criterion is that of `body_criterion`. Least is looked for along lines first, by fits that end
early. From the best two of where they end, one speed, and bodies slower and faster than the water,
the way goes downhill in all numbers at once, with a tenth of the weight and fits that come near
their end; Newton's method, by differences of slopes, ends it. What is left is known for each
detector, and so are its derivatives: the jackknife over sectors of detectors costs nothing.
"""

from typing import NamedTuple

import numpy as np
import scipy.optimize
from jaxtyping import Bool, Float

from ..base.checks import real_array, require_positive
from ..base.choice_table import GUESSED, LIKELY, SURE
from ..geometry import DiskBody
from ..io import Scan
from .acoustics import sound_of
from .angular_coverage import SEEN_TWICE, span
from .body_criterion import RATIOS, SUPPORT, BodyFit, Through, through_bodies
from .choices import Choices
from .misfit import Fit, Sound
from .region import MARGIN
from .sound_speed import SECTORS, least_share
from .speed_found import jackknife

SMALLER = 0.75  # of the radius: what sounds is a body beside the middle
AROUND = 1.15  # a body over what sounds
OFF = 1.005  # of the speed at which a weight is found: of small weights fits come to no end
OF_ONE = np.arange(-3, 4) / 150  # single speeds over the one that is chosen, less 1
OF_WATER = np.arange(-6, 7) / 333  # the water's over that, less 1
OF_ARRIVAL = 0.005 * np.arange(-2, 3)  # T, over the time through the radius
OF_RADIUS = 0.06 * np.arange(-3, 4)  # over that before, less 1
OF_CENTER = 0.05 * np.arange(-2, 3)  # over the radius
PASSES = 0, 1, 2, 3, 0, 1, 2, 3  # numbers along which lines run, one after the other
CONTRASTS, BEST = (0.98, 1.02, 1.04), 2  # c_1/c_2 of starts; how many of them are followed
UNITS = np.array([0.004, 0.04, 0.05, 0.05, 0.002])  # of (T, a, x, y, c_2)
LIGHT = 0.1  # of the weight: with all of it V was least 34 m/s away from the body of one scan
COLD, WARM = 60, 25  # steps of fits from zeros, and from the best image so far
# Of the way downhill: fits after which it ends, change of V over itself, units from its start
MOST, SETTLED, FARTHEST = 20, 1e-5, np.array([25.0, np.inf, 5.0, 5.0, 25.0])
SIZES = 0.6, 1.22  # least and greatest radius, over that of what sounds
# Of Newton's method: steps, the step that ends it, the greatest one, and the half width of
# differences of slopes, in units
ROUNDS, ARRIVED, FARTHER, HALF = 4, 0.2, 4.0, 0.5
EDGE = 1e-4  # of the ratio of speeds: nearer it lies at an end of what is tried
COMPARED = 200  # steps of the two fits that are compared
FLAT = 1e-3  # curvature over the largest, below which nothing is told
GAIN, ERRORS = 0.1, 3.0  # least gain, and standard errors, from which two speeds are clear


class BodyEstimate(NamedTuple):
    """A body of another sound speed, estimated from a record.

    Attributes:
        body: the disk.
        standard_errors: of its numbers by name, the jackknife's over sectors of detectors:
            "sound_speed", "radius", "center" and, where it was not given, "water_speed".
        one_speed: the single speed that explains most [length/time].
        share, share_of_one: of the record, that is left unexplained by two speeds and by one.
        gain: 1 - (share / share_of_one)², by which less is left.
        gain_error: its standard error.
        clear: whether that is clearly more than by one speed: the gain is at least 0.1 and, like
            the difference of the speeds, three standard errors, and the speeds are within what is
            tried.
        grade: "likely" where it is clear and most edges are seen from both sides, else "guessed".
    """

    body: DiskBody
    standard_errors: dict[str, float]
    one_speed: float
    share: float
    share_of_one: float
    gain: float
    gain_error: float
    clear: bool
    grade: str

    def __str__(self) -> str:
        compared = f"{self.share:.1%} left unexplained, {self.share_of_one:.1%} by one speed"
        return compared if self.clear else f"{compared}: not clearly less"


def estimate_body(
    scan: Scan,
    choices: Choices,
    frame: Float[np.ndarray, "rows samples"],
    *,
    water_speed: float | None = None,
) -> BodyEstimate | None:
    """The disk of another speed of sound by which an image explains most of a frame.

    Takes some 100 short fits of a coarse image, and 50 to 100 with derivatives.

    Args:
        scan, choices: in the plane, of pressure; the choices with one speed of sound, by which
            model, region and channels are known.
        frame: rows as in the file.
        water_speed: c_2, if it is known [length/time].

    Returns:
        The body, and whether it explains clearly more than one speed does; None of a record that
        is too short to tell.

    Raises:
        ValueError: for choices of two speeds, circular integrals, and a speed that is not above
            zero.
    """
    if choices.water_speed is not None:
        raise ValueError("choices have two speeds of sound already, expected choices of one.")
    if water_speed is not None:
        require_positive("water_speed", real_array("water_speed", water_speed, ()))
    sound = sound_of(scan, choices, frame)
    if sound is None:
        return None
    good, nominal = sound.good, choices.sound_speed
    through, center, radius = _about_what_sounds(sound, choices)
    weight = through.best(through.one(OFF * nominal), None).weight
    singles = nominal * (1 + OF_ONE)

    def single(speed: float, *, steps: int) -> Fit:
        return through.best(through.one(speed), weight, steps)

    one = least_share(single, singles, good).value
    first = np.array([through.distance / one, radius, *center, water_speed or one])
    units = UNITS * np.array([radius / nominal, radius, radius, radius, nominal])
    search = _Search(through, units, weight, radius, good, 4 if water_speed else 5)
    ends = [search.downhill(*start) for start in search.starts(first)]
    nearest = search.newton(*min(ends, key=lambda end: end[1].value))
    return _estimate(search, *nearest, one)


def _about_what_sounds(
    sound: Sound, choices: Choices
) -> tuple[Through, Float[np.ndarray, "2"], float]:
    """The criterion, and the disk of the sources: that of the region, or a much smaller one.

    A region that was given stays: a body may be silent near its rim.
    """
    center, radius = np.array(choices.region_center), choices.region_radius / MARGIN
    through = through_bodies(sound, choices, center, radius)
    if choices.grade("region_radius") == SURE:
        return through, center, radius
    seen = through.sounding(through.best(through.one(choices.sound_speed), None))
    if seen[1] > SMALLER * radius:
        return through, center, radius
    center, radius = seen[0], AROUND * seen[1]
    return through_bodies(sound, choices, center, radius), center, radius


class _Surface(NamedTuple):
    """Half of what is left near some numbers, to second order, in units of the numbers.

    Attributes:
        center: the numbers.
        gradient: (free, detectors).
        hessian: (free, free, detectors).
    """

    center: Float[np.ndarray, "5"]
    gradient: Float[np.ndarray, "free detectors"]
    hessian: Float[np.ndarray, "free free detectors"]

    def step(self, kept: Bool[np.ndarray, " detectors"]) -> Float[np.ndarray, " free"]:
        """Newton's step on these detectors' misfit; none where it is flat."""
        gradient, hessian = self.gradient[:, kept].sum(axis=1), self.hessian[..., kept].sum(axis=2)
        curvatures, axes = np.linalg.eigh(hessian)
        told = curvatures > FLAT * max(float(curvatures[-1]), 1e-300)
        steps = np.where(told, -(axes.T @ gradient) / np.where(told, curvatures, 1.0), 0.0)
        return axes @ np.clip(steps, -FARTHER, FARTHER)


class _Search(NamedTuple):
    """The search for the numbers of a body.

    Attributes:
        through: the criterion.
        units: of all numbers.
        weight: of total variation.
        radius: of what sounds [length].
        good: detectors that count.
        n_free: how many of the numbers are searched for; the last is the water's speed.
    """

    through: Through
    units: Float[np.ndarray, "5"]
    weight: float
    radius: float
    good: Bool[np.ndarray, " detectors"]
    n_free: int

    def along_lines(self, numbers: Float[np.ndarray, "5"]) -> Float[np.ndarray, "5"]:
        """Where least is left along each of a few lines, one after the other."""
        radius, water = numbers[1], numbers[4]
        center = radius * OF_CENTER
        ways = OF_ARRIVAL * radius / water, radius * OF_RADIUS, center, center, water * OF_WATER
        for which in (*[4] * (self.n_free == 5), *PASSES):
            values = numbers[which] + ways[which]

            def fit_at(
                value: float, which: int = which, numbers: np.ndarray = numbers, *, steps: int
            ) -> Fit:
                there = np.where(np.arange(5) == which, value, numbers)
                return self.through.best(self.through.body(there), self.weight, steps)

            found = least_share(fit_at, values, self.good).value
            numbers = np.where(np.arange(5) == which, found, numbers)
        return numbers

    def starts(
        self, numbers: Float[np.ndarray, "5"]
    ) -> list[tuple[Float[np.ndarray, "5"], BodyFit]]:
        """Numbers from which ways downhill begin, those of least V, and what it is there.

        Of the end of the lines, the best single speed, and, where the water's is free, bodies
        slower and faster than water.
        """
        arrival, radius, *_ = numbers
        tried = [self.along_lines(numbers), numbers]
        if self.n_free == 5:
            water = [(self.through.distance - radius * (1 - 1 / r)) / arrival for r in CONTRASTS]
            tried += [np.append(numbers[:4], speed) for speed in water]
        begun = [(start, self.at(start)) for start in tried]
        return sorted(begun, key=lambda start: start[1].value)[:BEST]

    def moved(self, numbers: np.ndarray, by: np.ndarray) -> Float[np.ndarray, "5"]:
        """Numbers that differ by so many units in those that are free."""
        return numbers + self.units * np.concatenate([by, np.zeros(5 - self.n_free)])

    def at(self, numbers: np.ndarray, like: BodyFit | None = None) -> BodyFit:
        """V with the light weight, its slopes in units of those numbers that are free."""
        start = (COLD, None) if like is None else (WARM, like.image)
        found = self.through.least(numbers, LIGHT * self.weight, *start)
        return found._replace(slopes=(found.slopes * self.units)[:, : self.n_free])

    def downhill(
        self, numbers: Float[np.ndarray, "5"], begun: BodyFit
    ) -> tuple[Float[np.ndarray, "5"], BodyFit]:
        """Where V is least near some numbers, and what it is there.

        Args:
            begun: V at the numbers.
        """
        best = begun, np.zeros(self.n_free)

        def height(by: np.ndarray) -> tuple[float, np.ndarray]:
            nonlocal best
            found = self.at(self.moved(numbers, by), best[0])
            best = min(best, (found, by.copy()), key=lambda one: one[0].value)
            return found.value, found.slopes.sum(axis=0)

        ends = SIZES[0] * self.radius, min(SIZES[1] * self.radius, self.through.reach / SUPPORT)
        sizes = (np.array(ends) - numbers[1]) / self.units[1]
        bounds = np.stack([-FARTHEST, FARTHEST], axis=1)
        bounds[1] = min(sizes[0], 0.0), max(sizes[1], 0.0)
        scipy.optimize.minimize(
            height,
            best[1],
            jac=True,
            method="L-BFGS-B",
            bounds=bounds[: self.n_free],
            options={"maxfun": MOST, "ftol": SETTLED},
        )
        return self.moved(numbers, best[1]), best[0]

    def newton(
        self, numbers: Float[np.ndarray, "5"], like: BodyFit
    ) -> tuple[_Surface, Float[np.ndarray, " free"]]:
        """What is left near where Newton's method comes to, and its last step from there.

        A step is taken as long as V falls by it.
        """
        (surface, like), by = self._surface(numbers, like), np.zeros(self.n_free)
        for k in range(ROUNDS):
            by = surface.step(self.good)
            there = self.moved(surface.center, by)
            ahead = self.at(there, like)
            if not ahead.value < like.value:
                return surface, np.zeros_like(by)
            if k == ROUNDS - 1 or np.abs(by).max() < ARRIVED:
                break
            surface, like = self._surface(there, ahead)
        return surface, by

    def _surface(self, numbers: Float[np.ndarray, "5"], like: BodyFit) -> tuple[_Surface, BodyFit]:
        """What is left near some numbers, by differences of slopes; V there after more steps."""
        like = self.at(numbers, like)

        def slopes(by: np.ndarray) -> np.ndarray:
            return self.at(self.moved(numbers, by), like).slopes.T

        sides = HALF * np.eye(self.n_free)
        rows = np.array([slopes(side) - slopes(-side) for side in sides]) / (2 * HALF)
        return _Surface(numbers, like.slopes.T, (rows + rows.swapaxes(0, 1)) / 2), like


def _estimate(
    search: _Search, surface: _Surface, last: Float[np.ndarray, " free"], one_speed: float
) -> BodyEstimate:
    """The body of least, its errors by leaving out sectors, and how it compares with one speed."""
    through, good = search.through, search.good
    whole = surface.step(good)

    def least(kept: np.ndarray) -> Float[np.ndarray, "5"]:
        return search.moved(surface.center, last + surface.step(kept) - whole)

    sectors = np.array_split(np.flatnonzero(good), SECTORS)
    others = [good & ~np.isin(np.arange(len(good)), part) for part in sectors]
    numbers = least(good)
    body, each = through.body(numbers), [through.body(least(kept)) for kept in others]
    alike = np.array([through.distance / one_speed, *numbers[1:4], one_speed])
    weight = LIGHT * search.weight
    two, one = (through.least(which, weight, COMPARED) for which in (numbers, alike))

    def error(number: str) -> float:
        values = np.array([np.atleast_1d(getattr(one, number)) for one in each])
        return float(np.linalg.norm([jackknife(list(column)) for column in values.T]))

    names = ("sound_speed", "radius", "center", *(["water_speed"] if search.n_free == 5 else []))
    gains = [1 - two.left[kept].sum() / one.left[kept].sum() for kept in others]
    gain, gain_error = 1 - (two.share / one.share) ** 2, jackknife(gains)
    ratios = [float(one.speed_ratio) for one in each]
    apart = abs(float(body.speed_ratio) - 1) > ERRORS * jackknife(ratios)
    inside = RATIOS[0] + EDGE < float(body.speed_ratio) < RATIOS[1] - EDGE
    clear = bool(inside and apart and gain > max(GAIN, ERRORS * gain_error))
    seen = span(np.asarray(search.through.place.curve.points)[: len(good)][good], through.center)
    return BodyEstimate(
        body=body,
        standard_errors={name: error(name) for name in names},
        one_speed=one_speed,
        share=two.share,
        share_of_one=one.share,
        gain=gain,
        gain_error=gain_error,
        clear=clear,
        grade=LIKELY if clear and seen >= SEEN_TWICE else GUESSED,
    )
