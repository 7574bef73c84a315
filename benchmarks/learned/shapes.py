"""Shapes to learn from and to be tried on: vessels, and two kinds that are none.

Each shape is a set of strokes, so all are drawn by one function: from a to b, as thick as its two
radii say, and as bright. Images are means over pixels, drawn on a grid of half their spacing.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jaxtat import ImageGrid

REACH = 0.85  # of all shapes, from the origin: the region has radius 1
LEAST_RADIUS = 0.02  # of a vessel


class Strokes(NamedTuple):
    """Ends (n, 2), their radii (n,) and the brightness (n,) of each stroke."""

    a: np.ndarray
    b: np.ndarray
    radius_a: np.ndarray
    radius_b: np.ndarray
    value: np.ndarray


def drawn(strokes: Strokes, grid: ImageGrid) -> np.ndarray:
    """The brightest stroke at each pixel, edges as wide as a pixel."""
    x, h = np.asarray(grid.points), float(grid.spacing[0])
    image = np.zeros(x.shape[:-1])
    for a, b, ra, rb, value in zip(*strokes, strict=True):
        along = b - a
        t = np.clip((x - a) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        distance = np.linalg.norm(x - a - t[..., None] * along, axis=-1)
        inside = np.clip((ra + t * (rb - ra) - distance) / h + 0.5, 0.0, 1.0)
        image = np.maximum(image, value * inside)
    return image


def halved(image: np.ndarray) -> np.ndarray:
    """On every second node, (2 n - 1, 2 n - 1) -> (n, n): the mean over a pixel's surroundings."""
    for axis in (0, 1):
        padded = np.pad(np.moveaxis(image, axis, 0), ((1, 1), (0, 0)))
        mean = padded[:-2:2] / 4 + padded[1:-1:2] / 2 + padded[2::2] / 4
        image = np.moveaxis(mean, 0, axis)
    return image


def vessels(rng: np.random.Generator) -> Strokes:
    """Trees that enter from the rim, bend as they go, and fork into thinner branches."""
    found = []
    for _ in range(rng.integers(2, 4)):
        angle = rng.uniform(0, 2 * np.pi)
        start = REACH * np.array([np.cos(angle), np.sin(angle)])
        value, radius = rng.uniform(0.5, 1.0), rng.uniform(0.05, 0.09)
        growing = [(start, angle + np.pi + rng.uniform(-0.6, 0.6), radius)]
        while growing:
            at, heading, radius = growing.pop()
            for _ in range(rng.integers(3, 7)):
                heading += rng.normal(0, 0.25)
                after = at + 0.12 * np.array([np.cos(heading), np.sin(heading)])
                if np.hypot(*after) > REACH or radius < LEAST_RADIUS:
                    break
                found.append((at, after, radius, 0.95 * radius, value))
                at, radius = after, 0.95 * radius
            else:
                fork, share = rng.uniform(0.3, 0.8), rng.uniform(0.55, 0.8)
                growing += [
                    (at, heading + fork, share * radius),
                    (at, heading - fork, 0.7 * radius),
                ]
    return _strokes(found)


def disks(rng: np.random.Generator) -> Strokes:
    """Three to six disks: smooth inside, with edges in all directions."""
    found = []
    for _ in range(rng.integers(3, 7)):
        radius = rng.uniform(0.08, 0.25)
        center = _within(rng, REACH - radius)
        found.append((center, center, radius, radius, rng.uniform(0.5, 1.0)))
    return _strokes(found)


def rings(rng: np.random.Generator) -> Strokes:
    """Two or three circles, as thin as vessels, and closed."""
    found = []
    for _ in range(rng.integers(2, 4)):
        radius, thick = rng.uniform(0.15, 0.35), rng.uniform(0.03, 0.06)
        center, value = _within(rng, REACH - radius - thick), rng.uniform(0.5, 1.0)
        turn = np.linspace(0, 2 * np.pi, 33)
        nodes = center + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        found += [(a, b, thick, thick, value) for a, b in pairwise(nodes)]
    return _strokes(found)


def _within(rng: np.random.Generator, reach: float) -> np.ndarray:
    angle, distance = rng.uniform(0, 2 * np.pi), reach * np.sqrt(rng.uniform())
    return distance * np.array([np.cos(angle), np.sin(angle)])


def _strokes(found: list[tuple]) -> Strokes:
    return Strokes(*map(np.array, zip(*found, strict=True)))
