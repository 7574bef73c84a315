"""Iterative reconstructions: dense solutions, exact phantoms, optimality, derivatives, refusals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from jax.test_util import check_grads
from numpy.testing import assert_allclose

from jaxtat import ImageGrid, Setup, circular_arc, circular_integrals, disk, phantoms
from jaxtat.studies import least_squares, total_variation
from jaxtat.studies.iterative import smoothed_variation

CURVE, REGION, GRID = circular_arc(1.5, 1.0, 12), disk(1.0, 0.6), ImageGrid((8, 7))
SETUP = Setup(CURVE, REGION, GRID, jnp.linspace(0.3, 2.5, 14), max_frequency=6.0)
RNG = np.random.default_rng(0)
DATA = jnp.asarray(RNG.standard_normal((12, 14)))


@pytest.fixture(scope="module")
def matrix():
    """A, (data, pixels), column by column."""
    units = np.eye(56).reshape(56, 8, 7)
    return np.asarray(circular_integrals(SETUP, units)).reshape(56, -1).T


def solve(g=DATA, alpha=0.05, **options):
    given = {"everywhere": True, "tolerance": 1e-12, "max_steps": 500} | options
    return least_squares(SETUP, g, alpha, **given)


def dense(matrix, g, alpha):
    return np.linalg.solve(
        matrix.T @ matrix + alpha * np.eye(matrix.shape[1]), matrix.T @ g.ravel()
    )


@pytest.mark.parametrize("alpha", [0.0, 0.05])
@pytest.mark.parametrize("size", [1.0, 1e-20])
def test_least_squares_is_the_dense_solution(matrix, alpha, size):
    """Small data too: tolerances are relative."""
    found = solve(size * DATA, alpha)
    expected = dense(matrix, np.asarray(DATA), alpha)
    assert_allclose(found.image.ravel() / size, expected, atol=1e-8 * abs(expected).max())
    misfit = np.linalg.norm(matrix @ expected - DATA.ravel()) / np.linalg.norm(DATA)
    assert_allclose(found.residual, misfit, rtol=1e-8)
    assert found.converged
    assert 10 < found.iterations < 500


def test_pixels_outside_the_region_stay_zero(matrix):
    inside = np.asarray(REGION.contains(GRID.points)).ravel()
    image = np.asarray(solve(everywhere=False).image).ravel()
    assert_allclose(image[inside], dense(matrix[:, inside], np.asarray(DATA), 0.05), atol=1e-9)
    assert not image[~inside].any()


def test_steps_are_counted_and_bounded():
    found = solve(max_steps=3)
    assert (int(found.iterations), bool(found.converged)) == (3, False)
    assert solve(max_steps=4).residual < found.residual < 1


@pytest.fixture(scope="module")
def larger():
    """Of which programs are compiled once."""
    radii = 0.3 + jnp.arange(29) / 14
    return Setup(circular_arc(1.3, 1.0, 70), disk(1.0), ImageGrid(29), radii)


def test_a_smooth_phantom_comes_back_from_exact_data(larger):
    """As far as the image between its pixels is known."""
    bell = phantoms.Bells([[0.2, 0.1], [-0.3, -0.2]], [0.6, 0.5], [1.0, 0.7])
    g, image = bell.circular_integrals(larger.curve, larger.radii), bell.image(larger.grid)
    model_error = jnp.linalg.norm(circular_integrals(larger, image) - g)
    found = least_squares(larger, g, max_steps=30)
    assert found.residual * jnp.linalg.norm(g) < model_error
    assert jnp.abs(found.image - image).max() < 2e-2


@jax.jit
def image_of(g, alpha, radii, radius):
    curve = eqx.tree_at(lambda curve: curve.radius, CURVE, radius)
    moved = SETUP.replace(curve=curve, radii=radii)
    options = {"everywhere": True, "tolerance": 1e-12, "max_steps": 500}
    return least_squares(moved, g, alpha, **options).image


ARGUMENTS = DATA, jnp.array(0.05), SETUP.radii, CURVE.radius


def test_least_squares_can_be_differentiated_by_data_and_geometry():
    """And reverse mode is the transpose of forward mode."""
    check_grads(image_of, ARGUMENTS, 1, modes=["fwd"], eps=1e-5, atol=1e-6, rtol=1e-6)
    rng = np.random.default_rng(4)
    tangents = [jnp.asarray(rng.standard_normal(argument.shape)) for argument in ARGUMENTS]
    c = jnp.asarray(rng.standard_normal((8, 7)))
    forward = jax.jvp(image_of, ARGUMENTS, tuple(tangents))[1]
    slopes = jax.vjp(image_of, *ARGUMENTS)[1](c)
    backward = sum(jnp.vdot(*pair) for pair in zip(slopes, tangents, strict=True))
    assert_allclose(jnp.vdot(c, forward), backward, rtol=1e-9)


@pytest.mark.parametrize("size", [1.0, 1e-15])
def test_gradient_of_least_squares_is_the_dense_one(matrix, size):
    """f = H^-1 A^T g: d(c·f)/dg = A H^-1 c, d(c·f)/d alpha = -c·H^-1 f, however small c is."""
    c = RNG.standard_normal((8, 7))
    by_g, by_alpha, *_ = jax.vjp(image_of, *ARGUMENTS)[1](jnp.asarray(size * c))
    inverse = np.linalg.inv(matrix.T @ matrix + 0.05 * np.eye(56))
    assert_allclose(by_g.ravel() / size, matrix @ inverse @ c.ravel(), atol=1e-8)
    image = dense(matrix, np.asarray(DATA), 0.05)
    assert_allclose(by_alpha / size, -c.ravel() @ inverse @ image, rtol=1e-7)


def test_variation_of_a_disk_is_its_circumference_and_has_the_right_gradient():
    grid = ImageGrid(201)
    distance = jnp.linalg.norm(grid.points, axis=-1)
    blurred = jnp.clip((0.6 - distance) / 0.2 + 0.5, 0, 1)
    perimeter = float(smoothed_variation(blurred, jnp.array(1e-9)) * grid.spacing[0])
    assert np.isclose(perimeter, 2 * np.pi * 0.6, rtol=1e-2)
    image = RNG.standard_normal((5, 6))
    variation = jax.jit(lambda f: smoothed_variation(jnp.asarray(f), jnp.array(0.3)))
    check_grads(variation, (image,), order=2, rtol=1e-5)


def minimise(g=DATA, weight=0.3, **options):
    given = {"everywhere": True, "smoothing": 0.1, "tolerance": 1e-9, "max_steps": 1000}
    return total_variation(SETUP, g, weight, **(given | options))


def test_no_data_no_image():
    for found in (solve(0 * DATA), minimise(0 * DATA)):
        assert not np.any(found.image)
        assert found.converged


@pytest.mark.parametrize("everywhere", [True, False])
def test_total_variation_is_the_minimum_found_by_scipy(matrix, everywhere):
    inside = np.ones(56, bool) if everywhere else np.asarray(REGION.contains(GRID.points))
    inside, g = inside.ravel(), np.asarray(DATA).ravel()

    @jax.jit
    @jax.value_and_grad
    def objective(f):
        f = jnp.where(inside, f, 0.0)
        variation = smoothed_variation(f.reshape(8, 7), jnp.array(0.1))
        return jnp.sum((matrix @ f - g) ** 2) / 2 + 0.3 * variation

    options = {"ftol": 1e-16, "gtol": 1e-10, "maxiter": 2000}
    expected = scipy.optimize.minimize(
        objective, np.zeros(56), jac=True, method="L-BFGS-B", options=options
    )
    found = minimise(everywhere=everywhere)
    assert found.converged
    assert_allclose(found.image.ravel(), expected.x, atol=1e-4 * abs(expected.x).max())
    # a search that stops early stays near where it began, here at the minimum
    early, again = (
        minimise(everywhere=everywhere, tolerance=1e-2, initial=start).image - found.image
        for start in (None, found.image)
    )
    assert abs(again).max() < 1e-3 * abs(early).max()


def test_total_variation_can_be_differentiated():
    """Minima are known to about 1e-8, of which a difference makes 1e-5."""

    @jax.jit
    def image(g, weight, smoothing):
        return minimise(g, weight, smoothing=smoothing, tolerance=1e-12).image

    arguments = DATA, jnp.array(0.3), jnp.array(0.1)
    check_grads(image, arguments, 1, modes=["fwd", "rev"], eps=1e-3, atol=1e-4, rtol=1e-4)


def test_total_variation_is_better_than_least_squares_for_edges_in_noise(larger):
    """Far better where the object is flat; pixels on its edge belong to neither side."""
    disk, grid = phantoms.Disks([[0.1, 0.1]], [0.5]), larger.grid
    g = disk.circular_integrals(larger.curve, larger.radii)
    g = g + phantoms.noise_like(jax.random.key(0), g, 0.1)
    plain = [least_squares(larger, g, max_steps=n).image for n in (2, 4, 6)]
    edges = total_variation(larger, g, 0.1).image
    from_edge = jnp.abs(jnp.linalg.norm(grid.points - 0.1, axis=-1) - 0.5)
    flat = larger.region.contains(grid.points) & (from_edge > 2 * grid.spacing[0])

    def error(image, where):
        return float(jnp.linalg.norm((image - disk.image(grid))[where]))

    everywhere = jnp.ones(grid.shape, bool)
    assert error(edges, everywhere) < min(error(image, everywhere) for image in plain)
    assert error(edges, flat) < min(error(image, flat) for image in plain) / 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"g": DATA[:-1]}, r"g has shape \(11, 14\)"),
        ({"g": DATA[None]}, r"expected one image's \(12, 14\)"),
        ({"g": DATA.at[0, 0].set(jnp.nan)}, "NaN"),
        ({"alpha": -1.0}, "alpha is -1.0, expected zero or more"),
        ({"tolerance": 0.0}, "tolerance is 0"),
        ({"max_steps": 0}, "max_steps is 0"),
    ],
)
def test_bad_arguments_of_least_squares_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        least_squares(SETUP, **({"g": DATA} | change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weight": 0.0}, "weight is 0"),
        ({"smoothing": -1.0}, "smoothing is -1"),
        ({"initial": np.zeros((7, 8))}, "initial has shape"),
        ({"max_steps": -1}, "max_steps is -1, expected at least 1"),
    ],
)
def test_bad_arguments_of_total_variation_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        minimise(**change)
