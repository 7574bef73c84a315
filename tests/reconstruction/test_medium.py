"""A body of another speed of sound, from image to data and back, of detectors on a circle.

The reference is the series of `gaussians_in_a_body`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special as sp
from gaussians_in_a_body import (
    CENTER,
    CURVE,
    GRID,
    INSIDE,
    RADII,
    RADIUS,
    body,
    gaussians,
    series,
    waves_at_the_detectors,
)

import jaxtat
from jaxtat import (
    DiskBody,
    ImageGrid,
    OutlineBody,
    RelativeTikhonov,
    Setup,
    Tikhonov,
    build_plan,
    circular_arc,
    disk,
    forward_operator,
    live,
    model_based,
    reconstruct,
    solve,
)
from jaxtat.fitting import coarse_grids
from jaxtat.io import load_plan, save_plan
from jaxtat.reconstruction import operator_on
from jaxtat.records import (
    circular_integrals_to_pressure,
    pressure_to_circular_integrals,
    simulate_pressure,
)
from jaxtat.studies import calibrate, data_residual, pixel_standard_deviation

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def through():
    return Setup(CURVE, disk(RADIUS, center=CENTER), GRID, RADII, medium=body())


@pytest.fixture(scope="module")
def data(through):
    return forward_operator(through)(gaussians(GRID))


@pytest.mark.parametrize(
    ("speed", "density", "center", "sized"),
    [
        (0.9, 1.1, CENTER, CENTER),
        (1.04, 1.0, CENTER, CENTER),
        (0.9, 1.1, np.zeros(2), np.zeros(2)),
        (1.04, 1.0, np.zeros(2), CENTER),
    ],
    ids=["off the centre, slower", "off the centre, faster", "concentric", "moved onto the centre"],
)
def test_waves_at_the_detectors_are_those_of_the_series(speed, density, center, sized):
    """A disk in a disk in closed form: every frequency of the forward operator."""
    curve, grid = circular_arc(1.0, np.cos(np.pi / 4), 24), ImageGrid(65, 0.45, sized)
    first = body(speed, density, sized)
    setup = Setup(curve, disk(RADIUS, center=sized), grid, RADII, medium=first)
    medium, grid = body(speed, density, center), ImageGrid(65, 0.45, center)
    found = waves_at_the_detectors(setup, grid, medium, gaussians(grid, center))
    wanted = series(medium, np.asarray(curve.points), setup.sizes.operator.frequencies).real
    assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max()


def test_the_image_of_exact_data(through, data):
    """Data from the series itself, on a longer period; with one speed the image is wrong."""
    period, n = 8.0, 280
    zeros = sp.jn_zeros(0, n)
    each = series(through.medium, np.asarray(CURVE.points), zeros / period).real
    each = each / (np.pi * period**2 * sp.j1(zeros)[:, None] ** 2)
    g = 2 * np.pi * RADII * (each.T @ sp.j0(zeros[:, None] / period * RADII))
    assert np.abs(data - g).max() < 2e-3 * np.abs(g).max()  # but for late waves, which wrap around
    truth, image = gaussians(GRID)[INSIDE], solve(through, g, 1e-7).image[INSIDE]
    one = solve(Setup(CURVE, disk(RADIUS, center=CENTER), GRID, RADII), g, 1e-7).image[INSIDE]
    error = [np.linalg.norm(found - truth) / np.linalg.norm(truth) for found in (image, one)]
    assert error[0] < 3e-3 < 0.25 < error[1]


@pytest.mark.parametrize(("speed", "step"), [(1.25, 0.02), (0.8, 0.025)])
def test_radii_by_default_hold_the_waves_of_the_pixels(through, speed, step):
    """In slower water they are shorter, and radii as far apart as pixels would miss some."""
    setup = Setup(CURVE, through.region, GRID, medium=body(speed))
    assert np.isclose(setup.radii[1] - setup.radii[0], step)
    assert np.isclose(setup.sizes.max_frequency, np.pi / 0.025)


def test_equal_speeds_are_one_speed(through):
    same = through.replace(medium=body(1.0))
    plain = Setup(CURVE, through.region, GRID, RADII)
    g = forward_operator(plain)(gaussians(GRID))
    assert np.abs(forward_operator(same)(gaussians(GRID)) - g).max() < 1e-7 * np.abs(g).max()
    image, wanted = solve(same, g, 1e-6).image, solve(plain, g, 1e-6).image
    assert np.abs(image - wanted)[INSIDE].max() < 1e-5 * np.abs(wanted).max()


def test_a_region_beside_the_centre_of_the_body(through, data):
    """A smaller region, a polygon, and one that turns with the axis: the same pixels."""
    corners = CENTER + 0.3 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    wanted = solve(through, data, 1e-7).image
    for region in (jaxtat.polygon(corners), disk(0.35, center=CENTER + 0.03)):
        setup = Setup(CURVE, region, GRID, RADII, medium=through.medium)
        image, inside = solve(setup, data, 1e-7).image, region.contains(GRID.points)
        assert np.abs(image - wanted)[np.asarray(inside)].max() < 0.01 * np.abs(wanted).max()


def test_the_transpose_is_exact(through):
    rng = np.random.default_rng(0)
    f, g = rng.standard_normal(GRID.shape), rng.standard_normal(through.data_shape)
    operator = forward_operator(through)
    assert np.isclose(np.vdot(operator(f), g), np.vdot(f, operator.T(g)), rtol=1e-11)


def test_plans_give_the_same_images(through, data, tmp_path):
    plan = build_plan(through, Tikhonov(1e-6))
    wanted = solve(through, data, 1e-6).image
    image = reconstruct(plan, data)
    assert np.abs(image - wanted).max() < 1e-8 * np.abs(wanted).max()
    save_plan(plan, tmp_path / "plan.h5")
    again = load_plan(tmp_path / "plan.h5")
    assert np.array_equal(reconstruct(again, data), image)
    deviation = pixel_standard_deviation(plan, 0.1)
    rng, images = np.random.default_rng(0), []
    for _ in range(40):
        images.append(reconstruct(plan, 0.1 * rng.standard_normal((5, *data.shape))))
    ratio = np.concatenate(images).std(axis=0)[INSIDE] / np.asarray(deviation)[INSIDE]
    assert abs(np.median(ratio) - 1) < 0.03


def test_live_images_are_those_of_solve(through, data):
    to_images = live(through, rule=1e-6, dtype=np.float64)
    wanted = solve(through, data, 1e-6).image
    assert np.abs(to_images(data) - wanted)[INSIDE].max() < 1e-8 * np.abs(wanted).max()


def test_the_residual_of_the_true_image_is_nothing(through, data):
    image = gaussians(GRID)
    wrong = through.replace(medium=body(1.03))
    right, wrong = (data_residual(one, data, image).relative for one in (through, wrong))
    assert right < 0.01 < 0.05 < wrong


def test_fits_begin_on_coarser_grids(through, monkeypatch):
    """Whose operator takes the first frequencies; the image's are those of the water over 1.04."""
    monkeypatch.setattr(coarse_grids, "COARSEST", 20)  # also of small images
    grid = ImageGrid(105, 0.45, CENTER)
    where = CURVE, through.region, grid, RADII
    setup = Setup(*where, medium=through.medium, max_frequency=60.0)
    truth, operator = gaussians(grid), forward_operator(setup)
    data, coarse = operator(truth), coarse_grids.ladder(grid)[0]
    assert coarse.shape == (27, 27)
    found = operator_on(setup, coarse)
    assert np.abs(found(gaussians(coarse)) - data).max() < 3e-3 * np.abs(data).max()
    assert found.report.n_frequencies < 0.3 * operator.report.n_frequencies
    assert abs(float(operator.max_frequency) / (np.pi / float(grid.spacing[0])) - 1) < 0.01
    low = operator_on(setup, grid, max_frequency=float(found.max_frequency) * 1.0001)
    assert low.report.n_frequencies == found.report.n_frequencies
    options = {"weight": 1e-4, "max_steps": 50}
    image = model_based(setup, data, **options).image
    inside = np.asarray(through.region.contains(grid.points))
    assert np.linalg.norm((image - truth)[inside]) < 0.03 * np.linalg.norm(truth)


def test_a_fit_through_a_fast_body_takes_as_long_as_any():
    """Of a region larger than the body. With all of its pixels: 500 steps, an error of 0.064."""
    grid, times = ImageGrid(65, 1.2 * RADIUS), np.arange(0.0, 2.2, 1 / 60)
    bells = jaxtat.phantoms.Bells([[0.15, 0.1], [-0.2, 0.1], [0.0, -0.25]], [0.12, 0.15, 0.1])
    medium = OutlineBody.ellipse((0.0, 0.0), (RADIUS, RADIUS), 1.08, 1.0)
    setup = Setup(circular_arc(1.0, 0.7, 120), disk(1.2 * RADIUS), grid, medium=medium)
    truth = np.asarray(bells.image(grid))
    record = np.asarray(simulate_pressure(setup, truth, times))
    noise = 0.01 * record.max() * np.random.default_rng(0).standard_normal(record.shape)
    given = {"times": times, "nonnegative": True, "tolerance": 2.5e-2}
    fit = model_based(setup, record + noise, **given)
    assert np.linalg.norm(np.asarray(fit.image) - truth) < 0.03 * np.linalg.norm(truth)
    assert fit.steps < 100 and fit.converged


@pytest.mark.parametrize("model", ["2d", "in-plane"])
def test_pressure_goes_with_the_integrals(through, data, model):
    times = np.linspace(0.0, 2.7, 271) / 1500
    speeds = DiskBody(CENTER, RADIUS, 1560.0, 1500.0)
    setup = through.replace(medium=speeds)
    record = simulate_pressure(setup, gaussians(GRID), times, model=model)
    sound = {"sound_speed": 1500.0, "model": model}
    again = pressure_to_circular_integrals(record, times, RADII, **sound)
    assert np.abs(again - data).max() < 3e-3 * np.abs(data).max()
    found = model_based(setup, record, times=times, model=model, max_steps=60)
    truth = gaussians(GRID)
    assert np.linalg.norm((found.image - truth)[INSIDE]) < 0.1 * np.linalg.norm(truth[INSIDE])
    with pytest.raises(ValueError, match="sound_speed is given, and the setup has a medium"):
        model_based(setup, record, times=times, **sound)
    with pytest.raises(ValueError, match="sound_speed is given, and the setup has a medium"):
        simulate_pressure(setup, gaussians(GRID), times, sound_speed=1500.0)


def test_pressure_of_one_speed_is_that_of_its_integrals():
    setup = Setup(CURVE, disk(RADIUS, center=CENTER), GRID, RADII)
    times = np.linspace(0.0, 4.0, 200)  # longer than the period of the operator
    record = simulate_pressure(setup, gaussians(GRID), times)
    fine = Setup(CURVE, setup.region, GRID, np.arange(0.3, 2.2, 1 / 160))
    g = forward_operator(fine)(gaussians(GRID))
    wanted = circular_integrals_to_pressure(g, fine.radii, times)
    assert np.abs(record - wanted).max() < 1e-4 * np.abs(wanted).max()


def numbers(setup, x):
    """The setup with a body of other numbers: c_1, c_2, a, rho_1/rho_2 and the centre."""
    return setup.replace(medium=DiskBody(x[4:], x[2], x[0], x[1], x[3]))


def test_derivatives_in_the_numbers_of_the_body(check_both_modes):
    """Against differences: c_1, c_2, a, densities and centre, of images and of data."""
    grid, curve = ImageGrid(13, 0.45, CENTER), circular_arc(1.0, np.cos(np.pi / 4), 30)
    small = Setup(curve, disk(RADIUS, center=CENTER), grid, RADII[::2], medium=body())
    data = forward_operator(small)(gaussians(grid))
    weights = jnp.asarray(np.random.default_rng(1).standard_normal(grid.shape))

    def summed(x):
        setup = numbers(small, x)
        image = solve(setup, data, 1e-4).image
        return jnp.vdot(weights, image), jnp.sum(forward_operator(setup)(weights) * data)

    # off the region's centre: at it there is a kink, of the disk that holds the region
    at = jnp.array([1.04, 1.0, RADIUS, 1.02, *CENTER + 0.02])
    check_both_modes(summed, (at,), step=3e-6, rtol=1e-6, atol=1e-6)


def test_new_numbers_compile_nothing(through, data):
    @eqx.filter_jit
    def image(x):
        count.append(x)
        return solve(numbers(through, x), data, 1e-4).image

    count = []
    for speed in (1.04, 1.03, 0.97):
        found = image(jnp.array([speed, 1.0, RADIUS, 1.0, *CENTER]))
    assert len(count) == 1
    wanted = solve(through.replace(medium=body(0.97)), data, 1e-4).image
    assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max()


def test_an_outline_that_is_a_circle_is_a_disk(through, data):
    """Data, images and plans; straight elements too."""
    outline = OutlineBody.ellipse(CENTER, (RADIUS, RADIUS), 1.04, 1.0)
    grid, curve = ImageGrid(21, 0.45, CENTER), circular_arc(1.0, np.cos(np.pi / 4), 40)
    where = curve, disk(RADIUS, center=CENTER), grid, RADII[::2]
    one, other = (Setup(*where, medium=medium) for medium in (through.medium, outline))
    image = gaussians(grid)
    wanted, operator = forward_operator(one)(image), forward_operator(other)
    assert np.abs(operator(image) - wanted).max() < 1e-8 * np.abs(wanted).max()
    weights = np.random.default_rng(0).standard_normal(wanted.shape)
    assert np.isclose(np.vdot(operator(image), weights), np.vdot(image, operator.T(weights)))
    image, again = (solve(each, wanted, 1e-6).image for each in (one, other))
    assert np.abs(image - again).max() < 1e-8 * np.abs(image).max()
    plan = build_plan(other, Tikhonov(1e-6))
    assert np.abs(reconstruct(plan, wanted) - again).max() < 1e-8 * np.abs(image).max()


def test_an_ellipse_in_its_own_numbers(through):
    """The image of its own data; derivatives in speed and half axes against differences."""
    grid, curve = ImageGrid(13, 0.45, CENTER), circular_arc(1.0, np.cos(np.pi / 4), 30)
    region = disk(0.36, center=CENTER)

    def body_of(x):
        return OutlineBody.ellipse(CENTER + 0.01, x[1:], x[0], 1.0, angle=0.3)

    at = jnp.array([1.06, 0.45, 0.38])
    setup = Setup(curve, region, grid, RADII[::2], medium=body_of(at))
    truth = gaussians(grid)
    data = forward_operator(setup)(truth)
    inside = np.asarray(region.contains(grid.points))
    wrong = [
        np.linalg.norm((solve(each, data, 1e-6).image - truth)[inside])
        for each in (setup, Setup(curve, region, grid, RADII[::2], medium=through.medium))
    ]
    assert wrong[0] < 0.1 * np.linalg.norm(truth) and wrong[0] < wrong[1]

    @jax.jit
    def total(x):
        return jnp.sum(solve(setup.replace(medium=body_of(x)), data, 1e-4).image * truth)

    slopes = jax.jit(jax.grad(total))(at)
    for number, unit in enumerate(np.eye(3)):
        difference = (total(at + 1e-4 * unit) - total(at - 1e-4 * unit)) / 2e-4
        assert abs(slopes[number] - difference) < 1e-4 * np.abs(slopes).max()


def test_outlines_that_waves_do_not_resolve_are_refused():
    """Three deep bays, at short waves; each of the ways out that the message names is one."""
    t = np.pi / 24 * np.arange(48)

    def setup_of(depth, highest, medium=None):
        radius = 0.4 * (1 + depth * np.cos(3 * t))
        points = np.stack([radius * np.cos(t), radius * np.sin(t)], axis=1)
        medium = OutlineBody(points, 1.04, 1.0) if medium is None else medium
        where = circular_arc(1.0, 1.0, 40), disk(0.3), ImageGrid(21, 0.3)
        return Setup(*where, medium=medium, max_frequency=highest)

    said = (
        r"^waves about .* miss the equations at the body's outline by 0\.\d+ of their size, .*0.02"
    )
    with pytest.raises(ValueError, match=said) as refused:
        setup_of(0.25, 60.0)
    assert "\n" not in str(refused.value)
    setup_of(0.1, 60.0), setup_of(0.25, 60.0, body(center=np.zeros(2))), setup_of(0.25, 20.0)


def test_what_takes_one_speed_says_so(through, data):
    with pytest.raises(ValueError, match="has a medium, and calibrate takes one speed of sound"):
        calibrate(through, data)
    with pytest.raises(ValueError, match="has a medium, and method 'collocation' takes one"):
        build_plan(through, RelativeTikhonov(0.1), method="collocation")
    with pytest.raises(ValueError, match=r"times are traced, expected known ones"):
        jax.jit(lambda t: simulate_pressure(through, gaussians(GRID), t))(jnp.ones(3))
