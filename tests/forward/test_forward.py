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

CURVE, RADII = circular_arc(1.3, 1.0, 6), jnp.linspace(0.3, 2.3, 11)


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
    assert np.allclose(sample(jnp.asarray(image), grid, jnp.asarray(points)), direct, atol=1e-12)
    assert np.allclose(
        jax.jit(sample)(jnp.asarray(image), grid, jnp.asarray(points)), direct, atol=1e-12
    )


def test_circular_integrals_are_those_of_the_interpolated_image():
    grid = ImageGrid(12)
    image = jnp.asarray(np.random.default_rng(1).standard_normal(grid.shape))
    g = integrate_over_circles(image, grid, CURVE, RADII, n_points=4000)
    phi = (np.arange(60000) + 0.5) * 2 * np.pi / 60000
    around = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    for k, j in ((0, 3), (2, 5), (5, 9)):
        points = np.asarray(CURVE.points[k]) + float(RADII[j]) * around
        direct = (
            float(RADII[j]) * 2 * np.pi * float(sample(image, grid, jnp.asarray(points)).mean())
        )
        assert abs(float(g[k, j]) - direct) < 2e-5


def test_error_falls_with_the_third_order_of_the_pixel_size():
    bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    exact = bell.circular_integrals(CURVE, RADII)

    def error(n):
        grid = ImageGrid(n)
        return float(
            jnp.abs(integrate_over_circles(bell.image(grid), grid, CURVE, RADII) - exact).max()
        )

    order = np.log2(error(33) / error(65)), np.log2(error(65) / error(129))
    assert error(129) < 2e-5
    assert order[0] > 2.7
    assert order[1] > 2.7


def test_detectors_inside_the_grid_see_whole_circles():
    grid = ImageGrid(65)
    bell = phantoms.Bells([[0.0, 0.0]], [0.8])
    curve = circular_arc(0.2, 0.2, 5)
    radii = jnp.array([0.05, 0.3, 0.7])
    g = integrate_over_circles(bell.image(grid), grid, curve, radii)
    assert np.allclose(g, bell.circular_integrals(curve, radii), atol=2e-4)
    centre = circular_arc(1e-300, 1e-300, 2)  # a detector at the centre of the grid itself
    g = integrate_over_circles(bell.image(grid), grid, centre, radii)
    assert np.allclose(g, bell.circular_integrals(centre, radii), atol=2e-4)


@pytest.mark.parametrize("kind", ["arc", "straight"])
def test_data_of_wide_elements_are_means_of_those_of_points(kind):
    """By brute force, of exact phantoms and by quadrature; the adjoint is the transpose."""
    width, n = 0.3, 60
    shares = (np.arange(n) + 0.5) / n - 0.5
    if kind == "arc":
        wide = circular_arc(1.3, 1.0, 6, element_width=width)
        points = [circular_arc(1.3, 1.0, 6, angle=s * width / 1.3).points for s in shares]
    else:
        wide = detector_curve(CURVE.points, element_width=width)
        tangents = np.asarray(wide.normals)[:, ::-1] * (-1, 1)
        points = [wide.points + s * width * tangents for s in shares]
    many = SampledCurve(jnp.concatenate(points), *([jnp.ones(6 * n), jnp.ones((6 * n, 2))]), False)
    grid, bell = ImageGrid(17), phantoms.Bells([[0.3, 0.5]], [0.4])
    exact = bell.circular_integrals(many, RADII).reshape(n, 6, -1).mean(axis=0)
    assert np.allclose(bell.circular_integrals(wide, RADII), exact, atol=2e-5)
    assert not np.allclose(bell.circular_integrals(CURVE, RADII), exact, atol=2e-3)
    image = bell.image(grid)
    mean = integrate_over_circles(image, grid, many, RADII).reshape(n, 6, -1).mean(axis=0)
    g = integrate_over_circles(image, grid, wide, RADII)
    assert np.allclose(g, mean, atol=2e-5)
    data = jnp.asarray(np.random.default_rng(0).standard_normal(g.shape))
    back = integrate_over_circles_adjoint(data, grid, wide, RADII)
    assert np.isclose(jnp.vdot(g, data), jnp.vdot(image, back), rtol=1e-12)


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
    assert np.abs(np.asarray(g - fine)).max() < 5e-3


def test_batches_go_through_both_ways():
    grid = ImageGrid(9)
    images = jnp.asarray(np.random.default_rng(4).standard_normal((2, 1, 9, 9)))
    g = integrate_over_circles(images, grid, CURVE, RADII)
    assert g.shape == (2, 1, 6, 11)
    assert np.allclose(
        g[1, 0], integrate_over_circles(images[1, 0], grid, CURVE, RADII), atol=1e-15
    )
    back = integrate_over_circles_adjoint(g, grid, CURVE, RADII)
    assert back.shape == images.shape
    assert np.isclose(jnp.vdot(back, images), jnp.vdot(g, g), rtol=1e-12)


def test_adjoint_passes_the_dot_test():
    grid = ImageGrid((15, 20), half_width=(1.0, 0.9), center=(0.1, 0.0))
    rng = np.random.default_rng(2)
    image = jnp.asarray(rng.standard_normal(grid.shape))
    data = jnp.asarray(rng.standard_normal((6, 11)))
    one = jnp.vdot(integrate_over_circles(image, grid, CURVE, RADII), data)
    other = jnp.vdot(image, integrate_over_circles_adjoint(data, grid, CURVE, RADII))
    assert abs(float(one - other)) < 1e-13 * float(jnp.abs(one) + jnp.linalg.norm(data))


def test_derivatives_in_image_positions_and_radii(check_both_modes):
    grid = ImageGrid(21)
    image = phantoms.Bells([[0.1, 0.2]], [0.8]).image(grid)

    def g(image, center, radii):
        curve = circular_arc(1.3, 1.0, 3, center=center)
        return integrate_over_circles(image, grid, curve, radii)

    arguments = (image, jnp.array([0.01, 0.02]), RADII)
    check_both_modes(g, arguments, rtol=1e-4)


def test_derivative_in_position_is_that_of_the_exact_integrals():
    bell, grid = phantoms.Bells([[0.1, 0.2]], [0.8]), ImageGrid(129)
    image = bell.image(grid)

    def approximate(center):
        curve = circular_arc(1.3, 1.0, 3, center=center)
        return integrate_over_circles(image, grid, curve, RADII).sum()

    def exact(center):
        return bell.circular_integrals(circular_arc(1.3, 1.0, 3, center=center), RADII).sum()

    center = jnp.array([0.01, 0.02])
    assert np.allclose(jax.grad(approximate)(center), jax.grad(exact)(center), atol=1e-3)


def test_memory_at_paper_size_stays_bounded_forwards_and_backwards():
    grid, curve = ImageGrid(129), circular_arc(1.3, 1.0, 500)
    radii, image = 0.3 + jnp.arange(129) / 64, jnp.zeros((129, 129))

    def loss(image, curve, radii):
        return jnp.sum(integrate_over_circles(image, grid, curve, radii) ** 2)

    for function in (loss, jax.grad(loss), jax.grad(loss, argnums=(0, 1, 2))):
        analysis = jax.jit(function).lower(image, curve, radii).compile().memory_analysis()
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
