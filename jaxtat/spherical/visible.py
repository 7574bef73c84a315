"""Whether the detectors see the region: in a meridian plane of a cap, along sample lines else."""

import warnings

import numpy as np

from ..geometry import VisibilityWarning, visibility
from ..geometry.balls import Ball
from ..geometry.caps import DetectorPoints, Detectors

_FAR = 4  # median distances between neighbours
_DIRECTIONS = 200  # over half the sphere
_RINGS = ((0.0, 1), (0.5, 6), (0.9, 12))  # lines of one direction: distance over R, and how many


def warn_of_visibility(detectors: Detectors, region: Ball) -> None:
    """Warn if lines through the region miss the detectors, at the line that makes the setup."""
    if isinstance(detectors, DetectorPoints):
        missed = missed_share(detectors, region)
        if not missed:
            return
        said = f"{100 * missed:.2g} % of the lines through the region miss the detectors"
    else:
        seen = visibility(detectors.meridian, region.meridian)
        if not seen.invisible_fraction > 0:
            return
        said = f"in a meridian plane {seen}"
    warnings.warn(said, VisibilityWarning, stacklevel=6)


def missed_share(detectors: DetectorPoints, region: Ball) -> float:
    """Share of the lines through the ball that leave the detectors' sphere far from all of them.

    The sphere has the detectors' mean distance, and far is more than four times the median distance
    of a detector's nearest neighbour: holes as wide as that come about by chance.

    >>> rng = np.random.default_rng(0)
    >>> unit = rng.standard_normal((400, 3))
    >>> unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    >>> below = unit * [[1, 1, -1]] ** (unit[:, 2:] > 0)
    >>> from jaxtat.geometry import ball
    >>> [missed_share(DetectorPoints(1.3 * z), ball(1.0)) > 0.01 for z in (unit, below)]
    [False, True]
    """
    from scipy.spatial import KDTree  # slow to import

    local = np.asarray(detectors.points) - np.asarray(detectors.center)
    distance = np.linalg.norm(local, axis=1, keepdims=True)
    tree = KDTree(local / distance)
    nearest = tree.query(tree.data, k=2)[0][:, 1]
    feet, along = _lines()
    feet = feet * (float(region.radius) / distance.mean())  # the sphere's radius is 1
    half = np.sqrt(1 - np.sum(feet**2, axis=1, keepdims=True))
    off = np.minimum(*(tree.query(feet + sign * half * along)[0] for sign in (1, -1)))
    return float(np.mean(off > min(_FAR * np.median(nearest), 1.0)))


def _lines() -> tuple[np.ndarray, np.ndarray]:
    """Lines through the unit ball: their points nearest to the centre, and directions."""
    k = np.arange(_DIRECTIONS) + 0.5
    cosine, phi = k / _DIRECTIONS, np.pi * (1 + np.sqrt(5)) * k  # Fibonacci's spiral
    sine = np.sqrt(1 - cosine**2)
    along = np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=1)
    first = np.stack([-np.sin(phi), np.cos(phi), 0 * phi], axis=1)
    second = np.cross(along, first)
    turns = [(s, 2 * np.pi * i / n) for s, n in _RINGS for i in range(n)]
    feet = [s * (np.cos(t) * first + np.sin(t) * second) for s, t in turns]
    return np.concatenate(feet), np.tile(along, (len(turns), 1))
