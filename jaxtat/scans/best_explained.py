"""The speed of sound at which an image explains a record best, where most edges are seen once.

From half a circle an edge is seen once: at any speed an image explains it, elsewhere. But edges
across the lines between detectors at both ends are seen from both sides, and there is an image in
the region that explains both only at the true speed. So of √w G, the record at a frequency lambda,

    E(c) = mean over lambda of log min_y (|√w G - A^T y|² + alpha |y|²) / |√w G|²,

what no image explains, has a dip there. Each frequency counts alike, however much noise it has.
The speed stretches the radii only, so that one decomposition does for all speeds.

For A and y see `jaxtat.densities.harmonic.consistency`.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from ..densities.harmonic import polar_geometry, unexplained_share
from ..io import Scan
from ..reconstruction.setup import plane_of
from .all_speeds import data_by_speed
from .choices import Choices
from .facts import FASTEST, SLOWEST, facts_of, typical_frame
from .frames import integrals, setup_of
from .speed_found import SpeedFound, believed, jackknife, next_highest, summit, unknown

SPEEDS = np.linspace(SLOWEST, FASTEST, 41)
BESIDE = 3  # speeds to each side that belong to a dip
ALPHA = 1e-3  # what is left matters, not the image
WAVES = 300.0  # kR at most: of shorter ones the dip is narrower than the steps between speeds
FREQUENCIES = 64  # at most, among those
BANDS = 8  # of frequencies, each of which is left out in turn
DEEP = 0.2  # log of what is left at most speeds, over that at the best one
RIVAL = 0.5  # depth of another dip over that of the deepest, at most


def speed_best_explained(scan: Scan, choices: Choices) -> SpeedFound:
    """The speed at which an image in the region explains most of a typical frame.

    Args:
        scan, choices: in the plane, of pressure.

    Returns:
        A speed with a standard error if the record shows one.
    """
    points = facts_of(scan).points[list(choices.channels)] - np.asarray(choices.region_center)
    if _aside(points[0], points[-1]) > choices.region_radius:
        return unknown("the region is not between any two detectors")
    share_at = share_by_speed(scan, choices, points)
    return unknown("waves do not reach it") if share_at is None else deepest(share_at)


def _aside(end: Float[np.ndarray, "2"], other: Float[np.ndarray, "2"]) -> float:
    """Distance of the origin from the line through two points."""
    along = (other - end) / max(float(np.hypot(*(other - end))), 1e-300)
    return abs(float(end[0] * along[1] - end[1] * along[0]))


def share_by_speed(
    scan: Scan, choices: Choices, points: Float[np.ndarray, "detectors 2"]
) -> Callable[[np.ndarray], Float[np.ndarray, "frequencies speeds"]] | None:
    """The share of a typical frame's power, by frequency and speed, that no image explains.

    Of the whole disk, without what arrives before or after sound from it.

    Args:
        scan, choices: in the plane, of pressure.
        points: of the detectors, from the region's centre [length].
    """
    distance, radius = np.hypot(*points.T), choices.region_radius
    highest = min(choices.max_frequency, WAVES / float(np.median(distance)))
    coarse = replace(choices, max_frequency=highest, region_cut=radius)
    setup = setup_of(scan, coarse, n_groups=1)
    curve, region, radii, sizes = plane_of(setup)
    if not sizes.reached:
        return None
    g = integrals(scan, coarse, setup, typical_frame(scan))
    n = min(sizes.n_frequencies, FREQUENCIES)
    some = np.round(np.linspace(0, sizes.n_frequencies - 1, n)).astype(int)
    frequencies, orders = sizes.frequencies[some], sizes.groups[-1][-1]
    geometry, alpha = polar_geometry(curve, region, sizes.n_nodes), jax.device_put(ALPHA)
    sounding = jax.device_put(np.stack([distance - radius, distance + radius], axis=1))
    share = eqx.filter_jit(unexplained_share)

    def share_at(speeds: np.ndarray) -> np.ndarray:
        data = data_by_speed(g, radii, jax.device_put(speeds), frequencies, sounding)
        return np.asarray(share(geometry, frequencies, orders, data, alpha))

    return share_at


def deepest(
    share_at: Callable[[np.ndarray], Float[np.ndarray, "frequencies speeds"]],
) -> SpeedFound:
    """The speed at which the mean over frequencies of the log of a share has its deepest dip.

    As many speeds again between the neighbours of that dip, and a parabola through the three
    lowest values. The standard error is the jackknife's, by leaving out each band of frequencies.

    Args:
        share_at: of speeds over that of water.

    >>> dip = lambda speeds: np.exp(-np.exp(-(((speeds - 0.9877) / 0.01) ** 2))) * np.ones((64, 1))
    >>> found = deepest(dip)
    >>> round(found.stretch, 5), round(found.standard_error, 9)
    (0.9877, 0.0)
    """
    explained = -np.log(share_at(SPEEDS)).mean(axis=0)
    depth = explained - np.median(explained)
    best = int(np.argmax(depth[1:-1])) + 1
    if depth[best] < DEEP or next_highest(depth, best, BESIDE) > RIVAL * depth[best]:
        return unknown("no speed explains the record much better than others")
    near = np.linspace(SPEEDS[best - 1], SPEEDS[best + 1], len(SPEEDS))
    bands = np.array_split(-np.log(share_at(near)), BANDS)
    of_bands = np.array([band.sum(axis=0) for band in bands])
    total = of_bands.sum(axis=0)
    error = jackknife([summit(near, total - band) for band in of_bands])
    why = f"an image explains the record best: {np.exp(depth[best]):.1f} times as much is left"
    return believed(summit(near, total), error, f"{why} at most speeds; none in the file", "waves")
