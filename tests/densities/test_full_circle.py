"""The closed series on a full circle: exact plane waves, least norm, and a reconstruction."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    Setup,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    phantoms,
    reconstruct,
)
from jaxtat.densities.full_circle import full_circle_densities
from jaxtat.densities.single_layer import potential, potential_matrix
from jaxtat.special import full_circle_norm

ANGLES = np.array([0.0, 0.7, 2.5])
N, N_ORDERS = 663, 332  # for the highest frequency; of the lowest most terms have saturated
DETECTOR_ANGLES = (np.arange(N) + 0.5) * 2 * np.pi / N
matrix_of, potential_of = jax.jit(potential_matrix), jax.jit(potential)


def densities_of(frequency):
    where = ANGLES, DETECTOR_ANGLES, np.array(1.3)
    return full_circle_densities(np.array(frequency), *where, n_orders=N_ORDERS)


@pytest.mark.parametrize("lam", [0.3, 5.0, 30.0, 64 * np.pi])
def test_potential_of_the_series_is_the_plane_wave_to_rounding(lam):
    rng = np.random.default_rng(0)
    r, t = np.sqrt(rng.uniform(0, 1, 60)), rng.uniform(0, 2 * np.pi, 60)
    points = np.stack([r * np.cos(t), r * np.sin(t)], axis=1)
    u = potential_of(lam, densities_of(lam), circular_arc(1.3, 1.3, N), points)
    wave = np.exp(-1j * lam * points @ np.stack([np.cos(ANGLES), np.sin(ANGLES)]))
    assert np.abs(u - wave).max() < 1e-12


def test_its_norm_is_that_of_the_least_solution():
    lam = 6.0
    curve, region = circular_arc(1.3, 1.3, N), disk(1.0, n_boundary=160)
    rho = np.asarray(densities_of(lam))
    norm = np.sqrt(np.sum(np.abs(rho) ** 2 * curve.weights, axis=(1, 2)))
    assert np.allclose(norm, full_circle_norm(lam, 1.3), rtol=1e-12)
    # the pseudo-inverse, whose solution is the least by definition, agrees where it is resolved
    a = np.asarray(matrix_of(lam, curve, region))
    traces = a @ (rho[1] * np.sqrt(curve.weights)).ravel()
    least = np.linalg.pinv(a, rcond=1e-10) @ traces
    assert np.isclose(np.linalg.norm(least), norm[1], rtol=1e-6)


@pytest.mark.slow
def test_a_full_circle_reconstructs_without_solving_anything():
    grid = ImageGrid(45)
    center = (0.2, -0.1)
    curve = circular_arc(1.3, 1.3, 220, center=center)
    region = disk(1.0, n_boundary=300, center=(0.25, -0.1))
    radii = data_radii(curve, region, grid.spacing[0])
    plan = build_plan(Setup(curve, region, grid, radii), method="series")
    assert np.max(plan.report.residual) < 1e-10
    power = np.sum(np.abs(plan.densities.values) ** 2 * curve.weights, axis=(2, 3))
    assert np.allclose(plan.report.norm, np.sqrt(power), rtol=1e-10)
    bell = phantoms.Bells([[0.4, 0.0], [0.1, -0.2]], [0.8, 0.75])
    image = reconstruct(plan, bell.circular_integrals(curve, radii))
    error = np.abs(image - np.asarray(bell.image(grid)))[region.contains(grid.points)]
    assert error.max() < 1e-6


def test_other_curves_are_refused(arc):
    with pytest.raises(ValueError, match="open"):
        build_plan(arc, method="series")


def test_derivatives_in_frequency_radius_and_angles(check_both_modes):
    at = 2 * jnp.pi / 9 * jnp.arange(9)

    def rho(frequency, radius, angles):
        values = full_circle_densities(frequency, angles, at, radius, 30)
        return values.real, values.imag

    check_both_modes(rho, (6.0, 1.3, ANGLES), 1e-4)
