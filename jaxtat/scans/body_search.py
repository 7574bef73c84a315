"""The search for the numbers of a body of another speed of sound: downhill, then Newton's method.

Of all frequencies the criterion of `body_criterion` has many valleys, of low ones few: so a search
goes through parts of them. Derivatives come with every fit, and a way goes downhill in all numbers
at once. Near its end V is of second order in them, by differences of slopes.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.optimize
from jaxtyping import Bool, Float, Int

from .body_criterion import SUPPORT, BodyFit, Through

CONTRASTS, BEST = (0.98, 1.0, 1.02, 1.04), 2  # c_1/c_2 of starts; how many of them are followed
BESIDE_ONE, LEVEL = 0.01, 4e-3  # of c_1/c_2 - 1: tried, and as small where there is no body
UNITS = 0.004, 0.04, 0.05, 0.002, 0.0  # of T, a, the centre, c_2, the stretch: of no ellipse
UNITS_OF_ELLIPSES = 0.0015, 0.04, 0.05, 0.006, 0.04  # likewise, by curvatures of V at true ones
COLD, WARM = 60, 25  # steps of fits from zeros, and from the best image so far
# Of the way downhill: fits after which it ends, change of V over itself
MOST, SETTLED = 20, 1e-5
FARTHEST = 0.1, np.inf, 0.25, 0.05, 0.3  # as UNITS, from the first numbers; the stretch from none
SIZES = 0.6, 1.22  # least and greatest radius, over that of what sounds
FARTHER, BESIDE = 4.0, 0.5  # greatest of Newton's steps, half the width of differences, in units
FLAT = 1e-3  # curvature over the largest, below which nothing is told


class NearLeast(NamedTuple):
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


class BodySearch(NamedTuple):
    """The search for the numbers of a body.

    Attributes:
        through: the criterion.
        first: numbers near which all are looked for.
        units: of all numbers.
        weight: of total variation, light.
        radius: over which least and greatest ones are [length].
        good: detectors that count.
        n_free: how many of the numbers are searched for; the last is the water's speed.
        parts: of the frequencies, before all of them.
        settled: change of V over itself, or over 1 below that, with which a way downhill ends.
    """

    through: Through
    first: Float[np.ndarray, " numbers"]
    units: Float[np.ndarray, " numbers"]
    weight: float
    radius: float
    good: Bool[np.ndarray, " detectors"]
    n_free: int
    parts: tuple[float, ...]
    settled: float = SETTLED

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

    def lowest_of_starts(
        self, *more: tuple[Float[np.ndarray, " numbers"], BodyFit]
    ) -> tuple[Float[np.ndarray, " numbers"], BodyFit]:
        """Where V is least downhill from the starts, and V there.

        Args:
            more: starts beside those by contrast: numbers, and V there.
        """
        ends = [self.downhill(*start) for start in self.starts(*more)]
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

    def low_passed(self, part: float) -> "BodySearch":
        """The search in which frequencies fade above a part of the highest one."""
        through, energy = self.through.low_passed(part)
        return self._replace(through=through, weight=energy * self.weight)

    def starts(
        self, *more: tuple[Float[np.ndarray, " numbers"], BodyFit]
    ) -> list[tuple[Float[np.ndarray, " numbers"], BodyFit]]:
        """Numbers from which ways downhill begin, those of least V, and what it is there.

        Of ``more``, of a body as fast as the water, and slower and faster ones, by the water's
        speed that sound from the middle takes the time of the first numbers with, or by that time
        where the water's speed is known.
        """
        begun = [(start, self.at(start)) for start in self._contrasts(CONTRASTS)]
        return sorted([*begun, *more], key=lambda start: start[1].value)[:BEST]

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
        self, numbers: Float[np.ndarray, " numbers"], begun: BodyFit, *, disks: bool = False
    ) -> tuple[Float[np.ndarray, " numbers"], BodyFit]:
        """Where V is least near some numbers, and what it is there.

        Args:
            begun: V at the numbers.
            disks: of ellipses disks alone.
        """
        ends = SIZES[0] * self.radius, min(SIZES[1] * self.radius, self.through.reach / SUPPORT)
        sizes = (np.array(ends) - numbers[1]) / self.units[1]
        farthest = _each((*FARTHEST[:-1], 0.0) if disks else FARTHEST, self.through)
        farthest *= _sizes(self.through, self.radius, self.first[-1]) / self.units
        middle = self.first.copy()
        middle[2 + len(self.through.center) : -1] = 0.0
        way = (middle - numbers) / self.units
        bounds = way[:, None] + np.stack([-farthest, farthest], axis=1)
        bounds[1] = sizes
        bounds = np.stack([np.minimum(bounds[:, 0], 0.0), np.maximum(bounds[:, 1], 0.0)], axis=1)

        def at(by: np.ndarray, like: BodyFit) -> BodyFit:
            return self.at(self.moved(numbers, by), like)

        # SciPy divides changes by V or, below 1, by 1
        small = min(begun.value, 1.0) if self.through.n_stretch else 1.0
        by, end = _lowest(at, begun, bounds[: self.n_free], small * self.settled)
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

        bounds = FARTHEST[3] * self.first[-1] / self.units[-1] * np.array([[-1.0, 1.0]])
        by, end = _lowest(at, at(np.zeros(1), None), bounds, self.settled)
        return alike(by), end

    def newton(self, numbers: Float[np.ndarray, " numbers"], fit: BodyFit) -> NearLeast:
        """V near its least, to which a step is taken if V falls by it.

        By differences of slopes to both sides.
        """
        fit = self.at(numbers, fit)
        sides = BESIDE * np.eye(self.n_free)
        pairs = [[self.at(self.moved(numbers, by), fit) for by in (x, -x)] for x in sides]
        rows = np.array([ahead.slopes - behind.slopes for ahead, behind in pairs]) / (2 * BESIDE)
        of_left = np.array([ahead.left - behind.left for ahead, behind in pairs]) / (4 * BESIDE)
        near = NearLeast(numbers, fit, fit.slopes, (rows + rows.T) / 2, of_left)
        there = self.moved(numbers, near.step())
        ahead = self.at(there, fit)
        if not ahead.value < fit.value:
            return near
        return near._replace(numbers=there, fit=ahead, gradient=ahead.slopes)


def _each(values: tuple[float, ...], through: Through) -> Float[np.ndarray, " numbers"]:
    """For T, a, each coordinate of the centre, of the stretch of an ellipse, and c_2."""
    arrival, radius, center, water, stretch = values
    coordinates, stretches = [center] * len(through.center), [stretch] * through.n_stretch
    return np.array([arrival, radius, *coordinates, *stretches, water])


def units_of(through: Through, radius: float, speed: float) -> Float[np.ndarray, " numbers"]:
    """Of the numbers of bodies about a radius [length] and a speed [length/time]."""
    units = UNITS_OF_ELLIPSES if through.n_stretch else UNITS
    return _each(units, through) * _sizes(through, radius, speed)


def _sizes(through: Through, radius: float, speed: float) -> Float[np.ndarray, " numbers"]:
    """Of which units are parts."""
    return _each((radius / speed, radius, radius, speed, 1.0), through)


def _lowest(
    at: Callable[[np.ndarray, BodyFit], BodyFit],
    begun: BodyFit,
    bounds: Float[np.ndarray, "free 2"],
    settled: float,
) -> tuple[Float[np.ndarray, " free"], BodyFit]:
    """Where V is least of what is tried on a way from zero downhill, and what it is there.

    Args:
        at: V and its slopes, from the image of another fit.
        begun: V at zero.
        bounds: of the way.
        settled: change of V over itself, or over 1 below that, with which it ends.
    """
    best = np.zeros(len(bounds)), begun

    def height(by: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal best
        found = at(by, best[1])
        best = min(best, (by.copy(), found), key=lambda one: one[1].value)
        return found.value, found.slopes

    most = {"maxfun": MOST, "ftol": settled}
    scipy.optimize.minimize(
        height, best[0], jac=True, method="L-BFGS-B", bounds=bounds, options=most
    )
    return best
