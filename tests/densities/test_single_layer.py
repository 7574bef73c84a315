"""Potential matrices and plane waves against scipy, finite differences and the wave equation."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.special as sp

from jaxtat import circular_arc, disk
from jaxtat.densities.single_layer import plane_wave, plane_wave_traces, potential, potential_matrix

CURVE = circular_arc(1.3, 0.4, 7, center=(0.3, -0.2), angle=0.5)
REGION = disk(1.0, 0.2, n_boundary=12, center=(0.3, -0.2), angle=0.5)
LAM = 9.0
matrix_of, traces_of, potential_of = map(jax.jit, (potential_matrix, plane_wave_traces, potential))


def test_matrix_is_its_formula_entry_by_entry():
    found = np.asarray(matrix_of(LAM, CURVE, REGION))
    points, normals, weights = map(np.asarray, (REGION.points, REGION.normals, REGION.weights))
    for x in range(12):
        for z in range(7):
            d = points[x] - np.asarray(CURVE.points)[z]
            r = np.hypot(*d)
            c = d @ normals[x] / r
            s = np.sqrt(weights[x] * np.asarray(CURVE.weights)[z])
            assert np.isclose(found[x, z], s * sp.j0(LAM * r), atol=1e-14)
            assert np.isclose(found[x, z + 7], s * sp.y0(LAM * r), atol=1e-14)
            assert np.isclose(found[x + 12, z], -s * c * sp.j1(LAM * r), atol=1e-14)
            assert np.isclose(found[x + 12, z + 7], -s * c * sp.y1(LAM * r), atol=1e-14)


def test_columns_of_wide_elements_are_means_of_those_of_points():
    """By brute force: 400 point detectors in place of each element."""
    wide = circular_arc(1.3, 0.4, 7, center=(0.3, -0.2), angle=0.5, element_width=0.25)
    shifts = 0.25 / 1.3 * ((np.arange(400) + 0.5) / 400 - 0.5)
    rho, points = jnp.asarray(random_densities(1)), jnp.array([[0.3, 0.1], [-0.1, -0.4]])

    @jax.jit
    def of(curve):
        lam = jnp.array(LAM)
        return potential_matrix(lam, curve, REGION), potential(lam, rho, curve, points)

    @jax.jit
    def mean_of_points(shifts):
        def turned(shift):
            return of(eqx.tree_at(lambda c: c.angle, CURVE, CURVE.angle + shift))

        return jax.tree.map(lambda leaf: leaf.mean(axis=0), jax.vmap(turned)(shifts))

    (matrix, values), (mean, mean_value) = of(wide), mean_of_points(shifts)
    assert np.allclose(matrix, mean, atol=1e-5)
    assert not np.allclose(matrix_of(LAM, CURVE, REGION), mean, atol=1e-2)
    assert np.allclose(values, mean_value, atol=1e-4)


def random_densities(directions=2):
    rng = np.random.default_rng(0)
    shape = (directions, 2, 7)
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def test_matrix_times_densities_is_the_potential_and_its_normal_derivative():
    rho = random_densities(1)
    unknowns = (rho[0] * np.sqrt(CURVE.weights)).ravel()
    traces = np.asarray(matrix_of(LAM, CURVE, REGION)) @ unknowns
    traces = traces.reshape(2, 12) / np.sqrt(np.asarray(REGION.weights))
    step = 1e-5

    def at(offset):
        points = np.asarray(REGION.points) + offset * np.asarray(REGION.normals)
        return np.asarray(potential_of(LAM, rho, CURVE, points))[:, 0]

    assert np.allclose(traces[0], at(0.0), atol=1e-13)
    assert np.allclose(traces[1], (at(step) - at(-step)) / (2 * step * LAM), atol=1e-8)


def test_potential_solves_the_helmholtz_equation():
    points = np.array([[0.3, 0.1], [-0.1, -0.4]])
    rho, h = random_densities(), 1e-3
    u = [
        np.asarray(potential_of(LAM, rho, CURVE, points + h * np.array(shift)))
        for shift in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    laplacian = (u[1] + u[2] + u[3] + u[4] - 4 * u[0]) / h**2
    assert u[0].shape == (2, 2)
    assert np.allclose(laplacian, -(LAM**2) * u[0], rtol=1e-4, atol=1e-4 * LAM**2)


def test_potential_in_pieces_is_the_potential():
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (3, 5, 2))
    in_pieces = jax.jit(potential, static_argnames="batch_size")
    whole = potential_of(LAM, random_densities(), CURVE, points)
    pieces = in_pieces(LAM, random_densities(), CURVE, points, batch_size=2)
    assert whole.shape == (3, 5, 2)
    assert np.allclose(whole, pieces, atol=1e-14)


def test_plane_wave_traces_are_value_and_normal_derivative():
    angles = np.array([0.0, 1.1, 2.8])
    waves_of = jax.jit(plane_wave)
    from_center = np.asarray(REGION.points) - np.asarray(REGION.center)
    traces = np.asarray(traces_of(LAM, angles, REGION))
    traces = traces.reshape(2, 12, 3) / np.sqrt(np.asarray(REGION.weights))[:, None]
    step = 1e-6

    def at(offset):
        local = from_center + offset * np.asarray(REGION.normals)
        return np.asarray(waves_of(LAM, angles, local))

    xi = LAM * np.stack([np.cos(angles), np.sin(angles)])
    assert np.allclose(at(0.0), np.exp(-1j * from_center @ xi))
    assert np.allclose(traces[0], at(0.0), atol=1e-14)
    assert np.allclose(traces[1], (at(step) - at(-step)) / (2 * step * LAM), atol=1e-8)
