"""Plans and the whole pipeline: accuracy, invariances, batches, derivatives and refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from numpy.testing import assert_allclose

import jaxtat
from jaxtat import (
    PAPER_K,
    AccuracyWarning,
    FixedRank,
    ImageGrid,
    NormBound,
    Setup,
    SingularValueCutoff,
    Tikhonov,
    VisibilityWarning,
    build_plan,
    circular_arc,
    circular_integrals,
    cosine_filter,
    data_radii,
    detector_curve,
    disk,
    phantoms,
    problem_layout,
    reconstruct,
)
from jaxtat.densities import SampledDensities
from jaxtat.densities.harmonic import HarmonicDensities
from jaxtat.reconstruction import pipeline

BELL = phantoms.Bells([[0.2, 0.1], [-0.3, -0.2]], [0.6, 0.5], [1.0, 0.7])


SOLVED = ("harmonic", "collocation")


@pytest.fixture(scope="module")
def collocation_plan(small):
    return build_plan(Setup(*small), method="collocation")


@pytest.fixture(params=SOLVED)
def either_plan(request, small_plan, collocation_plan):
    """What holds for plans holds for those of either method."""
    return small_plan if request.param == "harmonic" else collocation_plan


@pytest.fixture(scope="module")
def half_circle():
    """A half disk before a half circle: (curve, region, grid, radii)."""
    grid = ImageGrid(33)
    curve, region = circular_arc(1.3, 0.0, 130), disk(1.0, 0.0, n_boundary=260)
    return curve, region, grid, data_radii(curve, region, grid.spacing[0])


@pytest.fixture(scope="module")
def half_circle_plans(half_circle):
    return {method: build_plan(Setup(*half_circle), method=method) for method in SOLVED}


HALF_BELL = phantoms.Bells([[-0.45, 0.1]], [0.4])


def method_of(plan):
    return "harmonic" if isinstance(plan.densities, HarmonicDensities) else "collocation"


def largest(plan, image):
    return float(jnp.abs(image)[plan.region.contains(plan.grid.points)].max())


def largest_error(plan, image, phantom):
    return largest(plan, image - phantom.image(plan.grid))


def test_a_smooth_phantom_comes_back(either_plan):
    g = BELL.circular_integrals(either_plan.curve, either_plan.radii)
    assert largest_error(either_plan, reconstruct(either_plan, g), BELL) < 1e-3


@pytest.mark.parametrize("method", SOLVED)
def test_half_circle_and_half_disk(half_circle_plans, method):
    plan = half_circle_plans[method]
    image = reconstruct(plan, HALF_BELL.circular_integrals(plan.curve, plan.radii))
    assert largest_error(plan, image, HALF_BELL) < 1e-2


@pytest.mark.filterwarnings("ignore::jaxtat.AccuracyWarning")  # a rank is too low for some waves
@pytest.mark.parametrize(
    ("geometry", "rule", "tolerance"),
    [
        ("half_circle", SingularValueCutoff(1e-2), 1e-9),
        ("small", FixedRank(80.3), 1e-6),  # keeps singular values 1e-9 times the largest
        ("small", Tikhonov(np.geomspace(1e-3, 1e-5, 32)), 1e-6),
    ],
)
def test_both_methods_solve_the_same_problem(request, geometry, rule, tolerance):
    """Singular values, accuracy and images agree to rounding where the rule names the terms."""
    curve, region, grid, radii = request.getfixturevalue(geometry)
    one, other = (
        build_plan(Setup(*(curve, region, grid, radii, rule), n_directions=16), method=method)
        for method in SOLVED
    )
    for name in ("j_max", "norm", "residual"):
        assert_allclose(getattr(one.report, name), getattr(other.report, name), rtol=tolerance)
    rank = one.report.singular_values.shape[1]
    values = other.report.singular_values
    assert_allclose(one.report.singular_values, values[:, :rank], atol=1e-12 * values.max())
    noise = jnp.asarray(np.random.default_rng(0).standard_normal((130, radii.shape[0])))
    image = reconstruct(other, noise)
    inside = region.contains(grid.points)
    found = reconstruct(one, noise)[inside]
    assert_allclose(found, image[inside], atol=tolerance * largest(other, image))


def test_both_methods_are_alike_under_the_norm_bound(
    half_circle_plans, small_plan, collocation_plan
):
    """A bound that is not reached is filled with components near rounding, which are anyone's.

    They add nothing on the boundary and little to images, far less than these are wrong by.
    """
    pairs = [(small_plan, collocation_plan, BELL), (*half_circle_plans.values(), HALF_BELL)]
    for one, other, bell in pairs:
        assert_allclose(one.report.residual, other.report.residual, atol=1e-11)
        assert np.all(one.report.norm <= PAPER_K * one.report.unit_norm[:, None] * (1 + 1e-9))
        g = bell.circular_integrals(one.curve, one.radii)
        image = reconstruct(other, g)
        difference = largest(one, reconstruct(one, g) - image)
        assert difference < 1e-2 * largest_error(other, image, bell)


def test_collocation_is_for_detectors_nearer_to_the_centre_than_the_region_reaches():
    """A cap of a disk, whose centre is close to the ellipse of detectors around the cap."""
    angle = 2 * np.pi * np.arange(120) / 120
    curve = detector_curve(np.stack([-0.6 + 0.75 * np.cos(angle), 1.25 * np.sin(angle)], axis=1))
    region, grid = disk(1.0, -0.3, n_boundary=200), ImageGrid(33)
    radii = data_radii(curve, region, grid.spacing[0])
    with pytest.raises(ValueError, match=r"only 0\.74\d* away.*'collocation' of build_plan"):
        build_plan(Setup(curve, region, grid, radii), method="harmonic")
    # found without being asked for; the norm of the rule is the microlocal one
    plan = build_plan(Setup(curve, region, grid, radii), NormBound(PAPER_K))
    bell = phantoms.Bells([[-0.6, 0.1]], [0.35])
    image = reconstruct(plan, bell.circular_integrals(curve, radii))
    assert largest_error(plan, image, bell) < 1e-2
    assert plan.report.residual.max() < 1e-8


def turned(points, angle, shift):
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]]) + shift


@pytest.mark.parametrize("method", SOLVED)
def test_turning_and_moving_everything_changes_nothing(small, small_plan, method):
    angle, shift = 2.0, np.array([5.0, -3.0])
    place = {"center": shift, "angle": angle}
    curve = circular_arc(1.3, 1.0, 130, **place)
    region = disk(1.0, n_boundary=260)
    grid, radii = ImageGrid(33, 1.0, shift), small[3]
    plan = build_plan(Setup(curve, region, grid, radii), method=method)
    moved = phantoms.Bells(turned(BELL.centers, angle, shift), BELL.radii, BELL.amplitudes)
    image = reconstruct(plan, moved.circular_integrals(curve, radii))
    assert largest_error(plan, image, moved) < 1e-3
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    assert np.allclose(g, moved.circular_integrals(curve, radii), atol=1e-13)


def test_the_unit_of_length_does_not_matter(small, either_plan):
    mm = 1e-3
    curve = circular_arc(1.3 * mm, 1.0 * mm, 130)
    region = disk(mm, n_boundary=260)
    geometry = curve, region, ImageGrid(33, mm), small[3] * mm
    plan = build_plan(Setup(*geometry), method=method_of(either_plan))
    g = BELL.circular_integrals(either_plan.curve, either_plan.radii)
    assert np.allclose(
        reconstruct(plan, g * mm), reconstruct(either_plan, g), atol=1e-6
    )  # rounding, amplified by the smallest singular values kept


def test_radii_must_reach_sources_outside_the_region_too():
    """Circles that miss the region still carry what lies outside it; cutting them is an error."""
    grid = ImageGrid(33, 0.6)
    curve, region = circular_arc(1.3, 1.0, 200), disk(0.6, n_boundary=400)
    outside = phantoms.Bells([[0.5, 0.3], [-0.6, -0.3]], [0.4, 0.35])

    def error(radii):
        plan = build_plan(Setup(curve, region, grid, radii, max_frequency=100.0))
        image = reconstruct(plan, outside.circular_integrals(curve, radii))
        return largest_error(plan, image, outside)

    whole = data_radii(curve, region, 1 / 40, sources=disk(1.0, n_boundary=200))
    assert error(whole) < 1e-4
    assert error(data_radii(curve, region, 1 / 40)) > 0.1


def test_the_plan_keeps_the_rule_that_was_used(either_plan):
    assert isinstance(either_plan.regularization, NormBound)
    assert float(either_plan.regularization.K) == PAPER_K
    kinds = {"harmonic": HarmonicDensities, "collocation": SampledDensities}
    assert type(either_plan.densities) is kinds[method_of(either_plan)]


@pytest.mark.parametrize("method", SOLVED)
def test_rules_may_differ_between_frequencies(small, method):
    K = np.linspace(2.0, 5.0, 32)
    few = {"method": method, "n_directions": 16, "progress": False}
    varied = build_plan(Setup(*small), NormBound(K), **few)
    for i in (0, 13, 31):
        plain = build_plan(Setup(*small), NormBound(K[i]), **few)
        for name in ("j_max", "norm", "residual"):
            found, expected = getattr(varied.report, name)[i], getattr(plain.report, name)[i]
            assert_allclose(found, expected, rtol=1e-9)


def test_the_default_method_is_harmonic(small_plan):
    assert method_of(small_plan) == "harmonic"


@pytest.mark.parametrize(
    ("rule", "method", "message"),
    [
        (FixedRank(3), "series", "closed form"),
        (Tikhonov(1e-6), "series", "closed form"),
        (
            FixedRank([3.0, 4.0]),
            "harmonic",
            r"j_max has shape \(2,\), expected a number or",
        ),
        (FixedRank([3.0, 4.0]), "collocation", "j_max has shape"),
    ],
)
def test_rules_that_a_method_cannot_use_are_refused(small, rule, method, message):
    with pytest.raises(ValueError, match=message):
        build_plan(Setup(*small), rule, method=method)


@pytest.mark.parametrize("method", SOLVED)
def test_plans_can_be_built_under_jit_for_a_traced_K(small, method):
    curve, region, grid, radii = small
    g = BELL.circular_integrals(curve, radii)

    def image(K):
        plan = build_plan(
            Setup(*(curve, region, grid, radii, NormBound(K)), max_frequency=15.0), method=method
        )
        return reconstruct(plan, g)

    assert np.allclose(jax.jit(image)(3.0), image(3.0), atol=1e-10)


def test_traced_geometry_without_a_layout_is_refused(small):
    curve, region, grid, radii = small
    with pytest.raises(ValueError, match=r"layout = problem_layout"):
        jax.jit(lambda r: build_plan(Setup(curve, region, grid, r)).radii)(radii)
    with pytest.raises(ValueError, match="series"):
        full = circular_arc(1.3, 1.3, 130)
        jax.grad(lambda r: build_plan(Setup(full, region, grid, r), method="series").radii.sum())(
            radii
        )


# the paper's geometries in small: of the first one all singular values come nearly in pairs
@pytest.mark.filterwarnings("ignore::jaxtat.AccuracyWarning")
@pytest.mark.parametrize(
    ("method", "right"), [("harmonic", 1.0), ("harmonic", 0.0), ("collocation", 0.0)]
)
def test_derivatives_of_the_image_in_the_geometry(method, right):
    grid = ImageGrid(9)

    def geometry(z_right, radius, x_right, turn):
        curve = circular_arc(1.3 * radius, z_right, 24, angle=turn)
        size = {"n_chord": 0 if right == 1.0 else 18}
        return curve, disk(radius, x_right, n_boundary=48)

    start = (right + 0.05, 1.0, right, 0.02)
    radii = data_radii(*geometry(*start), grid.spacing[0])
    g = BELL.circular_integrals(geometry(*start)[0], radii)
    where = {"max_frequency": 7.0, "n_directions": 8}
    layout = problem_layout(*geometry(*start), grid, radii, method=method, **where)
    weights = jnp.asarray(np.random.default_rng(0).standard_normal((9, 9)))

    @jax.jit
    def loss(z_right, radius, x_right, turn, shift, K):
        curve, region = geometry(z_right, radius, x_right, turn)
        if right == 0.0:  # every detector by itself; else the arc remains one
            curve = detector_curve(curve.points + shift, closed=False)
        plan = build_plan(Setup(curve, region, grid, radii), NormBound(K), method=method)
        return jnp.sum(weights * reconstruct(plan, g))

    shift = jnp.asarray(0.01 * np.random.default_rng(1).standard_normal((24, 2)))
    arguments = (*map(jnp.asarray, start), shift, jnp.array(3.3))
    check_grads(loss, arguments, 1, modes=["fwd", "rev"], eps=1e-6, atol=1e-4, rtol=1e-4)
    slopes = jax.grad(loss, range(6))(*arguments)
    assert all(np.isfinite(slope).all() for slope in slopes)
    moving = [bool(np.abs(slope).max() > 0) for slope in slopes]
    # a disk has no chord to move, and an arc no single detectors
    assert moving == [True, True, right == 0.0, True, right == 0.0, True]


def test_too_few_detectors_are_reported():
    grid = ImageGrid(33)
    curve, region = circular_arc(1.3, 1.0, 20), disk(1.0, n_boundary=260)
    radii = data_radii(curve, region, grid.spacing[0])
    with pytest.warns(AccuracyWarning, match="of the plane waves are off"):
        build_plan(Setup(curve, region, grid, radii))


def test_batches_are_reconstructed_alike(either_plan):
    g = BELL.circular_integrals(either_plan.curve, either_plan.radii)
    batch = jnp.stack([g, 2 * g, -g, 0 * g]).reshape(2, 2, *g.shape)
    images = reconstruct(either_plan, batch)
    one = reconstruct(either_plan, g)
    assert images.shape == (2, 2, 33, 33)
    assert np.allclose(images[0, 1], 2 * one, atol=1e-12)
    assert np.allclose(images[1, 1], 0)
    assert np.allclose(reconstruct(either_plan, g[None])[0], one, atol=1e-13)


def test_single_precision_densities_cost_little(small, either_plan):
    plan = build_plan(Setup(*small), method=method_of(either_plan), precision="single")
    large = plan.densities.groups if method_of(plan) == "harmonic" else plan.densities
    assert {leaf.dtype.name for leaf in jax.tree.leaves(large)} <= {"float32", "complex64"}
    g = BELL.circular_integrals(either_plan.curve, either_plan.radii)
    image = reconstruct(plan, g)
    assert image.dtype == jnp.float64
    assert np.allclose(image, reconstruct(either_plan, g), atol=1e-5)


def test_float32_data_are_accepted(either_plan):
    g = BELL.circular_integrals(either_plan.curve, either_plan.radii)
    assert np.allclose(
        reconstruct(either_plan, g.astype(jnp.float32)), reconstruct(either_plan, g), atol=1e-5
    )


def test_low_pass_smooths(small_plan):
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    noise = phantoms.noise_like(jax.random.key(0), g, 0.15)
    inside = small_plan.region.contains(small_plan.grid.points)
    rough = reconstruct(small_plan, noise)[inside].std()
    assert reconstruct(small_plan, noise, low_pass=cosine_filter)[inside].std() < 0.6 * rough


@pytest.mark.parametrize("inversion", ["fbp", "fourier"])
def test_gradient_with_respect_to_the_data_is_the_adjoint(either_plan, inversion):
    rng = np.random.default_rng(0)
    shape = (either_plan.curve.n_detectors, either_plan.radii.shape[0])
    g = jnp.asarray(rng.standard_normal(shape))
    image = jnp.asarray(rng.standard_normal(either_plan.grid.shape))
    forward, back = jax.vjp(lambda g: reconstruct(either_plan, g, inversion=inversion), g)
    one, other = jnp.vdot(forward, image), jnp.vdot(g, back(image)[0])
    assert abs(float(one - other)) < 1e-10 * float(
        jnp.linalg.norm(forward) * jnp.linalg.norm(image)
    )


def test_gradient_runs_from_the_image_through_the_data_to_the_image(small, small_plan):
    curve, region, grid, radii = small
    inside = region.contains(grid.points)
    target = BELL.image(grid)

    def loss(image):
        g = circular_integrals(image, grid, curve, radii)
        return jnp.sum(jnp.where(inside, reconstruct(small_plan, g) - target, 0.0) ** 2)

    rng = np.random.default_rng(1)
    direction = jnp.asarray(rng.standard_normal(grid.shape))
    start, step = 0.5 * target, 1e-4
    slope = float(jnp.vdot(jax.grad(loss)(start), direction))
    difference = loss(start + step * direction) - loss(start - step * direction)
    assert np.isclose(slope, float(difference) / (2 * step), rtol=1e-6)


@pytest.mark.filterwarnings("ignore::jaxtat.AccuracyWarning")
def test_derivatives_of_the_image_in_K_and_j_max_by_collocation():
    """In waves: test_gradients.py."""
    grid = ImageGrid(9)
    curve, region = circular_arc(1.3, 0.6, 24), disk(1.0, 0.6, n_boundary=48)
    radii = data_radii(curve, region, grid.spacing[0])
    g = BELL.circular_integrals(curve, radii)

    def total(rule):
        plan = build_plan(
            Setup(*(curve, region, grid, radii, rule), max_frequency=7.0, n_directions=8),
            method="collocation",
        )
        return jnp.sum(reconstruct(plan, g)[2:5] ** 2)

    for make, at in ((NormBound, 2.34), (FixedRank, 11.3)):
        slope = jax.grad(lambda value, make=make: total(make(value)))(at)
        step = 1e-5
        difference = total(make(at + step)) - total(make(at - step))
        assert np.isclose(float(slope), float(difference) / (2 * step), rtol=1e-5)
        assert abs(float(slope)) > 0


def test_new_numbers_do_not_retrace(small_plan, monkeypatch):
    traced = []
    original = pipeline.radial_transform

    def counted(*arguments):
        traced.append(1)
        return original(*arguments)

    monkeypatch.setattr(pipeline, "radial_transform", counted)
    jax.clear_caches()
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    for scale in (1.0, 2.0, 3.5):
        reconstruct(small_plan, scale * g)
    assert len(traced) == 1


@pytest.mark.parametrize("method", SOLVED)
def test_the_bar_shows_progress(small, capsys, method):
    build_plan(Setup(*small, max_frequency=4.0, n_directions=8), method=method)
    assert "densities: 100%" in capsys.readouterr().err


def test_a_poking_region_is_reported_not_refused():
    grid = ImageGrid(9)
    curve, region = circular_arc(1.3, 0.0, 30), disk(1.0, n_boundary=60)
    radii = data_radii(curve, region, grid.spacing[0])
    with pytest.warns(VisibilityWarning, match="of the lines through the region miss the curve"):
        build_plan(Setup(curve, region, grid, radii, max_frequency=4, n_directions=8))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"curve": circular_arc(1.0, 1.0, 60)}, "detectors lie inside or on the region"),
        ({"curve": circular_arc(1300.0, 1000.0, 60)}, "same unit of length"),
        ({"region": disk(1.0, n_boundary=12)}, "use n_collocation >= "),
        ({"radii": np.linspace(0.6, 1.5, 20)}, "meet the region of interest for radii"),
        ({"radii": np.linspace(0.3, np.nan, 20)}, "NaN"),
        ({"radii": np.linspace(0.3, 2.3, 20)[:, None]}, "radii has shape"),
        ({"grid": ImageGrid(9, 0.1, (5.0, 5.0))}, "no node of the image grid"),
        ({"max_frequency": -1.0}, "max_frequency is -1"),
        ({"n_directions": 0}, "n_directions is 0"),
        ({"method": "magic"}, "expected one of auto, harmonic, collocation, series"),
        ({"precision": "half"}, "expected 'double' or 'single'"),
    ],
)
def test_bad_geometries_are_refused(change, message):
    grid = ImageGrid(9)
    curve, region = circular_arc(1.3, 1.0, 60), disk(1.0, n_boundary=120)
    arguments = {
        "curve": curve,
        "region": region,
        "grid": grid,
        "radii": data_radii(curve, region, grid.spacing[0]),
        "progress": False,
    }
    with pytest.raises(ValueError, match=message):
        build_plan(**(arguments | change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda g: g[:-1], r"g has shape \(129, "),
        (lambda g: g.T, "g has shape"),
        (lambda g: g[0], "g has shape"),
        (lambda g: g.at[3, 4].set(jnp.nan), r"first at index \(3, 4\)"),
        (lambda g: g.at[3, 4].set(jnp.inf), "NaN or infinite"),
        (lambda g: "pressure.npz", "no array of real numbers"),
        (lambda g: g + 0j, "complex128, expected float64 or float32"),
        (lambda g: (1000 * g).astype(jnp.uint16), "raw counts"),
    ],
)
def test_bad_data_are_refused(small_plan, change, message):
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    with pytest.raises(ValueError, match=message):
        reconstruct(small_plan, change(g))


def test_an_unknown_inversion_is_refused(small_plan):
    with pytest.raises(ValueError, match="inversion is 'magic', expected one of fbp, fourier"):
        reconstruct(small_plan, np.zeros((130, 33)), inversion="magic")


def test_32_bits_are_refused_with_the_remedy(small_plan):
    with jax.enable_x64(False):
        with pytest.raises(ValueError, match="jax_enable_x64"):
            circular_arc(1.3, 1.0, 10)
        with pytest.raises(ValueError, match="jax_enable_x64"):
            reconstruct(small_plan, np.zeros((130, 33), np.float32))


def test_public_names_are_what_the_package_says():
    for name in jaxtat.__all__:
        assert getattr(jaxtat, name).__doc__, name
