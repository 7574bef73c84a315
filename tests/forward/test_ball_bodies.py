"""Waves through a ball of another speed of sound: the series at its surface, transpose, slopes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special as sp

from jaxtat import VolumeGrid
from jaxtat.forward import sphere_integrals, sphere_sizes
from jaxtat.geometry import spherical_cap
from jaxtat.spherical import BallBody

RADIUS, OFF = 0.5, np.array([0.06, -0.03, 0.1])
CAP = spherical_cap(1.0, 0.6, 3, 4)
RADII = jnp.linspace(0.4, 2.0, 9)
VOXELS = {(2, 2, 3): 1.0, (1, 3, 3): -0.6, (3, 4, 2): 0.8}  # that are not zero


def volume():
    values = np.zeros((6, 6, 6))
    for where, height in VOXELS.items():
        values[where] = height
    return jnp.asarray(values)


def grid_about(center):
    return VolumeGrid(6, 0.3, center)


def sizes_of(body):
    return sphere_sizes(CAP, grid_about(body.center), body, tolerance=1e-11, n_groups=1)


@eqx.filter_jit
def both_ways(sizes, body, center, data, known=None):
    """G of the voxels at each frequency, their data, and the transpose of other data."""
    body = body if known is None else known()
    made = sphere_integrals(CAP, grid_about(center), RADII, sizes, None, 1e-11, body)
    waves = eqx.tree_at(lambda one: one.series, made, jnp.eye(sizes.n_frequencies) * made.voxel)
    back = jax.linear_transpose(made, jax.ShapeDtypeStruct((1, 6, 6, 6), float))(data)[0]
    return waves(volume()[None])[0], made(volume()[None]), back


def series(body, frequencies):
    """Σ_l (2l + 1) t_l j_l(k_1 |x|) h_l(k_2 |z|) P_l of the voxels, by equations at the surface."""
    grid, center = grid_about(body.center), np.asarray(body.center)
    c, density, spacing = *map(float, (body.speed_ratio, body.density_ratio)), grid.spacing
    z = np.asarray(CAP.points) - center
    far, degree, found = np.linalg.norm(z, axis=-1), np.arange(45), []
    for k in np.asarray(frequencies):
        inner, outer = k / c * RADIUS, k * RADIUS
        waves, slopes = (sp.spherical_jn(degree, outer, d) + 0j for d in (False, True))
        waves += 1j * sp.spherical_yn(degree, outer)
        slopes += 1j * sp.spherical_yn(degree, outer, True)
        here = sp.spherical_jn(degree, inner)
        there = inner / density * sp.spherical_jn(degree, inner, True)
        total = 0
        for where, height in VOXELS.items():
            x = np.asarray(grid.points)[where] - center
            near = np.linalg.norm(x)
            for n in degree[: int(k) + 25]:
                # t_l inside is the incident wave and b_l h_l outside
                matrix = [[here[n], -waves[n]], [there[n], -outer * slopes[n]]]
                rhs = sp.spherical_jn(n, outer), outer * sp.spherical_jn(n, outer, True)
                t = np.linalg.solve(matrix, rhs)[0]
                h = sp.spherical_jn(n, k * far) + 1j * sp.spherical_yn(n, k * far)
                legendre = sp.eval_legendre(n, z @ x / far / near)
                total += height * (2 * n + 1) * t * sp.spherical_jn(n, k / c * near) * h * legendre
        found.append(total.real)
    return np.stack(found, axis=-1) * np.prod(spacing) / (c**2 * density)


@pytest.mark.parametrize(
    ("center", "speed", "density"),
    [(np.zeros(3), 1.04, 1.0), (OFF, 0.9, 1.1)],
    ids=["concentric", "slower, denser, off the centre"],
)
def test_waves_at_the_detectors_are_those_of_the_series(center, speed, density):
    """A ball in a ball in closed form: every frequency, and the transpose."""
    body = BallBody(center, RADIUS, speed, 1.0, density)
    sizes = sizes_of(body)
    known = None if center is OFF else lambda: body  # a known centre keeps the rings
    data = jnp.asarray(np.random.default_rng(0).standard_normal((1, *CAP.shape, len(RADII))))
    found, g, back = both_ways(sizes, body, center, data, known)
    wanted = series(body, sizes.frequencies)
    assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max()
    assert np.isclose(np.vdot(g, data), np.vdot(volume(), back), rtol=1e-11)


@pytest.mark.slow
def test_derivatives_in_the_numbers_of_the_body(check_both_modes):
    """Against differences: c_1, c_2, a, densities and centre."""
    at = jnp.array([1.04, 1.0, RADIUS, 1.1, *OFF])

    def body_of(x):
        return BallBody(x[4:], x[2], x[0], x[1], x[3])

    sizes = sizes_of(body_of(at))
    weights = jnp.asarray(np.random.default_rng(1).standard_normal((*CAP.shape, len(RADII))))

    def summed(x):
        grid = grid_about(OFF)
        made = sphere_integrals(CAP, grid, RADII, sizes, None, 1e-11, body_of(x))
        return jnp.vdot(weights, made(volume()[None])[0])

    check_both_modes(summed, (at,), step=1e-5, rtol=1e-6, atol=1e-6)
