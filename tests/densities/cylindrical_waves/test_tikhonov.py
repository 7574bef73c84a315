"""The regularised systems against dense ones made of potentials on the boundary."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import circular_arc, detector_curve, disk
from jaxtat.densities.cylindrical_waves import (
    RuleInputs,
    circular_harmonics_at,
    polar_geometry,
    solve_cylindrical_waves,
    wave_orders,
    wave_table,
)
from jaxtat.densities.cylindrical_waves.normal_equations import _product_of_grams, detector_gram
from jaxtat.densities.cylindrical_waves.table import circle_gram, detector_matrix
from jaxtat.densities.single_layer import plane_wave_traces, potential_matrix
from jaxtat.geometry.curves import SampledCurve
from jaxtat.regularization import tikhonov_rule

matrix_of, traces_of = jax.jit(potential_matrix), jax.jit(plane_wave_traces)
FREQUENCIES = np.array([2.0, 5.0, 9.0])
ANGLES = np.array([0.0, 0.4, 1.1, 2.5])
N = 41  # detectors, of which one is on the axis of mirrored curves
CENTER, TURN = jnp.array([0.3, -0.2]), 0.8
PLACE = {"center": CENTER, "angle": TURN}


def ellipse(jitter):
    """Detectors off a circle, mirrored about an axis if there is no jitter."""
    theta = np.pi + np.linspace(-2.0, 2.0, N)
    local = np.stack([1.6 * np.cos(theta), 1.5 * np.sin(theta)], axis=1)
    local += np.random.default_rng(1).uniform(-jitter, jitter, (N, 2))
    c, s = np.cos(TURN), np.sin(TURN)
    curve = detector_curve(local @ np.array([[c, s], [-s, c]]) + np.asarray(CENTER))
    # arcs through three neighbours are not mirrored to rounding
    weights = curve.weights if jitter else (curve.weights + curve.weights[::-1]) / 2
    return SampledCurve(curve.points, weights, curve.normals, curve.closed)


ARC = circular_arc(1.5, 1.1, N, **PLACE)
DISK = disk(1.0, n_boundary=200, **PLACE)
HALF = disk(1.0, 0.1, n_boundary=200, **PLACE)
ASKEW = disk(0.9, 0.1, n_boundary=200, center=CENTER + 0.05)
# curve, region, and what kind it is: (mirror, disk, on_circle)
GEOMETRIES = {
    "disk": (ARC, DISK, (True, True, True)),
    "half disk": (circular_arc(1.5, 0.1, N, **PLACE), HALF, (True, False, True)),
    "askew half disk": (ARC, ASKEW, (False, False, True)),
    "disk, measured detectors": (ellipse(0.02), DISK, (False, True, False)),
    "half disk, mirrored ellipse": (ellipse(0.0), HALF, (True, False, False)),
}


def some_data(curve, images=2):
    """(G_J, G_Y) of no particular image, (frequencies, images, 2, detectors)."""
    shape = (len(FREQUENCIES), images, 2, curve.n_detectors)
    return jnp.asarray(np.random.default_rng(0).standard_normal(shape))


solve_compiled = eqx.filter_jit(solve_cylindrical_waves)


def solve(polar, transformed, groups, alpha=1e-6):
    ones = jnp.ones(len(FREQUENCIES))
    inputs = RuleInputs(ones, ones, tikhonov_rule(alpha, len(FREQUENCIES)))
    table = wave_table(polar, jnp.asarray(FREQUENCIES), groups[-1][-1])
    return solve_compiled(polar, table, groups, transformed, inputs)


def one_group(polar):
    """All frequencies with the orders of the neediest: one thing to compile."""
    return ((0, len(FREQUENCIES), int(wave_orders(polar, FREQUENCIES).max())),)


@eqx.filter_jit
def at_angles(polar, region, harmonics):
    """fhat, its phases counted from the region's centre, (images, frequencies, directions)."""
    directions = jnp.stack([jnp.cos(ANGLES), jnp.sin(ANGLES)], axis=-1)
    along = directions @ (region.center - polar.center)
    fhat = circular_harmonics_at(harmonics, ANGLES - polar.axis)
    return fhat * jnp.exp(1j * FREQUENCIES[:, None] * along)


def dense(curve, region, transformed, alphas):
    """fhat = rho·√w G / 2π with rho = A^T (A A^T + alpha)^-1 u, A of the boundary points."""
    found = []
    for lam, data, alpha in zip(FREQUENCIES, np.asarray(transformed), alphas, strict=True):
        a = np.asarray(matrix_of(lam, curve, region))
        u = np.asarray(traces_of(lam, ANGLES, region))
        rho = a.T @ np.linalg.solve(a @ a.T + float(alpha) * np.eye(len(a)), u)
        scaled = np.sqrt(curve.weights) * data
        found.append(scaled.reshape(len(data), -1) @ rho / (2 * np.pi))
    return np.stack(found, axis=1)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_against_a_dense_solution_on_the_boundary(name):
    """In every kind of geometry fhat is that of the densities of the collocation matrix."""
    curve, region, kind = GEOMETRIES[name]
    polar = polar_geometry(curve, region)
    assert (polar.mirror, polar.disk, polar.on_circle) == kind
    transformed = some_data(curve)
    harmonics, report = solve(polar, transformed, one_group(polar))
    expected = dense(curve, region, transformed, np.asarray(report.alpha))
    found = at_angles(polar, region, harmonics)
    # 3e-12: truncation of the waves at 1e-12, and boundary points that resolve them all
    np.testing.assert_allclose(found, expected, atol=2e-11 * np.abs(expected).max())
    assert np.all(report.converged) and np.asarray(report.residual).max() < 1e-10


def test_groups_of_frequencies_change_nothing():
    """Every frequency with its own orders gives what the orders of the highest give."""
    curve, region, _ = GEOMETRIES["disk"]
    polar = polar_geometry(curve, region)
    orders = wave_orders(polar, FREQUENCIES)
    groups = ((0, 1, int(orders[0])), (1, 3, int(orders[2])))
    assert orders[0] < orders[2]
    transformed = some_data(curve)
    apart, _ = solve(polar, transformed, groups)
    together, _ = solve(polar, transformed, one_group(polar))
    assert apart.shape == together.shape
    assert not np.asarray(apart)[:, 0, :, int(orders[0]) + 1 :].any()
    fhat = [np.asarray(at_angles(polar, region, found)) for found in (apart, together)]
    assert np.abs(fhat[0] - fhat[1]).max() < 1e-11 * np.abs(fhat[0]).max()


@pytest.mark.parametrize("n_detectors", [N, 19])
def test_product_of_gram_matrices_on_half_a_circle(n_detectors):
    """Half of it is enough, if the detectors are more than the orders."""
    curve = circular_arc(1.5, 0.0, n_detectors, **PLACE)
    polar = polar_geometry(curve, disk(1.0, 0.0, n_boundary=200, **PLACE))
    assert polar.half_turn and polar.mirror
    outer = np.random.default_rng(0).standard_normal((2, 25, 25))
    table = wave_table(polar, jnp.asarray(FREQUENCIES), 24)

    @jax.jit
    def product_and_waves(outer):
        wave = jax.tree.map(lambda leaf: leaf[1], table)
        inner = detector_gram(polar, wave, circle_gram(polar, 24))
        return _product_of_grams(polar, inner, outer), detector_matrix(polar, wave)

    found, waves = map(np.asarray, product_and_waves(outer))
    waves = waves * np.sqrt(curve.weights)
    expected = np.einsum("jbrk,jbsk,bst->brt", waves, waves, outer, optimize=True)
    np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max())


def test_nothing_comes_of_nothing_and_nan_is_no_solution():
    """Zero data give zero, solved; NaN in one frequency is reported there and only there."""
    curve, region, _ = GEOMETRIES["disk"]
    polar = polar_geometry(curve, region)
    zero = jnp.zeros((len(FREQUENCIES), 2, 2, N))
    harmonics, report = solve(polar, zero, one_group(polar))
    assert not np.any(harmonics) and np.all(report.converged) and not np.any(report.residual)
    broken = np.array(some_data(curve))
    broken[1, 0, 0, 0] = np.nan
    _, report = solve(polar, jnp.asarray(broken), one_group(polar))
    assert report.converged.tolist() == [True, False, True]
