"""The best picture of a scan that jaxtat can make, the truth being known; and errors.

Speed of sound, start, region and model are the true ones. Of the formula's pictures and the fitted
ones that of least error is taken: alpha, low pass and highest frequency of the former, weight and
highest frequency of the latter. One is varied after the other, and not all combinations are tried.
Of fitted volumes there is one, by the weight that jaxtat chooses: a fit takes minutes.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from bodies import Body
from cases import Case
from scipy.ndimage import map_coordinates

from jaxtat.io import Scan
from jaxtat.scans import Choices, ScanImages, choose, reconstruct, setup_of, with_best_method
from jaxtat.scans.constrained import fitted

ALPHAS = (1e-6, 1e-4, 1e-3, 1e-2, 1e-1)
RULES = tuple((alpha, low_pass) for alpha in ALPHAS for low_pass in ("none", "cosine"))
WEIGHTS = (1 / 16, 1 / 4, 4.0)  # times that which balances penalty and misfit
FREQUENCIES = (0.7, 1.4)  # times that which is chosen
SHARES = (0.0, 0.25, 0.5)  # of the way from the water's speed to the body's
TO_SPARE = 1.1  # of the body's radius: where errors are taken


@dataclass(frozen=True)
class Window:
    """Pixels, or voxels, in a disk or ball about the body, and the truth there."""

    points: np.ndarray
    inside: np.ndarray
    truth: np.ndarray

    def seen(self, found: ScanImages) -> np.ndarray:
        """The first image, with the best factor; zero where there is none."""
        image = np.asarray(found.image).reshape(-1, *found.grid.shape)[0]
        low = np.asarray(found.grid.points)[(0,) * self.points.shape[-1]]
        spacing = np.asarray(found.grid.spacing)
        inside = np.asarray(found.region.contains(self.points))
        at = np.moveaxis((self.points - low) / spacing, -1, 0)
        values = np.where(inside, map_coordinates(image, at, order=1), 0.0) * self.inside
        return values * np.sum(values * self.truth) / max(np.sum(values**2), 1e-300)

    def error(self, image: np.ndarray) -> float:
        """Relative, in L2."""
        return float(np.linalg.norm(image - self.truth) / np.linalg.norm(self.truth))


def window(body: Body, n: int = 160) -> Window:
    """About a body, ``n`` pixels across; a quarter of that in space."""
    half, d = TO_SPARE * body.extent, body.centers.shape[1]
    line = np.linspace(-half, half, n if d == 2 else n // 4)
    points = np.stack(np.meshgrid(*[line] * d, indexing="ij"), axis=-1)
    inside = np.linalg.norm(points, axis=-1) <= half
    points = points + body.middle
    return Window(points, inside, body.image(points) * inside)


@dataclass(frozen=True)
class Best:
    """What the oracle found: its picture, error and choices."""

    image: np.ndarray
    error: float
    choices: Choices

    @property
    def method(self) -> str:
        return "fitted" if self.choices.model_based else "direct"


def best(scan: Scan, case: Case, body: Body, where: Window) -> Best:
    """The picture of least error."""
    given = _known(case, body)
    # those that fit the positions in the file
    speeds = sorted(
        {case.stretch * (case.water + share * (case.speed - case.water)) for share in SHARES}
    )
    at_speed = [choose(scan, sound_speed=speed, **given) for speed in speeds]
    trial = _Trial(scan, where)
    ends: list[tuple[float, Choices]] = []
    if not at_speed[0].model_based:  # there is a formula
        ends.append(_direct(trial, at_speed))
    if case.model == "in-space":
        ends.append((np.nan, with_best_method(scan, at_speed[-1])))
    else:
        ends.append(_fitted(trial, at_speed))
    # with all pixels the order may be another
    found = [where.seen(reconstruct(scan, choices)) for _, choices in ends]
    errors = [where.error(image) for image in found]
    least = int(np.argmin(errors))
    return Best(found[least], errors[least], ends[least][1])


@dataclass(frozen=True)
class _Trial:
    """Errors of pictures with fewer pixels and the faster last step, enough to compare by."""

    scan: Scan
    where: Window

    def least(self, tried: Iterable[Choices]) -> tuple[float, Choices]:
        """The choices of least error among these, with it."""
        each = [(self._error(choices), choices) for choices in tried]
        return min(each, key=lambda entry: entry[0])

    def _error(self, choices: Choices) -> float:
        return self.where.error(self.where.seen(reconstruct(self.scan, _coarse(choices))))


def _direct(trial: _Trial, at_speed: list[Choices]) -> tuple[float, Choices]:
    """Of the formula: speed, alpha and low pass together, then the highest frequency."""
    rules = [
        replace(choices, alpha=alpha, low_pass=low_pass)
        for choices in at_speed
        for alpha, low_pass in RULES
    ]
    first = trial.least(rules)
    return min(first, trial.least(_frequencies(first[1])), key=lambda entry: entry[0])


def _fitted(trial: _Trial, at_speed: list[Choices]) -> tuple[float, Choices]:
    """Of fits with total variation and f >= 0: speed, then weight, then the highest frequency."""
    fits = [
        replace(choices, model_based=True, penalty="tv", nonnegative=True, weight=None)
        for choices in at_speed
    ]
    found = trial.least(fits)
    coarse = _coarse(found[1])
    setup, scan = setup_of(trial.scan, coarse), trial.scan
    balanced = float(fitted(scan, coarse, setup, scan.frame(0)).weight)
    balanced *= (coarse.pixels - 1) / (found[1].pixels - 1)
    others = [replace(found[1], weight=times * balanced) for times in WEIGHTS]
    found = min(found, trial.least(others), key=lambda entry: entry[0])
    return min(found, trial.least(_frequencies(found[1])), key=lambda entry: entry[0])


def _frequencies(choices: Choices) -> list[Choices]:
    return [replace(choices, max_frequency=times * choices.max_frequency) for times in FREQUENCIES]


def _coarse(choices: Choices) -> Choices:
    """With fewer pixels and the faster last step, enough to compare by."""
    pixels = int(choices.pixels / 1.6) // 2 * 2 + 1
    weight = choices.weight
    if weight is not None:  # total variation, a sum over pixels, grows with their number on a line
        weight *= (choices.pixels - 1) / (pixels - 1)
    return replace(choices, pixels=pixels, inversion="fourier", weight=weight)


def region_radius(body: Body) -> float:
    """Of a region in the plane that holds the body, within every array."""
    return min(TO_SPARE * body.reach, 0.9 * 38e-3)


def _known(case: Case, body: Body) -> dict:
    if case.model == "in-space":
        return {"region_radius": TO_SPARE * body.reach}
    return {
        "model": case.model,
        "time_shift": case.start,
        "region_center": (0.0, 0.0),
        "region_radius": region_radius(body),
    }
