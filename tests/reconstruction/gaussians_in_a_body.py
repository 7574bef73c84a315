"""Gaussians in a disk of another speed of sound, and their data in closed form.

With scipy's functions: for f = exp(-|x - s|² / 2 b²) the integral of f J_n(k |x|) e^{in theta} is
2π b² exp(-k² b²/2) J_n(k |s|) e^{in theta_s}.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.special as sp

from jaxtat import DiskBody, ImageGrid, circular_arc, disk
from jaxtat.forward import circle_integrals

CENTER, RADIUS, WIDTH = np.array([0.1, -0.06]), 0.45, 0.05
AWAY, HEIGHTS = np.array([(0.12, 0.1), (-0.15, -0.08)]), np.array([1.0, -0.6])  # from the centre
CURVE = circular_arc(1.0, np.cos(np.pi / 4), 90)  # 270 degrees
RADII = np.arange(0.4, 2.6, 1 / 40)
GRID = ImageGrid(37, 0.45, CENTER)
INSIDE = np.asarray(disk(0.42, center=CENTER).contains(GRID.points))


def body(sound_speed=1.04, density=1.0, center=CENTER):
    return DiskBody(center, RADIUS, sound_speed, 1.0, density)


def gaussians(grid, center=CENTER):
    sources = np.asarray(center) + AWAY
    square = np.sum((np.asarray(grid.points)[..., None, :] - sources) ** 2, axis=-1)
    return np.exp(-square / 2 / WIDTH**2) @ HEIGHTS


def series(medium, points, outside):
    """G of the Gaussians at frequencies in water, (frequencies, points): by the rim's equations.

    Terms of the orders n and -n differ by the sign of their angles alone.
    """
    c, density = float(medium.sound_speed), float(medium.density_ratio)
    n, a = np.arange(71), RADIUS
    both = np.where(n > 0, 2.0, 1.0)
    z = points - np.asarray(medium.center)
    turn = np.arctan2(z[:, 1], z[:, 0]) - np.arctan2(AWAY[:, 1], AWAY[:, 0])[:, None]
    turns, found = np.cos(n[:, None] * turn[:, None]), []
    for k in outside:
        inner = k / c
        bracket = inner / density * sp.jvp(n, inner * a) * sp.hankel1(n, k * a)
        bracket = bracket - k * sp.jv(n, inner * a) * sp.h1vp(n, k * a)
        waves = -2j / np.pi / a / bracket * sp.hankel1(n, k * np.hypot(*z.T)[:, None])
        waves = np.where(np.isfinite(waves), waves, 0)
        size = 2 * np.pi * WIDTH**2 * np.exp(-((inner * WIDTH) ** 2) / 2) * HEIGHTS
        inside = sp.jv(n, inner * np.hypot(*AWAY.T)[:, None]) * size[:, None]
        found.append(np.einsum("sn,kn,snk->k", both * inside, waves, turns))
    return np.stack(found) / (c**2 * density)


@eqx.filter_jit
def waves_at_the_detectors(setup, grid, medium, image):
    """G of an image at each frequency of a setup, (frequencies, detectors)."""
    sizes = setup.sizes.operator
    where = setup.curve, grid, setup.radii, sizes, None, 1e-12, medium
    integrals = circle_integrals(*where)
    apart = eqx.tree_at(lambda tree: tree.series, integrals, jnp.eye(sizes.n_frequencies))
    return apart(image[None])[0].T * medium.source_strength
