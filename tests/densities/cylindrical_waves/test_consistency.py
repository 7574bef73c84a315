"""What no image explains: against a dense least-squares problem, and on exact data."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import circular_arc, disk, phantoms
from jaxtat.densities.cylindrical_waves import (
    cross_validation,
    polar_geometry,
    unexplained,
    unexplained_share,
    wave_table,
    waves_of,
)
from jaxtat.densities.cylindrical_waves.table import (
    alpha_unit,
    detector_matrix,
    detector_powers,
    region_factor,
)
from jaxtat.geometry import detector_curve
from jaxtat.steps import radial_transform

ARC = circular_arc(1.3, 0.6, 20)
DISK = disk(0.8, n_boundary=60)
FREQUENCIES = jnp.array([2.0, 7.0])
ALPHA, N_MAX = jnp.array(1e-3), 14
ALPHAS = np.geomspace(1e-7, 10, 81)
GEOMETRIES = {
    "disk within an arc": (ARC, DISK),
    "cut disk within an arc": (ARC, disk(0.8, 0.3, n_boundary=60)),
    "off a circle": (
        detector_curve(ARC.points * jnp.array([1.2, 1.0])),
        disk(0.8, n_boundary=60),
    ),
}


validated, shared = eqx.filter_jit(cross_validation), eqx.filter_jit(unexplained_share)


@eqx.filter_jit
def explained(geometry, frequencies, n_max, data, alpha):
    return unexplained(geometry, waves_of(geometry, frequencies, n_max), data, alpha)


@eqx.filter_jit
def parts_of(geometry):
    """Potentials by waves, (frequencies, J and Y, waves, detectors), and the units of alpha."""

    def at(wave):
        factor, matrix = region_factor(geometry, wave), detector_matrix(geometry, wave)
        each = jnp.stack([factor.matrix_times(matrix[j]).reshape(-1, 20) for j in range(2)])
        return each, alpha_unit(factor.powers, detector_powers(geometry, wave))

    return jax.lax.map(at, wave_table(geometry, FREQUENCIES, N_MAX))


def dense(geometry):
    """A, (waves, J and Y of the detectors), and the unit of alpha at each frequency."""
    root = np.sqrt(np.asarray(geometry.weights))
    for matrices, unit in zip(*map(np.asarray, parts_of(geometry)), strict=True):
        yield np.concatenate(list(matrices * root), axis=1), float(unit)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_it_is_what_dense_least_squares_leave(name):
    geometry = polar_geometry(*GEOMETRIES[name])
    data = np.random.default_rng(0).standard_normal((2, 2, 20))
    left, penalty = map(np.asarray, explained(geometry, FREQUENCIES, N_MAX, data, ALPHA))
    root = np.sqrt(np.asarray(geometry.weights))
    for i, (waves, unit) in enumerate(dense(geometry)):
        a = waves.T  # (J and Y, waves)
        squares = np.sqrt(float(ALPHA) * unit) * np.eye(a.shape[1])
        right = (data[i] * root).ravel()
        stacked = np.concatenate([a, squares]), np.concatenate([right, np.zeros(a.shape[1])])
        y = np.linalg.lstsq(*stacked, rcond=None)[0]
        assert np.allclose(left[i].ravel(), right - a @ y, atol=1e-9)
        assert np.allclose(penalty[i].ravel(), squares.diagonal() * y, atol=1e-9)


def test_the_share_of_sets_of_data_is_that_of_each():
    """Of detectors off a circle, where a set's sums are taken frequency by frequency."""
    geometry = polar_geometry(*GEOMETRIES["off a circle"])
    sets = np.random.default_rng(3).standard_normal((3, 2, 2, 20))
    found = shared(geometry, waves_of(geometry, FREQUENCIES, N_MAX), jnp.asarray(sets), ALPHA)
    for number, data in enumerate(sets):
        left, penalty = map(np.asarray, explained(geometry, FREQUENCIES, N_MAX, data, ALPHA))
        misfit = np.sum(left**2, axis=(1, 2)) + np.sum(penalty**2, axis=(1, 2))
        power = np.sum(np.asarray(geometry.weights) * data**2, axis=(1, 2))
        np.testing.assert_allclose(found[:, number], misfit / power, atol=1e-9)


def test_exact_data_are_explained_but_not_with_a_wrong_speed():
    curve = circular_arc(1.3, 1.0, 130)
    geometry = polar_geometry(curve, disk(1.0))
    radii = 0.3 + np.arange(257) / 128
    g = phantoms.Bells([[0.3, -0.2]], [0.5]).circular_integrals(curve, jnp.asarray(radii))
    frequencies = jnp.array([3.0, 20.0])

    def share(stretch):
        data = radial_transform(g, jnp.asarray(stretch * radii), frequencies)
        left, _ = explained(geometry, frequencies, 80, data, jnp.array(1e-9))
        whole = np.sqrt(curve.weights) * np.asarray(data)
        return np.linalg.norm(left, axis=(1, 2)) / np.linalg.norm(whole, axis=(1, 2))

    assert np.all(share(1.0) < 1e-6)
    assert np.all(share(1.01) > 5e-3)


@pytest.mark.parametrize("name", ["disk within an arc", "off a circle"])
def test_cross_validation_is_that_of_the_dense_matrix(name):
    geometry = polar_geometry(*GEOMETRIES[name])
    data = np.random.default_rng(1).standard_normal((2, 2, 20))
    found = np.asarray(validated(geometry, waves_of(geometry, FREQUENCIES, N_MAX), data, ALPHAS))
    for i, (a, unit) in enumerate(dense(geometry)):
        d = (data[i] * np.sqrt(np.asarray(geometry.weights))).ravel()
        for k in (10, 30, 50, 70):
            hat = a.T @ np.linalg.solve(a @ a.T + ALPHAS[k] * unit * np.eye(len(a)), a)
            rest = d - hat @ d
            expected = (rest @ rest) / (d @ d) / (1 - np.trace(hat) / 40) ** 2
            assert found[i, k] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("name", ["disk within an arc", "off a circle"])
@pytest.mark.parametrize("alpha", [1e-5, 1e-3, 1e-1])
def test_it_finds_the_alpha_of_random_waves_and_noise(name, alpha):
    """In the mean over 100 data sets, to a third of a decade."""
    geometry = polar_geometry(*GEOMETRIES[name])
    systems, root = list(dense(geometry)), np.sqrt(np.asarray(geometry.weights))
    rng, total = np.random.default_rng(0), 0.0
    waves = waves_of(geometry, FREQUENCIES, N_MAX)
    for _ in range(100):
        drawn = []
        for a, unit in systems:
            noise = np.sqrt(alpha * unit) * rng.standard_normal(40)
            drawn.append((a.T @ rng.standard_normal(len(a)) + noise).reshape(2, 20))
        found = validated(geometry, waves, np.array(drawn) / root, ALPHAS)
        total += np.log(np.asarray(found)).sum(axis=0)
    assert abs(np.log10(ALPHAS[np.argmin(total)] / alpha)) < 1 / 3
