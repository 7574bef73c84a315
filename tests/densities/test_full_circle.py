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
from jaxtat.densities.single_layer import plane_wave, potential, potential_matrix
from jaxtat.special import full_circle_norm

ANGLES = jnp.array([0.0, 0.7, 2.5])
densities_of = jax.jit(full_circle_densities, static_argnums=4)


def detector_angles(n):
    return (jnp.arange(n) + 0.5) * 2 * jnp.pi / n


@pytest.mark.parametrize("lam", [0.3, 5.0, 30.0, 64 * np.pi])
def test_potential_of_the_series_is_the_plane_wave_to_rounding(lam):
    n = int(2.6 * lam) + 140
    rho = densities_of(
        jnp.array(lam), ANGLES, detector_angles(n), jnp.array(1.3), int(1.3 * lam * 1.12) + 40
    )
    rng = np.random.default_rng(0)
    r, t = np.sqrt(rng.uniform(0, 1, 60)), rng.uniform(0, 2 * np.pi, 60)
    points = jnp.asarray(np.stack([r * np.cos(t), r * np.sin(t)], axis=1))
    u = jax.jit(potential)(jnp.array(lam), rho, circular_arc(1.3, 1.3, n), points)
    assert jnp.abs(u - plane_wave(jnp.array(lam), ANGLES, points)).max() < 1e-12


def test_its_norm_is_that_of_the_least_solution():
    lam, n = 6.0, 64
    curve, region = circular_arc(1.3, 1.3, n), disk(1.0, n_boundary=160)
    rho = densities_of(jnp.array(lam), ANGLES, detector_angles(n), jnp.array(1.3), 60)
    norm = jnp.sqrt(jnp.sum(jnp.abs(rho) ** 2 * curve.weights, axis=(1, 2)))
    assert np.allclose(norm, full_circle_norm(jnp.array(lam), 1.3), rtol=1e-12)
    # the pseudo-inverse, whose solution is the least by definition, agrees where it is resolved
    a = np.asarray(jax.jit(potential_matrix)(jnp.array(lam), curve, region))
    traces = a @ np.asarray((rho[1] * jnp.sqrt(curve.weights)).ravel())
    least = np.linalg.pinv(a, rcond=1e-10) @ traces
    assert np.isclose(np.linalg.norm(least), float(norm[1]), rtol=1e-6)


def test_a_full_circle_reconstructs_without_solving_anything():
    grid = ImageGrid(65)
    center = (0.2, -0.1)
    curve = circular_arc(1.3, 1.3, 300, center=center)
    region = disk(1.0, n_boundary=400, center=(0.25, -0.1))
    radii = data_radii(curve, region, grid.spacing[0])
    plan = build_plan(Setup(curve, region, grid, radii), method="series")
    assert plan.report.residual.max() < 1e-10
    bell = phantoms.Bells([[0.5, 0.2], [-0.2, -0.1]], [0.5, 0.45])
    image = reconstruct(plan, bell.circular_integrals(curve, radii))
    error = jnp.abs(image - bell.image(grid))[region.contains(grid.points)]
    assert error.max() < 1e-6


def test_other_curves_are_refused():
    region, grid = disk(1.0, n_boundary=100), ImageGrid(9)
    radii = jnp.linspace(0.3, 2.3, 30)
    with pytest.raises(ValueError, match="open"):
        build_plan(Setup(circular_arc(1.3, 1.2, 50), region, grid, radii), method="series")


def test_derivatives_in_frequency_radius_and_angles(check_both_modes):
    def rho(frequency, radius, angles):
        values = full_circle_densities(frequency, angles, detector_angles(9), radius, 30)
        return values.real, values.imag

    arguments = (jnp.array(6.0), jnp.array(1.3), ANGLES)
    check_both_modes(rho, arguments, 1e-4)
