"""Forward operator: exact phantoms, brute force, its adjoint, derivatives and memory."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    circular_arc,
    circular_integrals,
    circular_integrals_adjoint,
    circular_means,
    detector_curve,
    phantoms,
)
from jaxtat.forward import integrate_over_circles, integrate_over_circles_adjoint
from jaxtat.forward.circles import sample
from jaxtat.geometry import SampledCurve

CURVE, RADII = circular_arc(1.3, 1.0, 6), jnp.asarray(np.linspace(0.3, 2.3, 11))


def keys(t):
    t = abs(t)
    if t < 1:
        return 1.5 * t**3 - 2.5 * t**2 + 1
    return -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2 if t < 2 else 0.0


def test_sampling_is_keys_convolution_also_of_rough_images_and_beyond_the_edge():
    rng = np.random.default_rng(0)
    grid = ImageGrid((6, 8), half_width=(1.0, 1.4), center=(0.2, -0.1))
    image = rng.standard_normal(grid.shape)
    nodes = np.asarray(grid.points).reshape(-1, 2)
    points = np.concatenate([rng.uniform(-2.2, 2.2, (300, 2)), nodes, nodes + 1e-17])
    x1, x2 = np.asarray(grid.x1), np.asarray(grid.x2)
    h1, h2 = np.asarray(grid.spacing)
    direct = [
        sum(
            image[i, j] * keys((p[0] - x1[i]) / h1) * keys((p[1] - x2[j]) / h2)
            for i in range(6)
            for j in range(8)
        )
        for p in points
    ]
    assert np.allclose(sample(image, grid, points), direct, atol=1e-12)


def test_circular_integrals_are_those_of_the_interpolated_image():
    grid = ImageGrid(12)
    image = jnp.asarray(np.random.default_rng(1).standard_normal(grid.shape))
    g = np.asarray(integrate_over_circles(image, grid, CURVE, RADII, n_points=4000))
    phi = (np.arange(60000) + 0.5) * 2 * np.pi / 60000
    around = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    for k, j in ((0, 3), (2, 5), (5, 9)):
        radius = float(RADII[j])
        points = np.asarray(CURVE.points)[k] + radius * around
        direct = radius * 2 * np.pi * np.mean(sample(image, grid, points))
        assert abs(g[k, j] - direct) < 2e-5


def test_error_falls_with_the_third_order_of_the_pixel_size():
    bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    exact = np.asarray(bell.circular_integrals(CURVE, RADII))

    def error(n):
        grid = ImageGrid(n)
        g = integrate_over_circles(bell.image(grid), grid, CURVE, RADII)
        return np.abs(np.asarray(g) - exact).max()

    errors = [error(n) for n in (33, 65, 129)]
    assert errors[2] < 2e-5
    assert np.log2(errors[0] / errors[1]) > 2.7
    assert np.log2(errors[1] / errors[2]) > 2.7


def test_detectors_inside_the_grid_see_whole_circles():
    """One of them at the centre of the grid itself."""
    grid = ImageGrid(65)
    bell = phantoms.Bells([[0.0, 0.0]], [0.8])
    points = np.concatenate([circular_arc(0.2, 0.2, 5).points, [[1e-300, 0.0]]])
    curve = SampledCurve(*map(jnp.asarray, (points, np.ones(6), np.ones((6, 2)))), False)
    radii = jnp.array([0.05, 0.3, 0.7])
    g = integrate_over_circles(bell.image(grid), grid, curve, radii)
    assert np.allclose(g, bell.circular_integrals(curve, radii), atol=2e-4)


@pytest.mark.parametrize("kind", ["arc", "straight"])
def test_data_of_wide_elements_are_means_of_those_of_points(kind):
    """By brute force, of exact phantoms and by quadrature."""
    width, n = 0.3, 60
    shares = (np.arange(n) + 0.5) / n - 0.5
    if kind == "arc":
        wide = circular_arc(1.3, 1.0, 6, element_width=width)
        points = [circular_arc(1.3, 1.0, 6, angle=s * width / 1.3).points for s in shares]
    else:
        wide = detector_curve(CURVE.points, element_width=width)
        tangents = np.asarray(wide.normals)[:, ::-1] * (-1, 1)
        points = [np.asarray(wide.points) + s * width * tangents for s in shares]
    rest = np.ones(6 * n), np.ones((6 * n, 2))
    many = SampledCurve(*map(jnp.asarray, (np.concatenate(points), *rest)), False)

    def mean(g):
        return np.reshape(g, (n, 6, -1)).mean(axis=0)

    grid, bell = ImageGrid(17), phantoms.Bells([[0.3, 0.5]], [0.4])
    exact = mean(bell.circular_integrals(many, RADII))
    assert np.allclose(bell.circular_integrals(wide, RADII), exact, atol=2e-5)
    assert not np.allclose(bell.circular_integrals(CURVE, RADII), exact, atol=2e-3)
    image = bell.image(grid)
    g = integrate_over_circles(image, grid, wide, RADII)
    assert np.allclose(g, mean(integrate_over_circles(image, grid, many, RADII)), atol=2e-5)


def test_a_setup_has_its_integrals_adjoint_and_means_by_quadrature(arc):
    """Also inside jit, passed in with other radii."""
    image = phantoms.Bells([[0.1, 0.2]], [0.6]).image(arc.grid)
    places = arc.grid, arc.curve, arc.radii
    by = {"method": "quadrature"}
    g = circular_integrals(arc, image, **by)
    assert np.allclose(g, integrate_over_circles(image, *places), rtol=1e-12, atol=1e-14)
    back = circular_integrals_adjoint(arc, g, **by)
    assert np.allclose(back, integrate_over_circles_adjoint(g, *places), rtol=1e-12, atol=1e-14)
    means = circular_means(arc, image) * 2 * np.pi * np.asarray(arc.radii)
    assert np.allclose(means, circular_integrals(arc, image))
    wider = jax.jit(lambda setup, r: circular_integrals(setup.replace(radii=r), image, **by))
    found = wider(arc, 1.01 * arc.radii)
    wanted = integrate_over_circles(image, arc.grid, arc.curve, 1.01 * arc.radii)
    assert np.allclose(found, wanted, rtol=1e-12, atol=1e-14)


def test_flat_pixels_are_resolved_too():
    grid = ImageGrid(33, half_width=(1.0, 0.1))
    image = jnp.asarray(np.random.default_rng(3).standard_normal(grid.shape))
    g = integrate_over_circles(image, grid, CURVE, RADII)
    fine = integrate_over_circles(image, grid, CURVE, RADII, n_points=20000)
    assert np.abs(np.asarray(g) - np.asarray(fine)).max() < 5e-3


def test_the_adjoint_is_the_transpose_also_of_batches_and_wide_elements():
    grid = ImageGrid((15, 20), half_width=(1.0, 0.9), center=(0.1, 0.0))
    curve = circular_arc(1.3, 1.0, 6, element_width=0.3)
    rng = np.random.default_rng(2)
    images = rng.standard_normal((2, 1, *grid.shape))
    data = rng.standard_normal((2, 1, 6, 11))
    g = np.asarray(integrate_over_circles(jnp.asarray(images), grid, curve, RADII))
    back = np.asarray(integrate_over_circles_adjoint(jnp.asarray(data), grid, curve, RADII))
    assert g.shape == data.shape and back.shape == images.shape
    for k in range(2):
        one, other = np.vdot(g[k], data[k]), np.vdot(images[k], back[k])
        assert abs(one - other) < 1e-13 * (abs(one) + np.linalg.norm(data[k]))
    alone = integrate_over_circles(jnp.asarray(images[1, 0]), grid, curve, RADII)
    assert np.allclose(g[1, 0], alone, atol=1e-15)


def test_derivatives_in_positions_and_radii_are_those_of_the_exact_integrals():
    """In reverse mode, and in forward mode alike."""
    bell, grid = phantoms.Bells([[0.1, 0.2]], [0.8]), ImageGrid(129)
    image = bell.image(grid)

    def approximate(center, radii):
        curve = circular_arc(1.3, 1.0, 3, center=center)
        return integrate_over_circles(image, grid, curve, radii).sum()

    def exact(center, radii):
        return bell.circular_integrals(circular_arc(1.3, 1.0, 3, center=center), radii).sum()

    at = jnp.array([0.01, 0.02]), RADII
    along = tuple(jnp.asarray(np.random.default_rng(0).standard_normal(x.shape)) for x in at)

    @jax.jit
    def slopes(*at):
        both = [jax.grad(of, argnums=(0, 1))(*at) for of in (approximate, exact)]
        return *both, jax.jvp(approximate, at, along)[1]

    found, wanted, forward = slopes(*at)
    for one, other, accuracy in zip(found, wanted, (1e-3, 3e-3), strict=True):
        assert np.allclose(one, other, rtol=0, atol=accuracy)
    assert np.isclose(forward, sum(map(np.vdot, found, along)), rtol=1e-10)


def test_memory_at_paper_size_stays_bounded_forwards_and_backwards():
    grid, curve = ImageGrid(129), circular_arc(1.3, 1.0, 500)
    radii, image = jnp.asarray(0.3 + np.arange(129) / 64), np.zeros((129, 129))

    def loss(image, curve, radii):
        return jnp.sum(integrate_over_circles(image, grid, curve, radii) ** 2)

    both_ways = jax.jit(jax.value_and_grad(loss, argnums=(0, 1, 2)))
    analysis = both_ways.lower(image, curve, radii).compile().memory_analysis()
    assert analysis.temp_size_in_bytes < 100e6  # all points at once would be 300 MB per array


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((32, 33)), "image has shape"),
        (np.full((33, 33), np.nan), "NaN"),
        (np.zeros((33, 33), complex), "complex"),
    ],
)
def test_bad_images_are_refused(image, message):
    with pytest.raises(ValueError, match=message):
        integrate_over_circles(image, ImageGrid(33), CURVE, RADII)


def test_bad_radii_are_refused():
    for radii, message in ((-RADII, "radii is"), (0 * RADII, "radii is"), (RADII[0], "radii has")):
        with pytest.raises(ValueError, match=message):
            integrate_over_circles(np.zeros((33, 33)), ImageGrid(33), CURVE, radii)
        with pytest.raises(ValueError, match=message):
            phantoms.Bells([[0.0, 0.0]], [0.5]).circular_integrals(CURVE, radii)


def test_bad_data_are_refused_by_the_adjoint():
    with pytest.raises(ValueError, match=r"data has shape \(5, 11\), expected \(..., 6, 11\)"):
        integrate_over_circles_adjoint(np.zeros((5, 11)), ImageGrid(33), CURVE, RADII)
