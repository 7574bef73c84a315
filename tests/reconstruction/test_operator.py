"""The forward operator: exact integrals, transposes, derivatives, precision, refusals."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest
import scipy.special
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxtat
from jaxtat import (
    ImageGrid,
    Setup,
    circular_arc,
    circular_means,
    cosine_filter,
    detector_curve,
    disk,
    elliptic_arc,
    forward_operator,
    phantoms,
    polygon,
)
from jaxtat.forward import fast_circles
from jaxtat.geometry.curves import SampledCurve
from jaxtat.records import pressure_to_circular_integrals

BELL = phantoms.Bells([[0.1, 0.2]], [0.75])
GRID, RADII = ImageGrid(49), np.linspace(0.05, 2.9, 30)


def on_circle(n, radius=1.3):
    theta = np.linspace(0.6, 5.6, n) + 0.01 * np.sin(np.arange(n))  # uneven
    return radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)


CURVES = {
    "arc": (circular_arc(1.3, 1.0, 24), disk(1.0)),
    "uneven on a circle": (detector_curve(on_circle(24)), disk(1.0)),
    "ellipse": (elliptic_arc((1.6, 1.2), 24), disk(0.9)),
    "inside the image": (circular_arc(0.8, 0.5, 24), disk(0.5)),
}


def coarse(*parts):
    """With too few detectors to reconstruct from, which is said and does not matter here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxtat.VisibilityWarning)
        warnings.simplefilter("ignore", jaxtat.AccuracyWarning)
        return Setup(*parts)


@pytest.fixture(params=CURVES, scope="module")
def setup(request):
    curve, region = CURVES[request.param]
    return coarse(curve, region, GRID, RADII)


def test_integrals_of_a_smooth_image_are_exact_in_every_geometry(setup):
    g = forward_operator(setup).mv(BELL.image(GRID))
    exact = BELL.circular_integrals(setup.curve, setup.radii)
    assert jnp.abs(g - exact).max() < 3e-6 * exact.max()


def test_error_falls_faster_than_any_power_of_the_pixel():
    curve, region = CURVES["arc"]
    exact = BELL.circular_integrals(curve, RADII)

    def error(n):
        grid = ImageGrid(n)
        operator = forward_operator(coarse(curve, region, grid, RADII))
        return np.abs(operator.mv(BELL.image(grid)) - exact).max()

    errors = [error(n) for n in (17, 33, 49)]
    assert errors[1] < errors[0] / 2**5
    assert errors[2] < errors[1] / 1.5**7


def dot_test(operator, seed):
    rng = np.random.default_rng(seed)
    image = rng.standard_normal(operator.in_structure().shape)
    data = rng.standard_normal(operator.out_structure().shape)
    ahead, back = operator.mv(image), operator.T.mv(data)
    gap = abs(np.vdot(ahead, data) - np.vdot(image, back))
    return gap / (np.linalg.norm(ahead) * np.linalg.norm(data))


def test_a_known_setup_may_be_closed_over_in_every_geometry(setup):
    traced = jax.eval_shape(lambda image: forward_operator(setup)(image), BELL.image(GRID))
    assert traced.shape == setup.data_shape


def test_the_transpose_is_exact_in_every_geometry(setup):
    operator = forward_operator(setup)
    assert dot_test(operator, 0) < 1e-12
    assert dot_test(operator.T, 1) < 1e-12


# one program for all positions: they are replaced in one setup
ANYWHERE = coarse(detector_curve(on_circle(12)), disk(0.5), ImageGrid(9), np.linspace(0.1, 2.9, 7))
operator_at = jax.jit(
    lambda points: forward_operator(eqx.tree_at(lambda s: s.curve.points, ANYWHERE, points))
)


@given(
    positions=st.lists(st.tuples(*[st.floats(-1.5, 1.5)] * 2), min_size=12, max_size=12),
    seed=st.integers(0, 100),
)
@settings(max_examples=8, deadline=None)
def test_the_transpose_is_exact_for_detectors_anywhere(positions, seed):
    assert dot_test(operator_at(np.array(positions)), seed) < 1e-12


def differences(function, x, step=1e-3):
    """Central, of fourth order."""
    near, far = (function(x + h) - function(x - h) for h in (step, 2 * step))
    return (8 * near - far) / (12 * step)


@pytest.fixture
def several_groups(monkeypatch):
    """Of frequencies, few as they are."""
    monkeypatch.setattr("jaxtat.forward.circular_sizes.WORTH_A_GROUP", 15)


@pytest.mark.parametrize("name", ["arc", "ellipse"])
def test_slopes_in_positions_radii_and_widths_are_those_of_differences(name, several_groups):
    """Of the whole chain, in both modes: images are linear."""
    curve, region = CURVES[name]
    if name == "arc":
        curve = circular_arc(1.3, 1.0, 24, element_width=0.1)
    setup = coarse(curve, region, ImageGrid(17), np.linspace(0.3, 2.3, 9))
    image = BELL.image(setup.grid)
    weights = jnp.asarray(np.random.default_rng(0).standard_normal(setup.data_shape))

    def total(size):
        if name == "arc":
            moved = circular_arc(1.3 * size, 1.0, 24, element_width=0.1 * size**3)
        else:
            moved = eqx.tree_at(lambda c: c.points, curve, curve.points * size)
        new = setup.replace(curve=moved, radii=setup.radii * (2 - size))
        return jnp.sum(weights * forward_operator(new, tolerance=1e-13)(image))

    @jax.jit
    def everything(size):
        (value, backward), (forward, second) = jax.jvp(jax.value_and_grad(total), (size,), (1.0,))
        return jnp.stack([value, backward, forward, second])

    _, backward, forward, second = everything(1.0)
    wanted, of_slope = differences(lambda size: np.asarray(everything(size)[:2]), 1.0)
    assert np.allclose([backward, forward], wanted, rtol=1e-6)
    assert np.allclose(second, of_slope, rtol=1e-5)


def test_many_detectors_on_a_circle_take_another_way_to_the_same_data(arc, monkeypatch):
    by_matrix = forward_operator(arc)
    monkeypatch.setattr("jaxtat.forward.fast_circles.DENSE", 0)
    image = BELL.image(arc.grid)
    # the limit is read when a program is made: for another tolerance
    by_fft = forward_operator(arc, tolerance=0.99e-9)
    assert by_fft.report.nbytes < by_matrix.report.nbytes
    assert np.allclose(by_fft.mv(image), by_matrix.mv(image), atol=1e-8)
    assert dot_test(by_fft, 0) < 1e-12


def test_waves_that_do_not_fit_are_made_anew_with_the_same_result(
    monkeypatch, none_made, several_groups
):
    curve, region = CURVES["ellipse"]
    setup = coarse(curve, region, ImageGrid(17), np.linspace(0.3, 2.3, 9))
    kept = forward_operator(setup)
    monkeypatch.setattr("jaxtat.forward.fast_circles.KEPT", 0.0)
    with none_made():  # the limit is read when a program is made
        anew = forward_operator(setup)
    assert (kept.report.kept, anew.report.kept) == (True, False)
    assert anew.report.nbytes < kept.report.nbytes / 5
    image = BELL.image(setup.grid)
    assert jnp.allclose(anew.mv(image), kept.mv(image), atol=1e-13)
    assert dot_test(anew, 0) < 1e-12


@pytest.fixture(scope="module")
def dense():
    """A small operator, and its matrix."""
    operator = operator_at(on_circle(12))
    return operator, np.asarray(operator.as_matrix())


def test_stacks_maps_and_matrices_agree(dense):
    operator, matrix = dense
    images = np.random.default_rng(4).standard_normal((2, *ANYWHERE.grid.shape))
    g = operator(images)
    for one in (jax.vmap(operator.mv)(images), jax.jit(lambda A, f: A(f))(operator, images)):
        assert np.allclose(one, g, atol=1e-13)
    assert np.allclose(matrix @ np.ravel(images[0]), np.ravel(g[0]), atol=1e-12)
    assert np.allclose(operator.T.as_matrix(), matrix.T, atol=1e-12)


def test_lineax_solves_with_it(dense):
    operator, matrix = dense
    assert not lx.is_symmetric(operator)
    normal = operator.T @ operator + 1e-3 * lx.IdentityLinearOperator(operator.in_structure())
    normal = lx.TaggedLinearOperator(normal, lx.positive_semidefinite_tag)
    g = np.random.default_rng(5).standard_normal(ANYWHERE.data_shape)
    # an error is up to 1000 times the residual
    found = lx.linear_solve(normal, operator.T.mv(g), lx.CG(rtol=1e-11, atol=1e-11)).value
    direct = np.linalg.solve(matrix.T @ matrix + 1e-3 * np.eye(9 * 9), matrix.T @ np.ravel(g))
    assert np.abs(np.ravel(found) - direct).max() < 1e-6


def test_a_low_pass_is_that_of_the_image(arc):
    """A Gaussian, whose integrals are 2πr s² / σ² exp(-(d² + r²) / 2σ²) I_0(d r / σ²)."""
    s, blur = 0.17, 0.1
    image = np.exp(-np.sum(np.square(arc.grid.points), axis=-1) / (2 * s**2))
    highest = forward_operator(arc).report.max_frequency
    d = np.linalg.norm(arc.curve.points, axis=1)[:, None]
    r = np.asarray(arc.radii)
    for t, low_pass in (
        (0.0, None),
        (blur, lambda relative: jnp.exp(-((relative * highest * blur) ** 2) / 2)),
    ):
        square = s**2 + t**2
        bessel = scipy.special.ive(0, d * r / square) * np.exp(-((d - r) ** 2) / (2 * square))
        exact = 2 * np.pi * r * s**2 / square * bessel
        found = forward_operator(arc, low_pass=low_pass).mv(image)
        assert np.abs(found - exact).max() < 3e-6 * exact.max()
    cosine = forward_operator(arc, low_pass="cosine").mv(image)
    assert np.array_equal(cosine, forward_operator(arc, low_pass=cosine_filter).mv(image))


def test_single_precision_is_close_and_keeps_its_type(arc):
    single, double = forward_operator(arc, dtype=jnp.float32), forward_operator(arc)
    image = BELL.image(arc.grid)
    g = single.mv(image)
    assert g.dtype == single.T.mv(g).dtype == np.float32
    assert single.report.nbytes * 2 == double.report.nbytes
    assert jnp.abs(g - double.mv(image)).max() < 1e-5 * g.max()
    with jax.enable_x64(False):
        assert jnp.abs(single.mv(np.asarray(image)) - g).max() < 1e-5 * g.max()


def test_many_detectors_on_a_circle_keep_their_phases_in_single_precision(monkeypatch):
    """They are those of high orders; so few detectors would else take another way."""
    monkeypatch.setattr(fast_circles, "DENSE", 0)
    curve, grid = jaxtat.circular_arc(1.3, 1.0, 37), jaxtat.ImageGrid(65)
    setup = jaxtat.Setup(curve, jaxtat.disk(1.0), grid, max_frequency=30.0)
    single, double = forward_operator(setup, dtype=jnp.float32), forward_operator(setup)
    middle = [(orders + 1) // 2 for _, _, orders, _, _ in single.integrals.of.groups]
    theta = np.arctan2(*np.asarray(curve.points).T[::-1])
    exact = np.exp(1j * np.outer(middle, theta))
    assert np.abs(single.integrals.middle - exact).max() < 1e-7
    assert np.abs(double.integrals.middle - exact).max() < 1e-12
    g = BELL.circular_integrals(curve, setup.radii)
    for operator, error in ((single, 5e-5), (double, 1e-6)):
        assert jnp.abs(operator.mv(BELL.image(grid)) - g).max() < error * g.max()


def test_means_are_integrals_over_lengths_of_circles(arc):
    means = circular_means(arc, BELL.image(arc.grid))
    assert jnp.allclose(means * 2 * np.pi * arc.radii, forward_operator(arc)(BELL.image(arc.grid)))


def test_jax_compiles_methods_as_they_are(arc):
    """Of the operator, phantoms, regions and curves."""
    operator, image = forward_operator(arc), BELL.image(arc.grid)
    points = arc.grid.points
    for method, arguments in (
        (operator, (image,)),
        (operator.mv, (image,)),
        (operator.T.mv, (operator(image),)),
        (BELL, (points,)),
        (BELL.image, (arc.grid,)),
        (BELL.circular_integrals, (arc.curve, arc.radii)),
        (BELL.fourier, (arc.frequencies, arc.sizes.angles)),
        (arc.region.contains, (points,)),
        (polygon([(0, 0), (1, 0), (0, 1)]).contains, (points,)),
    ):
        found, plain = jax.jit(method)(*arguments), method(*arguments)
        assert jnp.allclose(found, plain, atol=1e-12)
    assert operator == operator and operator != forward_operator(arc)
    assert jax.jit(operator.as_matrix)().shape == (operator(image).size, image.size)


def test_what_cannot_be_computed_is_refused(arc):
    operator = forward_operator(arc)
    for image, message in (
        (np.zeros((20, 21)), r"image has shape \(20, 21\), expected \(..., 21, 21\)"),
        (np.full((21, 21), np.nan), "image holds 441 NaN"),
        (np.zeros((21, 21), complex), "image has dtype complex128"),
        (np.zeros((0, 21, 21)), "none at all"),
    ):
        with pytest.raises(ValueError, match=message):
            operator.mv(image)
    with pytest.raises(ValueError, match="data has shape"):
        operator.T.mv(np.zeros((3, 3)))
    with pytest.raises(ValueError, match="expected float64 or float32"):
        forward_operator(arc, dtype=jnp.float16)
    with pytest.raises(ValueError, match="tolerance is 2"):
        forward_operator(arc, tolerance=2)
    with pytest.raises(ValueError, match="low_pass is 'hann'"):
        forward_operator(arc, low_pass="hann")


FULL, HALF = "full_circle_64_detectors.npz", "half_disk_three_quarter_arc.npz"


@pytest.mark.parametrize("data_file", [FULL], indirect=True)
def test_data_of_another_code_are_those_of_its_truth(data_file):
    """Waves that others simulated, from detectors inside the square of the image.

    Of the same object there is a second record, at 38 of these detectors with all gains whole. It
    is not as exact: what the operator leaves of it is by how much the two records differ.
    """
    full, half = np.load(data_file), np.load(data_file.with_name(HALF))
    theta = 2 * np.pi * np.arange(64) / 64
    curve = detector_curve(np.stack([np.cos(theta), np.sin(theta)], axis=1))
    radii = np.linspace(0.0, 2.0, 257)[1:]
    times = np.linspace(0.0, 6.0, full["pressure"].shape[0])

    def integrals(pressure):
        return pressure_to_circular_integrals(pressure.T.astype(float), times, radii)

    g = integrals(full["pressure"])
    setup = coarse(curve, disk(0.9), ImageGrid(257), radii)
    found = forward_operator(setup).mv(full["truth"].T.astype(float))
    assert jnp.linalg.norm(found - g) < 1e-5 * jnp.linalg.norm(g)
    other = integrals(half["pressure"][:, : 38 * 16 : 16])
    between = jnp.linalg.norm(other - g[:38])
    left = jnp.linalg.norm(other - found[:38])
    assert between > 1e-3 * jnp.linalg.norm(g[:38])
    assert jnp.abs(left / between - 1) < 1e-3


@pytest.mark.parametrize("name", ["arc", "uneven on a circle", "ellipse"])
def test_elements_have_the_mean_of_their_points(name):
    """Of many point detectors, arcs of the circle on an arc and straight pieces elsewhere."""
    curve, region = CURVES[name]
    width = jnp.asarray(0.15)
    n = 400
    if name == "arc":
        turns = (np.arange(n) + 0.5) / n - 0.5
        angles = np.asarray(curve.angle + np.pi + curve.angles)[:, None] + turns * float(
            width / curve.radius
        )
        points = float(curve.radius) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    else:
        along = np.stack([-curve.normals[:, 1], curve.normals[:, 0]], axis=-1)[:, None, :]
        pieces = float(width) * ((np.arange(n) + 0.5) / n - 0.5)
        points = np.asarray(curve.points)[:, None] + pieces[:, None] * along
    radii, some = np.linspace(0.3, 2.3, 9), slice(0, 24, 9)
    of_points = [
        jnp.mean(BELL.circular_integrals(only_points(near), radii), axis=0) for near in points[some]
    ]
    wide = eqx.tree_at(lambda c: c.element_width, curve, width, is_leaf=lambda x: x is None)
    setup = coarse(wide, region, GRID, radii)
    found = forward_operator(setup).mv(BELL.image(GRID))[some]
    assert jnp.abs(found - jnp.stack(of_points)).max() < 2e-5 * found.max()
    still = BELL.circular_integrals(only_points(np.asarray(curve.points)[some]), radii)
    assert jnp.abs(found - still).max() > 3e-4 * found.max()


def only_points(points):
    n = len(points)
    return SampledCurve(jnp.asarray(points), jnp.ones(n), jnp.ones((n, 2)), False)
