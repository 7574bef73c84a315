"""A body of another speed of sound than the water's, by what the best image leaves unexplained.

The criterion is that of `misfit`, with the waves of a `DiskBody` in its operator and an image that
may sound in it and just around it: farther away its waves mean nothing. Pixels, numbers of waves
and the samples that count are those of the largest body and the same for all, so that a candidate
compiles nothing.

Numbers are searched for that a record tells apart: the radius a, the centre, the water's speed c_2
where it is not known, and in place of the body's own speed c_1 the time

    T = D/c_2 - a (1/c_2 - 1/c_1),    D the distance of the detectors from the middle,

which sound from the middle takes; the best single speed has it nearly right. Least is looked for
along lines, then Newton's method takes differences of what is left in all numbers at once. What is
left is known for each detector, so that the jackknife over sectors of them costs nothing.
"""

from itertools import combinations
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float

from ..base.checks import real_array, require_positive
from ..base.choice_table import GUESSED, LIKELY, SURE
from ..geometry import DiskBody
from ..io import Scan
from .acoustics import sound_of
from .acquisition import FASTEST, SLOWEST
from .angular_coverage import SEEN_TWICE, span
from .choices import Choices
from .misfit import Fit, Misfit, Place, Sound, misfit_of, place_of
from .region import MARGIN
from .sound_speed import SECTORS, least_share
from .speed_found import jackknife

PIXELS = 65  # along an axis: coarse ones see wrong bodies from farther
FINE = 1e-5  # tolerance of the non-uniform FFTs: with 1e-3 a fit through a body ends too early
SUPPORT = 1.1  # of the body's radius, up to which there may be sound
WIDE, WAY = 1.35, 0.25  # of the radius of what sounds: reach of the pixels, way of the centre
RATIOS = 0.92, 1.1  # of the two speeds, that are tried
SOUNDING, SMALLER = 0.95, 0.75  # of an image's power; of the radius: a body beside the middle
OFF = 1.005  # of the speed at which a weight is found: of small weights fits come to no end
OF_ONE = np.arange(-3, 4) / 150  # single speeds over the one that is chosen, less 1
OF_WATER = np.arange(-6, 7) / 333  # the water's over that, less 1
OF_ARRIVAL = 0.005 * np.arange(-2, 3)  # T, over the time through the radius
OF_RADIUS = 0.06 * np.arange(-3, 4)  # over that before, less 1
OF_CENTER = 0.05 * np.arange(-2, 3)  # over the radius
STEPS = np.array([0.004, 0.04, 0.05, 0.05, 0.002])  # of differences in (T, a, x, y, c_2)
PASSES = 0, 1, 2, 3, 0, 1, 2, 3  # numbers along which lines run, one after the other
ROUNDS, FARTHEST = 3, 2.0  # of Newton's method, and steps by which numbers change at most
ARRIVED = 0.2  # of a step: a smaller one ends it
COMPARED = 100  # steps of the two fits that are compared: the better model takes more of them
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

    Takes 100 to 200 fits of a coarse image, 0.1 to 0.2 s of a processor each.

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
    first = [through.distance / one, radius, *center, water_speed or one]
    units = np.array([radius / nominal, radius, radius, radius, nominal])
    search = _Search(through, STEPS * units, weight, good, 4 if water_speed else 5)
    return _estimate(search, search.newton(search.along_lines(np.array(first))), one)


class Through(NamedTuple):
    """The criterion for bodies.

    Attributes:
        misfit, place: through one of them, and its sizes.
        distance: D [length].
        center, reach: of the disk of all pixels [length].
    """

    misfit: Misfit
    place: Place
    distance: float
    center: Float[np.ndarray, "2"]
    reach: float

    def body(self, numbers: Float[np.ndarray, "5"]) -> DiskBody:
        """That of (T, a, x, y, c_2), with speeds within `RATIOS` of each other."""
        arrival, radius, x, y, water = map(float, numbers)
        slowness = 1 + (water * arrival - self.distance) / radius  # c_2/c_1
        speed = water / float(np.clip(slowness, 1 / RATIOS[1], 1 / RATIOS[0]))
        return DiskBody((x, y), radius, speed, water)

    def one(self, speed: float, like: DiskBody | None = None) -> DiskBody:
        """A body of the water's speed, which may sound everywhere, or where another one does."""
        if like is None:
            return DiskBody(self.center, self.reach / SUPPORT, speed, speed)
        return DiskBody(like.center, like.radius, speed, speed)

    def best(self, body: DiskBody, weight: float | None, steps: int | None = None) -> Fit:
        """The best image in and just around a body."""
        points = np.asarray(self.place.grid.points) - np.asarray(body.center)
        support = np.hypot(points[..., 0], points[..., 1]) <= SUPPORT * float(body.radius)
        parts = self.place.integrals(body), jax.device_put(support)
        misfit = eqx.tree_at(lambda m: (m.integrals, m.support), self.misfit, parts)
        return misfit.best(float(body.water_speed), weight=weight, steps=steps)

    def sounding(self, fit: Fit) -> tuple[Float[np.ndarray, "2"], float]:
        """The middle of an image, and the radius about it within which nearly all of it is."""
        points, power = np.asarray(self.place.grid.points).reshape(-1, 2), fit.image.ravel() ** 2
        middle = power @ points / max(float(power.sum()), 1e-300)
        distance = np.hypot(*(points - middle).T)
        order = np.argsort(distance)
        within = np.searchsorted(np.cumsum(power[order]), SOUNDING * power.sum())
        return middle, float(distance[order[min(int(within), len(order) - 1)]])


def _about_what_sounds(
    sound: Sound, choices: Choices
) -> tuple[Through, Float[np.ndarray, "2"], float]:
    """The criterion, and the disk of the sources: that of the region, or a much smaller one.

    A region that was given stays: a body may be silent near its rim.
    """
    center, radius = np.array(choices.region_center), choices.region_radius / MARGIN
    through = _through(sound, choices, center, radius)
    if choices.grade("region_radius") == SURE:
        return through, center, radius
    seen = through.sounding(through.best(through.one(choices.sound_speed), None))
    if seen[1] > SMALLER * radius:
        return through, center, radius
    return _through(sound, choices, *seen), *seen


def _through(sound: Sound, choices: Choices, center: np.ndarray, radius: float) -> Through:
    """The criterion in pixels about the sources, for bodies of about their size."""
    offset = center - sound.center
    away = float(np.hypot(*offset))
    reach = min(WIDE * radius, sound.reach - away)
    # off the centre of the detectors' circle in any case, where bodies take larger sizes
    outward = offset / away if away > 0 else np.array([1.0, 0.0])
    largest = DiskBody(center + WAY * radius * outward, reach / SUPPORT, RATIOS[0], 1.0)
    ends = SLOWEST * choices.sound_speed, FASTEST * choices.sound_speed
    distance = np.hypot(*(np.asarray(sound.curve.points)[sound.good] - center).T).mean()
    sound = sound._replace(center=center, reach=reach)
    place = place_of(sound, ends[1], largest, pixels=PIXELS, tolerance=FINE)
    misfit = misfit_of(sound, choices.model, ends, place)
    return Through(misfit, place, float(distance), center, reach)


class _Surface(NamedTuple):
    """What is left near some numbers, to second order, in units of the steps of differences.

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
        return axes @ np.clip(steps, -FARTHEST, FARTHEST)


class _Search(NamedTuple):
    """The search for the numbers of a body.

    Attributes:
        through: the criterion.
        steps: of differences in all numbers.
        weight: of total variation.
        good: detectors that count.
        n_free: how many of the numbers are searched for; the last is the water's speed.
    """

    through: Through
    steps: Float[np.ndarray, "5"]
    weight: float
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

    def moved(self, numbers: np.ndarray, by: np.ndarray) -> Float[np.ndarray, "5"]:
        """Numbers that differ by so many steps in those that are free."""
        return numbers + self.steps * np.concatenate([by, np.zeros(5 - self.n_free)])

    def newton(self, numbers: Float[np.ndarray, "5"]) -> _Surface:
        """What is left near its least."""
        surface = self._surface(numbers)
        for _ in range(ROUNDS - 1):
            by = surface.step(self.good)
            if np.abs(by).max() < ARRIVED:
                break
            surface = self._surface(self.moved(surface.center, by))
        return surface

    def _surface(self, numbers: Float[np.ndarray, "5"]) -> _Surface:
        units = np.eye(self.n_free)

        def left(by: np.ndarray) -> np.ndarray:
            body = self.through.body(self.moved(numbers, by))
            return self.through.best(body, self.weight).left

        middle = left(0 * units[0])
        ahead, behind = (np.array([left(sign * unit) for unit in units]) for sign in (1, -1))
        hessian = np.zeros((self.n_free, *ahead.shape))
        for k in range(self.n_free):
            hessian[k, k] = ahead[k] - 2 * middle + behind[k]
        for j, k in combinations(range(self.n_free), 2):
            mixed = left(units[j] + units[k]) - ahead[j] - ahead[k] + middle
            hessian[j, k] = hessian[k, j] = mixed
        return _Surface(numbers, (ahead - behind) / 2, hessian)


def _estimate(search: _Search, surface: _Surface, one_speed: float) -> BodyEstimate:
    """The body of least, its errors by leaving out sectors, and how it compares with one speed."""
    through, good = search.through, search.good

    def least(kept: np.ndarray) -> Float[np.ndarray, "5"]:
        return search.moved(surface.center, surface.step(kept))

    sectors = np.array_split(np.flatnonzero(good), SECTORS)
    others = [good & ~np.isin(np.arange(len(good)), part) for part in sectors]
    body, each = through.body(least(good)), [through.body(least(kept)) for kept in others]
    single = through.one(one_speed, body)
    two, one = (through.best(each, None, COMPARED) for each in (body, single))

    def error(number: str) -> float:
        values = np.array([np.atleast_1d(getattr(one, number)) for one in each])
        return float(np.linalg.norm([jackknife(list(column)) for column in values.T]))

    names = ("sound_speed", "radius", "center", *(["water_speed"] if search.n_free == 5 else []))
    gains = [1 - two.left[kept].sum() / one.left[kept].sum() for kept in others]
    gain, gain_error = 1 - (two.share / one.share) ** 2, jackknife(gains)
    ratios = [float(one.speed_ratio) for one in each]
    apart = abs(float(body.speed_ratio) - 1) > ERRORS * jackknife(ratios)
    inside = RATIOS[0] < float(body.speed_ratio) < RATIOS[1]
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
