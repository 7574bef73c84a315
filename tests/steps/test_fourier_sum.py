"""The Fourier sum against exact images, plain sums and filtered back-projection."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, cosine_filter, phantoms
from jaxtat.steps import (
    filtered_back_projection,
    fourier_inversion,
    offset_step,
    polar_fourier_of_projections,
    radon_projections,
)

N, STEP = 128, jnp.array(jnp.pi / 2)  # the reach is 1
ANGLES = 0.3 + jnp.arange(256) * jnp.pi / 256
ETA = jnp.ones(N + 1)
CENTERS, WIDTHS = np.array([[0.3, -0.2], [-0.4, 0.3]]), [0.5, 0.45]
BELLS = phantoms.Bells(CENTERS, WIDTHS, [1.0, -0.6])


def back_projection(fhat, step, angles, grid, center, eta):
    p = radon_projections(fhat, step, eta)
    h = offset_step(step, fhat.shape[-2] - 1)
    return filtered_back_projection(p, h, angles, grid, center)


@pytest.mark.parametrize(
    ("grid", "center"),
    [
        (ImageGrid(129), (0.0, 0.0)),
        (ImageGrid((31, 18), (0.5, 1.1), (0.2, -0.1)), (0.1, -0.05)),
        (ImageGrid(9), (0.0, 0.1)),
        (ImageGrid(41, 4.0), (0.0, 0.0)),
    ],
)
def test_exact_transforms_give_exact_images(grid, center):
    """On fine, oblong, coarse and wide grids, about any centre; beyond twice the reach it is 0."""
    shifted = phantoms.Bells(CENTERS - np.array(center), WIDTHS, [1.0, -0.6])
    fhat = shifted.fourier(STEP * jnp.arange(N + 1), ANGLES)
    image = fourier_inversion(fhat, STEP, ANGLES, grid, jnp.array(center), ETA)
    assert np.abs(np.asarray(image - BELLS.image(grid))).max() < 3e-9


@pytest.mark.parametrize(("n", "first"), [(64, 0.0), (97, -2.3)])
def test_the_weights_are_those_of_the_ramp(n, first):
    """Projections that end at ±2R, far beyond the reach, against the integral over |lambda|.

    Of a sample at distance d it is ∫ x cos(π d x) dx from 0 to 1 = sinc(d) - sinc(d/2)² / 2.
    """
    rng, step, center = np.random.default_rng(n), 1.3, np.array([0.2, -0.4])
    j, places = np.arange(-n, n), rng.uniform(-0.6 * n, 0.6 * n, 6)
    projection = np.exp(-((j[:, None] - places) ** 2) / 16) @ rng.standard_normal(6)
    fhat = np.fft.rfft(np.fft.ifftshift(projection))
    angles = first + np.arange(4) * np.pi / 4
    grid = ImageGrid((4, 5), (0.7, 0.5), (0.3, -0.2))
    found = fourier_inversion(
        jnp.asarray(np.repeat(fhat[:, None], 4, axis=1)),
        jnp.array(step),
        jnp.asarray(angles),
        grid,
        jnp.asarray(center),
        jnp.ones(n + 1),
    )
    h = np.pi / (n * step)
    normals = np.stack([np.cos(angles), np.sin(angles)])
    s = (np.asarray(grid.points) - center).reshape(-1, 2) @ normals / h
    distance = s.ravel()[:, None] - j
    ramp = np.sinc(distance) - np.sinc(distance / 2) ** 2 / 2
    filtered = (ramp @ projection).reshape(s.shape) * (n * step) ** 2
    exact = filtered.mean(axis=1).reshape(grid.shape)
    assert np.abs(found - exact).max() < 1e-8 * np.abs(exact).max()


def test_noise_comes_through_as_in_back_projection():
    """To the last frequencies, between whose samples projections are interpolated otherwise."""
    grid = ImageGrid(65)
    noise = jnp.asarray(np.random.default_rng(0).standard_normal((256, 2 * N)))
    fhat = polar_fourier_of_projections(noise, offset_step(STEP, N))
    arguments = (fhat, STEP, ANGLES, grid, jnp.zeros(2), cosine_filter(jnp.arange(N + 1) / N))
    inside = np.linalg.norm(grid.points, axis=-1) < 0.95
    found = np.asarray(fourier_inversion(*arguments))[inside]
    expected = np.asarray(back_projection(*arguments))[inside]
    assert np.std(found - expected) < 0.01 * np.std(expected)


def small_arguments(seed=0, shape=(9, 7)):
    rng = np.random.default_rng(seed)
    real, imaginary = (jnp.asarray(rng.standard_normal(shape)) for _ in range(2))
    return real, imaginary


def small_image(real, imaginary, step, first, half_width, grid_center, center, eta):
    angles = first + jnp.arange(7) * jnp.pi / 7
    grid = ImageGrid((6, 4), half_width, grid_center)
    fhat = real + 1j * imaginary
    return fourier_inversion(fhat, step, angles, grid, center, eta)


SMOOTH = (
    jnp.array(1.5),
    jnp.array(0.2),
    jnp.array([0.7, 0.9]),
    jnp.array([0.1, 0.0]),
    jnp.array([0.02, 0.01]),
    jnp.linspace(1.0, 0.2, 9),
)


def test_batches_of_any_size_are_images_one_by_one():
    real, imaginary = small_arguments(shape=(5, 2, 9, 7))
    together = small_image(real, imaginary, *SMOOTH)
    assert together.shape == (5, 2, 6, 4)
    for i in np.ndindex(5, 2):
        alone = small_image(real[i], imaginary[i], *SMOOTH)
        assert np.allclose(together[i], alone, atol=1e-13)
    assert small_image(real[:0], imaginary[:0], *SMOOTH).shape == (0, 2, 6, 4)


def test_derivatives_in_every_argument(check_both_modes):
    check_both_modes(small_image, small_arguments() + SMOOTH, rtol=1e-4)


def test_reverse_mode_is_the_adjoint():
    """<A u, v> = <u, A' v>, for a batch that fills its groups unevenly."""
    u, v = small_arguments(1, (5, 9, 7)), small_arguments(2, (5, 6, 4))[0]
    image, adjoint = jax.vjp(lambda a, b: small_image(a, b, *SMOOTH), *u)
    back = adjoint(v)
    assert np.isclose(jnp.vdot(image, v), sum(map(jnp.vdot, u, back)), rtol=1e-12)


def test_new_numbers_do_not_retrace():
    traced = 0

    @jax.jit
    def image(*arguments):
        nonlocal traced
        traced += 1
        return small_image(*arguments)

    for scale in (1.0, 1.1, 1.2):
        image(*(scale * a for a in small_arguments() + SMOOTH))
    assert traced == 1
