"""What no image explains: against a dense least-squares problem, and on exact data."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import circular_arc, disk, phantoms
from jaxtat.densities.harmonic import (
    cross_validation,
    polar_geometry,
    unexplained,
    unexplained_share,
    wave_table,
)
from jaxtat.densities.harmonic.table import (
    alpha_unit,
    detector_matrix,
    detector_powers,
    region_factor,
)
from jaxtat.geometry import detector_curve, turned_views
from jaxtat.steps import radial_transform

ARC = circular_arc(1.3, 0.6, 20)
DISK = disk(0.8, n_boundary=60)
FREQUENCIES = jnp.array([2.0, 7.0])
ALPHA, N_MAX = jnp.array(1e-3), 14
GEOMETRIES = {
    "disk within an arc": (ARC, DISK),
    "cut disk within an arc": (ARC, disk(0.8, 0.3, n_boundary=60)),
    "off a circle": (
        detector_curve(ARC.points * jnp.array([1.2, 1.0])),
        disk(0.8, n_boundary=60),
    ),
}


explained, validated = eqx.filter_jit(unexplained), eqx.filter_jit(cross_validation)
shared = eqx.filter_jit(unexplained_share)


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
    for matrices, unit in zip(*parts_of(geometry), strict=True):
        yield np.concatenate(list(np.asarray(matrices) * root), axis=1), float(unit)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_it_is_what_dense_least_squares_leave(name):
    geometry = polar_geometry(*GEOMETRIES[name])
    data = jax.random.normal(jax.random.key(0), (2, 2, 20))
    left, penalty = explained(geometry, FREQUENCIES, N_MAX, data, ALPHA)
    root = np.sqrt(np.asarray(geometry.weights))
    for i, (matrices, unit) in enumerate(zip(*parts_of(geometry), strict=True)):
        a = np.concatenate(list(np.asarray(matrices) * root), axis=1).T  # (J and Y, waves)
        squares = np.sqrt(float(ALPHA * unit)) * np.eye(a.shape[1])
        right = (np.asarray(data[i]) * root).ravel()
        stacked = np.concatenate([a, squares]), np.concatenate([right, np.zeros(a.shape[1])])
        y = np.linalg.lstsq(*stacked, rcond=None)[0]
        assert np.allclose(left[i].ravel(), right - a @ y, atol=1e-9)
        assert np.allclose(penalty[i].ravel(), squares.diagonal() * y, atol=1e-9)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_the_share_of_sets_of_data_is_that_of_each(name):
    geometry = polar_geometry(*GEOMETRIES[name])
    sets = jax.random.normal(jax.random.key(3), (3, 2, 2, 20))
    found = shared(geometry, FREQUENCIES, N_MAX, sets, ALPHA)
    for number, data in enumerate(sets):
        left, penalty = explained(geometry, FREQUENCIES, N_MAX, data, ALPHA)
        misfit = jnp.sum(left**2, axis=(1, 2)) + jnp.sum(penalty**2, axis=(1, 2))
        power = jnp.sum(geometry.weights * data**2, axis=(1, 2))
        np.testing.assert_allclose(found[:, number], misfit / power, atol=1e-9)


def test_exact_data_are_explained_but_not_with_a_wrong_speed():
    curve = circular_arc(1.3, 1.0, 130)
    geometry = polar_geometry(curve, disk(1.0))
    radii = 0.3 + jnp.arange(257) / 128
    g = phantoms.Bells([[0.3, -0.2]], [0.5]).circular_integrals(curve, radii)
    frequencies = jnp.array([3.0, 20.0])

    def share(stretch):
        data = radial_transform(g, stretch * radii, frequencies)
        left, _ = explained(geometry, frequencies, 80, data, jnp.array(1e-9))
        whole = jnp.sqrt(curve.weights) * data
        return jnp.linalg.norm(left, axis=(1, 2)) / jnp.linalg.norm(whole, axis=(1, 2))

    assert np.all(share(1.0) < 1e-6)
    assert np.all(share(1.01) > 5e-3)


def test_derivatives_in_places_and_data(check_both_modes):
    data = jax.random.normal(jax.random.key(1), (2, 2, 40))
    direction = jax.random.normal(jax.random.key(2), (2, 2, 40))

    def parts(center, radius, size):
        arc = circular_arc(1.3, 0.6, 20)
        arc = eqx.tree_at(lambda arc: (arc.center, arc.radius), arc, (center, radius))
        geometry = polar_geometry(turned_views(arc, jnp.array([0.0, 2.0])), DISK)
        return unexplained(geometry, FREQUENCIES, N_MAX, data + size * direction, ALPHA)

    at = jnp.array([0.05, -0.02]), jnp.array(1.3), jnp.array(0.1)
    check_both_modes(parts, at, 1e-4)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_cross_validation_is_that_of_the_dense_matrix(name):
    geometry = polar_geometry(*GEOMETRIES[name])
    data = jax.random.normal(jax.random.key(1), (2, 2, 20))
    alphas = jnp.array([1e-6, 1e-4, 1e-2, 1.0])
    found = validated(geometry, FREQUENCIES, N_MAX, data, alphas)
    for i, (a, unit) in enumerate(dense(geometry)):
        d = (np.asarray(data[i]) * np.sqrt(np.asarray(geometry.weights))).ravel()
        for k, alpha in enumerate(np.asarray(alphas) * unit):
            hat = a.T @ np.linalg.solve(a @ a.T + alpha * np.eye(len(a)), a)
            rest = d - hat @ d
            expected = (rest @ rest) / (d @ d) / (1 - np.trace(hat) / 40) ** 2
            assert found[i, k] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("name", GEOMETRIES)
@pytest.mark.parametrize("alpha", [1e-5, 1e-3, 1e-1])
def test_it_finds_the_alpha_of_random_waves_and_noise(name, alpha):
    """In the mean over 100 data sets, to a third of a decade."""
    geometry = polar_geometry(*GEOMETRIES[name])
    rng, alphas, total = np.random.default_rng(0), np.geomspace(1e-7, 10, 81), 0.0
    for _ in range(100):
        drawn = []
        for a, unit in dense(geometry):
            noise = np.sqrt(alpha * unit) * rng.standard_normal(40)
            drawn.append((a.T @ rng.standard_normal(len(a)) + noise).reshape(2, 20))
        data = jnp.array(drawn) / np.sqrt(np.asarray(geometry.weights))
        found = validated(geometry, FREQUENCIES, N_MAX, data, jnp.array(alphas))
        total += np.log(np.asarray(found)).sum(axis=0)
    assert abs(np.log10(alphas[np.argmin(total)] / alpha)) < 1 / 3
