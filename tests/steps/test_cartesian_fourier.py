"""Direct Fourier inversion against exact images, plain sums and filtered back-projection."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, cosine_filter, phantoms
from jaxtat.steps import (
    filtered_back_projection,
    offset_step,
    polar_fourier_of_projections,
    radon_projections,
)
from jaxtat.steps.cartesian_fourier import LATTICE_STEP, direct_fourier_inversion

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
    """On fine, oblong, coarse (no folding) and wide grids (no repetition), about any centre."""
    shifted = phantoms.Bells(CENTERS - np.array(center), WIDTHS, [1.0, -0.6])
    fhat = shifted.fourier(STEP * jnp.arange(N + 1), ANGLES)
    image = direct_fourier_inversion(fhat, STEP, ANGLES, grid, jnp.array(center), ETA)
    assert np.abs(np.asarray(image - BELLS.image(grid))).max() < 3e-9


@pytest.mark.parametrize(("n", "n_directions", "first"), [(48, 110, 0.0), (65, 130, -2.3)])
def test_point_masses_give_the_plain_sum_over_the_lattice(n, n_directions, first):
    """The transform of points is known everywhere and has no decay that would hide a wrong tap."""
    rng = np.random.default_rng(n)
    step, center = 1.3, np.array([0.2, -0.4])
    reach = np.pi / (2 * step)
    r, phi = 0.6 * reach * np.sqrt(rng.uniform(size=8)), rng.uniform(0, 2 * np.pi, 8)
    points = np.stack([r * np.cos(phi), r * np.sin(phi)])
    masses = rng.standard_normal(8)

    def low_pass(frequency):  # vanishes at the end of the line, blurs by 16 R / n, no further
        return np.cos(np.pi / 2 * np.minimum(frequency / (n * step), 1)) ** 16

    def transform(xi):
        return np.exp(-1j * xi @ points) @ masses / (2 * np.pi)

    frequencies = step * np.arange(n + 1)
    angles = first + np.arange(n_directions) * np.pi / n_directions
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    grid = ImageGrid((7, 5), (0.8, 1.0), (0.1, -0.2))
    found = direct_fourier_inversion(
        jnp.asarray(transform(frequencies[:, None, None] * normals)),
        jnp.array(step),
        jnp.asarray(angles),
        grid,
        jnp.asarray(center),
        jnp.asarray(low_pass(frequencies)),
    )
    d = LATTICE_STEP * step
    xi = d * (np.stack(np.meshgrid(*2 * [np.arange(-n, n + 1)]), axis=-1).reshape(-1, 2))
    values = transform(xi) * low_pass(np.linalg.norm(xi, axis=1))
    waves = np.exp(1j * (np.asarray(grid.points) - center) @ xi.T)
    exact = (waves @ values).real * d**2 / (2 * np.pi)
    assert np.abs(found - exact).max() < 1e-8 * np.abs(exact).max()


def test_noise_comes_through_as_in_back_projection():
    """Noise is not confined to the disk; what lies outside must not be folded into it."""
    grid = ImageGrid(65)
    noise = jnp.asarray(np.random.default_rng(0).standard_normal((256, 2 * N)))
    fhat = polar_fourier_of_projections(noise, offset_step(STEP, N))
    arguments = (fhat, STEP, ANGLES, grid, jnp.zeros(2), cosine_filter(jnp.arange(N + 1) / N))
    inside = np.linalg.norm(grid.points, axis=-1) < 0.95
    found = np.asarray(direct_fourier_inversion(*arguments))[inside]
    expected = np.asarray(back_projection(*arguments))[inside]
    assert np.std(found) < 1.05 * np.std(expected)
    assert np.corrcoef(found, expected)[0, 1] > 0.97


def small_arguments(seed=0, shape=(9, 7)):
    rng = np.random.default_rng(seed)
    real, imaginary = (jnp.asarray(rng.standard_normal(shape)) for _ in range(2))
    return real, imaginary


def small_image(real, imaginary, step, first, half_width, grid_center, center, eta):
    angles = first + jnp.arange(7) * jnp.pi / 7
    grid = ImageGrid((6, 4), half_width, grid_center)
    fhat = real + 1j * imaginary
    return direct_fourier_inversion(fhat, step, angles, grid, center, eta)


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
