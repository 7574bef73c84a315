"""The speed of sound at which an image explains a record best, where most edges are seen once.

From half a circle an edge is seen once: at any speed an image explains it, elsewhere. But edges
across the lines between detectors at both ends are seen from both sides, and an image in the region
explains both only at the true speed. So of √w G, the record at a frequency lambda,

    E(c) = mean over lambda of log min_y (|√w G - A^T y|² + alpha |y|²) / |√w G|²,

what no image explains, has a dip there. Each frequency counts alike, however much noise it has.
The speed stretches the radii only, so that one decomposition does for all speeds.

The model of the record delays waves by an eighth of a period against the other: a wrong one
displaces the dip, to the other side for waves from the other end, and makes it less deep.

For A and y see `jaxtat.densities.cylindrical_waves.consistency`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import real_array
from ..base.choice_table import GUESSED
from ..densities.cylindrical_waves import unexplained_share, waves_of
from ..io import Scan
from ..reconstruction import OnLadder
from ..records import pressure_to_circular_integrals
from .acquisition import FASTEST, SLOWEST, typical_frame
from .all_speeds import about_center, data_by_speed, problem_for_speeds
from .choices import Choices
from .estimate import Estimate
from .frames import conditioned, has_baseline, shifted_times
from .speed_found import believed, jackknife, summit, unknown

SPEEDS = np.linspace(SLOWEST, FASTEST, 41)
BESIDE = 4  # speeds to each side that belong to a dip
ALPHA = 1e-3  # what is left matters, not the image
WAVES = 300.0  # kR at most: of shorter ones the dip is narrower than the steps between speeds
FREQUENCIES = 64  # at most, among those
FINER = 2.0  # than the shortest wave: those that radii hold, at any speed
BANDS = 8  # of frequencies, each of which is left out in turn
DEEP = 0.2  # log of what is left at most speeds, over that at the best one
ELSEWHERE = 0.5  # depth at all other speeds over that of the dip, at most
SURE_TO = 1e-3  # standard error over the speed; smooth bodies have larger ones, and may mislead
CLEAR = 0.3  # depth, from which on nothing misled it


class Dip(NamedTuple):
    """Where most is explained.

    Attributes:
        found: the speed, with a standard error if it is one.
        depth: log of what is left at most speeds, over what is left there.
        complete: whether the record ends after all sound from the region.
    """

    found: Estimate
    depth: float
    complete: bool = True


def speed_best_explained(scan: Scan, choices: Choices) -> Estimate:
    """The speed over water's at which an image in the region explains most of a typical frame.

    Args:
        scan, choices: in the plane, of pressure.

    Returns:
        Guessed, without a standard error, where something casts doubt on it.
    """
    dip = dip_of(scan, choices)
    if dip.found.standard_error is None:
        return dip.found
    doubt = _doubt(dip, dip.found.standard_error / dip.found.value)
    if doubt is None:
        return dip.found.but("; none in the file", dip.found.grade)
    return dip.found.but(f"; {doubt}", GUESSED)._replace(standard_error=None)


def dip_of(scan: Scan, choices: Choices) -> Dip:
    """The dip of a typical frame, by the model of the choices.

    Args:
        scan, choices: in the plane, of pressure.
    """
    whole = with_long_waves(scan, choices)
    problem = problem_for_speeds(scan, whole)
    if problem.geometry is None:
        return Dip(unknown("cylindrical waves do not reach the detectors"), 0.0)
    found = deepest(share_by_speed(scan, whole, problem))
    return found._replace(complete=problem.setup.complete)


def with_long_waves(scan: Scan, choices: Choices) -> Choices:
    """Choices for the whole disk, with no shorter waves and radii than this criterion takes."""
    distances = np.hypot(*about_center(scan, choices).T)
    highest = min(choices.max_frequency, WAVES / float(np.median(distances)))
    length = choices.radial_step * (choices.n_radii - 1)
    n_steps = min(choices.n_radii - 1, int(length * FINER * highest / np.pi) + 1)
    of_radii = {"radial_step": length / n_steps, "n_radii": n_steps + 1}
    return replace(choices, max_frequency=highest, region_cut=choices.region_radius, **of_radii)


def _doubt(dip: Dip, error: float) -> str | None:
    if not dip.complete:
        return "but the record ends early"
    if error > SURE_TO:
        return f"but edges agree to {error:.2%} only"
    return None if dip.depth > CLEAR else "but that is not much"


def share_by_speed(
    scan: Scan, choices: Choices, problem: OnLadder, n_frequencies: int = FREQUENCIES
) -> Callable[..., Float[np.ndarray, "frequencies speeds"]]:
    """The share of a typical frame's power, by frequency and speed, that no image explains.

    Without what arrives before or after sound from the region.

    Args:
        scan, choices: in the plane, of pressure.
        problem: of `problem_for_speeds`, whose region is a disk that waves reach.
        n_frequencies: at most.

    Returns:
        A function of speeds over that of the choices, and of as many shifts of the times, none by
        default and in increasing order [time].
    """
    geometry, sizes = problem.geometry, problem.sizes
    times, speed = shifted_times(scan, choices), choices.path_speed
    assert geometry is not None and times is not None
    record = real_array(scan.kind, typical_frame(scan)[list(choices.channels)], None)
    record = conditioned(scan, choices, record, times, baseline=has_baseline(choices))
    highest = np.pi / choices.radial_step * speed
    some, n = problem.some_frequencies(n_frequencies)
    frequencies = jax.device_put(some)
    alpha = jax.device_put(ALPHA)
    waves = waves_of(geometry, frequencies, sizes.groups[-1][-1])
    points = np.asarray(problem.curve.points)
    distance = np.hypot(*(points - np.asarray(choices.region_center)).T)
    reach = choices.region_radius * np.array([-1.0, 1.0])
    sounding = jax.device_put(distance[:, None] + reach)

    def data_at(shift: float, speeds: np.ndarray) -> Array:
        g = pressure_to_circular_integrals(
            record,
            times + shift,
            problem.setup.radii,
            sound_speed=speed,
            model=choices.model,
            max_frequency=highest,
        )
        stretches = jax.device_put(speeds)
        return data_by_speed(problem.data(g), problem.radii, stretches, frequencies, sounding)

    def share_at(speeds: np.ndarray, shifts: np.ndarray | None = None) -> np.ndarray:
        shifts = np.zeros(len(speeds)) if shifts is None else shifts
        parts = [data_at(float(shift), speeds[shifts == shift]) for shift in np.unique(shifts)]
        return np.asarray(_share(geometry, waves, jnp.concatenate(parts), alpha))[:n]

    return share_at


_share = eqx.filter_jit(unexplained_share)


def deepest(
    share_at: Callable[[np.ndarray], Float[np.ndarray, "frequencies speeds"]],
) -> Dip:
    """The speed at which the mean over frequencies of the log of a share has its deepest dip.

    As many speeds again between the neighbours of that dip, and a parabola through the three
    lowest values. The standard error is the jackknife's, by leaving out each band of frequencies.

    Args:
        share_at: of speeds over that of water.

    >>> dip = lambda speeds: np.exp(-np.exp(-(((speeds - 0.9877) / 0.01) ** 2))) * np.ones((64, 1))
    >>> found, depth, _ = deepest(dip)
    >>> round(found.value, 5), round(found.standard_error, 9), round(depth, 1)
    (0.9877, 0.0, 1.0)
    """
    explained = -np.log(share_at(SPEEDS)).mean(axis=0)
    depths = explained - np.median(explained)
    best = int(np.argmax(depths[1:-1])) + 1
    depth, elsewhere = float(depths[best]), np.abs(np.arange(len(depths)) - best) > BESIDE
    if depth < DEEP or depths[elsewhere].max() > ELSEWHERE * depth:
        return Dip(unknown("no speed explains the record much better than others"), depth)
    near = np.linspace(SPEEDS[best - 1], SPEEDS[best + 1], len(SPEEDS))
    left = f"{np.exp(depth):.1f} times as much is left at most speeds"
    why = f"an image explains the record best: {left}"
    return Dip(believed(*where_highest(near, -np.log(share_at(near))), why, "edges"), depth)


def where_highest(
    values: Float[np.ndarray, " values"], explained: Float[np.ndarray, "frequencies values"]
) -> tuple[float, float]:
    """Where the sum over frequencies is highest, and the jackknife's standard error over bands.

    Args:
        values: equispaced, in increasing order.
        explained: by frequency, at each of them.
    """
    of_bands = by_band(explained)
    total = of_bands.sum(axis=0)
    return summit(values, total), jackknife([summit(values, total - band) for band in of_bands])


def by_band(
    explained: Float[np.ndarray, "frequencies *values"],
) -> Float[np.ndarray, "bands *values"]:
    """Sums over bands of frequencies, each of which the jackknife leaves out in turn."""
    return np.array([band.sum(axis=0) for band in np.array_split(explained, BANDS)])
