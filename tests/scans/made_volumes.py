"""A bell within a cap of rings, or a cup of scattered elements, and its record in closed form."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxtat.geometry.elements import across
from jaxtat.spherical import SolidBells, ball, spherical_cap

CENTER = np.array([0.02, -0.01, 0.03])
CAP = spherical_cap(0.04, 0.03, 13, 28, center=CENTER)
BELL = SolidBells((CENTER + np.array([0.001, -0.001, 0.0005]))[None], [0.018])
REGION, RADIUS = ball(0.02, center=CENTER), 0.02
MAX_FREQUENCY = 8 * np.pi / 0.04
SOUND, RATE = 1500.0, 4e6


def shuffled(upside_down=False):
    """Positions in an arbitrary order, and that order."""
    points = np.asarray(CAP.points).reshape(-1, 3)
    order = np.random.default_rng(0).permutation(len(points))
    sign = [1.0, 1.0, -1.0 if upside_down else 1.0]
    return ((points - CENTER) * sign + CENTER)[order], order


def record(points=None, samples=range(250)):
    """p = ((d - t) h(d - t) + (d + t) h(d + t)) / 2d of the bell, about every detector."""
    points = shuffled()[0] if points is None else points
    tau = SOUND / RATE * np.asarray(samples)
    d = np.linalg.norm(points - np.asarray(BELL.centers[0]), axis=1)[:, None]

    def h(s):
        return np.asarray(BELL._profile(jax.device_put(np.abs(s) / float(BELL.radii[0]))))

    return ((d - tau) * h(d - tau) + (d + tau) * h(d + tau)) / (2 * d)


def wide_record(points, normals, width, samples):
    """Of square elements, by Gauss's rule of four points of each."""
    steps = np.array([-1, 1]) / np.sqrt(12)
    return record_over([(x, y) for x in steps for y in steps], points, normals, width, samples)


def round_record(points, normals, radius, samples):
    """Of disks, by the midpoints of a square lattice that lie in them."""
    steps = np.arange(-3, 4) / 3.5
    inside = [(x, y) for x in steps for y in steps if x**2 + y**2 < 1]
    return record_over(inside, points, normals, radius, samples)


def record_over(places, points, normals, size, samples):
    """The mean over places of an element, (along, aside) in units of its size."""
    along, aside = (np.asarray(v) * size for v in across(jnp.asarray(normals)))
    return np.mean([record(points + x * along + y * aside, samples) for x, y in places], axis=0)


def cup(n, bent=0.9):
    """Elements at Fibonacci's points of a cap, on no rings."""
    height = -1 + (np.arange(n) + 0.5) / n * bent
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    across = np.sqrt(1 - height**2)
    return CENTER + 0.04 * np.stack([across * np.cos(turn), across * np.sin(turn), height], 1)
