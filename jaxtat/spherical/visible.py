"""Whether the detectors see the region: in a meridian plane of a cap, along sample lines else."""

import warnings
from typing import Any

import numpy as np

from ..geometry import VisibilityWarning, visibility
from ..geometry.balls import Ball
from ..geometry.caps import DetectorPoints, Detectors

_FAR = 6  # median distances between neighbours
_FEW = 0.01  # of the lines, which a hole among detectors at random may miss
_FARTHEST = 1.0  # on the unit sphere
_AROUND = 64  # detectors, at most, that may surround a direction: those within that distance
_AMONG = 1.5  # median distances from a detector, within which a direction is among them
_DIRECTIONS = 200  # over half the sphere
_RINGS = ((0.0, 1), (0.5, 6), (0.9, 12))  # lines of one direction: distance over R, and how many


def warn_of_visibility(detectors: Detectors, region: Ball) -> None:
    """Warn if lines through the region miss the detectors, at the line that makes the setup."""
    if isinstance(detectors, DetectorPoints):
        missed = missed_share(detectors, region)
        if missed < _FEW:
            return
        said = f"{100 * missed:.2g} % of the lines through the region miss the detectors"
    else:
        seen = visibility(detectors.meridian, region.meridian)
        if not seen.invisible_fraction > 0:
            return
        said = f"in a meridian plane {seen}"
    warnings.warn(said, VisibilityWarning, stacklevel=6)


def missed_share(detectors: DetectorPoints, region: Ball) -> float:
    """Share of the lines through the ball that leave the detectors' sphere beyond all of them.

    The sphere has the detectors' mean distance. A line leaves it among the detectors if some of
    them lie around, with no gap of half a turn between their bearings, within six times the median
    distance of a detector's nearest neighbour: holes as wide as that come about by chance.

    >>> rng = np.random.default_rng(0)
    >>> unit = rng.standard_normal((400, 3))
    >>> unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    >>> below = unit * [[1, 1, -1]] ** (unit[:, 2:] > 0)
    >>> from jaxtat.geometry import ball
    >>> [missed_share(DetectorPoints(1.3 * z), ball(1.0)) > 0.01 for z in (unit, below)]
    [False, True]
    """
    tree, spacing, radius = _directions_of(detectors)
    feet, along = _lines()
    feet = feet * (float(region.radius) / radius)  # the sphere's radius is 1
    half = np.sqrt(1 - np.sum(feet**2, axis=1, keepdims=True))
    among = [_surrounded(tree, feet + sign * half * along, spacing) for sign in (1, -1)]
    return float(np.mean(~(among[0] | among[1])))


def _surrounded(tree: Any, directions: np.ndarray, spacing: float) -> np.ndarray:
    """Whether each direction has detectors nearby on all sides."""
    near, which = tree.query(directions, k=range(1, min(_AROUND, tree.n) + 1))
    first, second = _across(directions)
    offsets = tree.data[which] - directions[:, None]
    bearings = np.arctan2(
        np.einsum("dkx,dx->dk", offsets, second), np.einsum("dkx,dx->dk", offsets, first)
    )
    is_near = near < min(_FAR * spacing, _FARTHEST)
    # those that are not near repeat the nearest one
    bearings = np.sort(np.where(is_near, bearings, bearings[:, :1]), axis=1)
    gaps = np.diff(bearings, axis=1, append=bearings[:, :1] + 2 * np.pi)
    return is_near[:, 0] & (gaps.max(axis=1) < np.pi)


def covered_share(detectors: DetectorPoints) -> float:
    """Share of all directions from the centre that lie among the detectors.

    Those within 1.5 median distances of neighbours: all for even detectors, 79 % for detectors at
    random, which makes up for the rim where they end.

    >>> unit = _spiral(400)
    >>> round(covered_share(DetectorPoints(unit)), 2)
    1.0
    >>> round(covered_share(DetectorPoints(unit[unit[:, 2] < 0])), 1)
    0.6
    """
    tree, spacing, _ = _directions_of(detectors)
    off = tree.query(_spiral(_DIRECTIONS))[0]
    return max(float(np.mean(off < _AMONG * spacing)), 1 / _DIRECTIONS)


def _directions_of(detectors: DetectorPoints) -> tuple[Any, float, float]:
    """Tree of the detectors' directions, their median distance [rad], and their mean radius."""
    from scipy.spatial import KDTree  # slow to import

    local = np.asarray(detectors.points) - np.asarray(detectors.center)
    distance = np.linalg.norm(local, axis=1, keepdims=True)
    tree = KDTree(local / distance)
    return tree, float(np.median(tree.query(tree.data, k=2)[0][:, 1])), float(distance.mean())


def _spiral(n: int) -> np.ndarray:
    """Fibonacci's spiral of n directions, evenly over the sphere, (n, 3)."""
    k = np.arange(n) + 0.5
    cosine, phi = 1 - 2 * k / n, np.pi * (1 + np.sqrt(5)) * k
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=1)


def _lines() -> tuple[np.ndarray, np.ndarray]:
    """Lines through the unit ball: their points nearest to the centre, and directions."""
    along = _spiral(2 * _DIRECTIONS)[:_DIRECTIONS]  # a line has two
    first, second = _across(along)
    turns = [(s, 2 * np.pi * i / n) for s, n in _RINGS for i in range(n)]
    feet = [s * (np.cos(t) * first + np.sin(t) * second) for s, t in turns]
    return np.concatenate(feet), np.tile(along, (len(turns), 1))


def _across(along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across each direction, and across each other."""
    phi = np.arctan2(along[:, 1], along[:, 0])
    first = np.stack([-np.sin(phi), np.cos(phi), 0 * phi], axis=1)
    return first, np.cross(along, first)
