"""Step 5 against exact images, plain loops, and its own adjoint and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.interpolate import BSpline

from jaxtat import ImageGrid, phantoms
from jaxtat.steps import filtered_back_projection
from jaxtat.steps.fbp import (
    OVERSAMPLING,
    _ramp_samples,
    back_project,
    project,
    ramp_matrix,
)

CENTER, WIDTH = np.array([0.3, -0.2]), 0.5
STEP = jnp.array(1 / 64)
OFFSETS = (jnp.arange(256) - 128) * STEP
ANGLES = jnp.arange(256) * jnp.pi / 256
B_SPLINE = BSpline.basis_element(np.arange(-3, 4), extrapolate=False)


def spline(coefficients, position):
    """Σ_j c_j B(position - j), c counted from 0."""
    distance = position[..., None] - np.arange(coefficients.size)
    return np.nan_to_num(B_SPLINE(distance)) @ coefficients


@pytest.mark.parametrize("center", [(0.0, 0.0), (0.2, 0.1)])
def test_back_projection_of_exact_projections_is_the_image(center):
    grid = ImageGrid(65)
    bell = phantoms.Bells([CENTER], [WIDTH])
    p = phantoms.Bells([CENTER - np.array(center)], [WIDTH]).radon(ANGLES, OFFSETS)
    image = filtered_back_projection(p, STEP, ANGLES, grid, jnp.array(center))
    assert np.abs(np.asarray(image - bell.image(grid))).max() < 1e-9


def test_ramp_is_without_a_kink():
    """∫ |k| F(k) e^{iks} dk of the bell by fine quadrature, at nodes and between."""
    at_origin = phantoms.Bells([[0.0, 0.0]], [WIDTH])
    k = jnp.linspace(0, 64 * jnp.pi, 20001)
    weighted = np.asarray(k) * np.asarray(at_origin.fourier(k, jnp.zeros(1)))[:, 0].real
    coefficients = ramp_matrix(256, STEP) @ at_origin.radon(jnp.zeros(1), OFFSETS)[0]
    s = np.array([0.0, 0.0371, -0.4, 0.95])
    exact = 2 * simpson(weighted * np.cos(s[:, None] * np.asarray(k)), k)
    position = s / float(STEP) * OVERSAMPLING + coefficients.size // 2
    assert np.abs(spline(np.asarray(coefficients), position) - exact).max() < 1e-9  # q(0) = 2


def test_back_projection_of_rough_coefficients_agrees_with_a_plain_loop():
    """Rough data show a wrong cell at once; some pixels lie beyond the nodes, some on them."""
    rng = np.random.default_rng(1)
    grid, n_nodes, spacing = ImageGrid((9, 13)), 48, 1 / 24
    angles = np.arange(8) * np.pi / 8
    rows = rng.standard_normal((8, n_nodes, 2))
    direct = np.zeros((*grid.shape, 2))
    for angle, row in zip(angles, rows, strict=True):
        along = np.asarray(grid.points) @ [np.cos(angle), np.sin(angle)]
        for image in (0, 1):
            direct[..., image] += spline(row[:, image], along / spacing + n_nodes // 2)
    geometry = (jnp.array(spacing), jnp.asarray(angles), grid, jnp.zeros(2))
    assert np.allclose(jax.jit(back_project)(rows, *geometry), direct, atol=1e-12)


def test_adjoint():
    """At the angles 0 and π/2 all pixels lie on nodes, up to rounding."""
    rng = np.random.default_rng(3)
    grid = ImageGrid((33, 17))
    coefficients = jnp.asarray(rng.standard_normal((4, 96, 3)))
    images = jnp.asarray(rng.standard_normal((*grid.shape, 3)))
    geometry = (jnp.array(1 / 48), jnp.arange(4) * jnp.pi / 4, grid, jnp.zeros(2))
    forward = np.vdot(jax.jit(back_project)(coefficients, *geometry), images)
    adjoint = jax.jit(project, static_argnums=1)(images, 96, *geometry)
    assert np.isclose(forward, np.vdot(coefficients, adjoint), rtol=1e-12)


def test_transpose_of_the_whole_step():
    rng = np.random.default_rng(4)
    p = jnp.asarray(rng.standard_normal((2, 32, 64)))

    def step(p):
        angles = jnp.arange(32) * jnp.pi / 32
        return filtered_back_projection(p, jnp.array(1 / 16), angles, ImageGrid(33), jnp.zeros(2))

    image = jnp.asarray(rng.standard_normal((2, 33, 33)))
    (transposed,) = jax.linear_transpose(step, p)(image)
    assert np.isclose(np.vdot(step(p), image), np.vdot(p, transposed), rtol=1e-12)


@pytest.mark.parametrize("batch", [(), (0,), (5, 7)])
def test_batches_are_images_one_by_one(batch):
    rng = np.random.default_rng(5)
    p = jnp.asarray(rng.standard_normal((*batch, 33, 8)))
    angles = jnp.arange(33) * jnp.pi / 33

    def step(p):
        return filtered_back_projection(p, jnp.array(0.2), angles, ImageGrid((5, 6)), jnp.zeros(2))

    together = step(p)
    assert together.shape == (*batch, 5, 6)
    flat = p.reshape(-1, 33, 8)
    for found, alone in zip(together.reshape(-1, 5, 6), flat, strict=True):
        assert np.allclose(found, step(alone), atol=1e-13)
    assert np.allclose(jax.vmap(step)(flat), together.reshape(-1, 5, 6), atol=1e-13)


def step_of_arrays(p, offset_step, angles, half_width, grid_center, center):
    grid = ImageGrid((5, 6), half_width, grid_center)
    return filtered_back_projection(p, offset_step, angles, grid, center)


def arguments(*batch):
    p = jnp.asarray(np.random.default_rng(6).standard_normal((*batch, 33, 16)))
    geometry = (jnp.array(0.2), 0.1 + jnp.arange(33) * jnp.pi / 33)
    grid = (jnp.array([0.9, 1.0]), jnp.array([0.11, -0.05]))
    return (p, *geometry, *grid, jnp.array([0.02, 0.03]))


def test_derivatives_with_respect_to_everything(check_both_modes):
    """Through `jax.vmap`, of data and centres."""
    p, *geometry, _ = arguments(2)
    centers = jnp.array([[0.02, 0.03], [-0.05, 0.01]])
    step = jax.vmap(step_of_arrays, (0, None, None, None, None, 0))
    check_both_modes(step, (p, *geometry, centers))


def test_derivatives_with_respect_to_the_place_alone(check_both_modes):
    """The equations are solved for a derivative of their matrix, the data being constants."""
    *given, center = arguments()
    check_both_modes(lambda center: step_of_arrays(*given, center), (center,))


def test_derivatives_of_derivatives(check_both_modes):
    """Of slopes in the place: the image is linear in the data."""
    p, *geometry, center = arguments()

    weights = np.random.default_rng(7).uniform(0.5, 1, (5, 6))

    def total(p, center):
        return jnp.vdot(weights, step_of_arrays(p, *geometry, center))

    check_both_modes(jax.grad(total, 1), (p, center), rtol=1e-3)


def test_the_ramp_has_every_other_sample_at_any_length():
    """At 412 of them, among others, numpy's frequencies are whole numbers but for rounding."""
    for n in (8, 196, 412):
        samples = _ramp_samples(n)
        assert np.all(samples[1::2] < 0) and not samples[2::2].any()
        # a constant passes but for what the cut ends leave: -Σ 2 / (π j²) beyond n / 2
        assert abs(samples.sum()) < 2 / n
