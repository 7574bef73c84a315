"""Plans: accuracy, invariances, batches, derivatives and refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exact import data_of, filtered, inside, turned
from numpy.testing import assert_allclose

from jaxtat import (
    PAPER_K,
    AccuracyWarning,
    FixedRank,
    ImageGrid,
    NormBound,
    Setup,
    Tikhonov,
    build_plan,
    circular_arc,
    cosine_filter,
    data_radii,
    detector_curve,
    disk,
    phantoms,
    reconstruct,
)
from jaxtat.densities import SampledDensities
from jaxtat.densities.cylindrical_waves import CylindricalDensities

BELL = phantoms.Bells([[0.08, 0.03], [-0.05, -0.06]], [0.9, 0.9], [1.0, 0.7])
HALF_BELL = phantoms.Bells([[-0.5, 0.1]], [0.45])
SOLVED = ("cylindrical", "collocation")


def with_boundary(setup, n_boundary=260, **sizes):
    """With points enough for collocation to agree with waves to rounding."""
    region = setup.region
    region = disk(region.radius, None if region.whole else region.cut, n_boundary=n_boundary)
    return Setup(setup.curve, region, setup.grid, setup.radii, **sizes)


@pytest.fixture(scope="module")
def collocation_plan(arc):
    return build_plan(with_boundary(arc), method="collocation")


@pytest.fixture(params=SOLVED)
def either_plan(request, arc_plan, collocation_plan):
    """What holds for plans holds for those of either method."""
    return arc_plan if request.param == "cylindrical" else collocation_plan


@pytest.fixture(scope="module")
def half_plans(half_arc):
    setup = with_boundary(half_arc)
    return {method: build_plan(setup, method=method) for method in SOLVED}


@pytest.fixture(scope="module")
def data(arc):
    return data_of(BELL, arc)


def method_of(plan):
    return "cylindrical" if isinstance(plan.densities, CylindricalDensities) else "collocation"


def largest(plan, image):
    return float(np.abs(image)[inside(plan.setup)].max())


def largest_error(plan, image, phantom):
    return largest(plan, np.asarray(image) - phantom.image(plan.grid))


def test_a_smooth_phantom_comes_back(either_plan, data):
    assert largest_error(either_plan, reconstruct(either_plan, data), BELL) < 1e-3


@pytest.mark.parametrize("method", SOLVED)
def test_half_circle_and_half_disk(half_plans, method):
    plan = half_plans[method]
    g = data_of(HALF_BELL, plan.setup)
    image = reconstruct(plan, g, low_pass=cosine_filter)
    assert largest(plan, image - filtered(plan.setup, HALF_BELL, cosine_filter)) < 1e-2


@pytest.mark.filterwarnings("ignore::jaxtat.AccuracyWarning")  # a rank is too low for some waves
@pytest.mark.parametrize(
    ("geometry", "rule", "tolerance"),
    [
        ("half_arc", FixedRank(30.3), 1e-9),
        ("arc", Tikhonov(np.geomspace(1e-3, 1e-5, 20)), 1e-6),
    ],
)
def test_both_methods_solve_the_same_problem(request, geometry, rule, tolerance):
    """Singular values, accuracy and images agree to rounding where the rule names the terms."""
    setup = with_boundary(request.getfixturevalue(geometry))
    one, other = (build_plan(setup, rule, method=method) for method in SOLVED)
    for name in ("j_max", "norm", "residual"):
        assert_allclose(getattr(one.report, name), getattr(other.report, name), rtol=tolerance)
    rank = one.report.singular_values.shape[1]
    values = other.report.singular_values
    assert_allclose(one.report.singular_values, values[:, :rank], atol=1e-12 * values.max())
    noise, within = np.random.default_rng(0).standard_normal(setup.data_shape), inside(setup)
    found, expected = (np.asarray(reconstruct(plan, noise))[within] for plan in (one, other))
    assert_allclose(found, expected, atol=tolerance * abs(expected).max())


def test_both_methods_are_alike_under_the_norm_bound(half_plans, arc_plan, collocation_plan):
    """A bound that is not reached is filled with components near rounding, which are anyone's.

    They add nothing on the boundary and little to images, far less than these are wrong by.
    """
    pairs = [(arc_plan, collocation_plan, BELL), (*half_plans.values(), HALF_BELL)]
    for one, other, bell in pairs:
        assert_allclose(one.report.residual, other.report.residual, atol=1e-11)
        assert np.all(one.report.norm <= PAPER_K * one.report.unit_norm[:, None] * (1 + 1e-9))
        g = data_of(bell, one.setup)
        image = reconstruct(other, g)
        difference = largest(one, reconstruct(one, g) - image)
        assert difference < 1e-2 * largest_error(other, image, bell)


def test_collocation_is_for_detectors_nearer_to_the_centre_than_the_region_reaches():
    """A cap of a disk, whose centre is close to the ellipse of detectors around the cap."""
    angle = 2 * np.pi * np.arange(120) / 120
    curve = detector_curve(np.stack([-0.6 + 0.75 * np.cos(angle), 1.25 * np.sin(angle)], axis=1))
    setup = Setup(curve, disk(1.0, -0.3), ImageGrid(33))
    with pytest.raises(ValueError, match=r"only 0\.74\d* away.*'collocation' of build_plan"):
        build_plan(setup, method="cylindrical")
    # found without being asked for; the norm of the rule is the microlocal one
    plan = build_plan(setup, NormBound(PAPER_K))
    bell = phantoms.Bells([[-0.6, 0.1]], [0.35])
    image = reconstruct(plan, data_of(bell, setup))
    assert largest_error(plan, image, bell) < 1e-2
    assert plan.report.residual.max() < 1e-8


@pytest.mark.parametrize("method", SOLVED)
def test_turning_and_moving_everything_changes_nothing(arc, data, method):
    angle, shift = 2.0, np.array([5.0, -3.0])
    curve = circular_arc(1.3, 1.0, 80, center=shift, angle=angle)
    region, grid = disk(1.0, center=shift, angle=angle), ImageGrid(21, 1.0, shift)
    plan = build_plan(arc.replace(curve=curve, region=region, grid=grid), method=method)
    moved = turned(BELL, angle, shift)
    g = data_of(moved, plan.setup)
    assert largest_error(plan, reconstruct(plan, g), moved) < 1e-3
    assert np.allclose(data, g, atol=1e-13)


def test_the_unit_of_length_does_not_matter(data, either_plan):
    mm = 1e-3
    curve, region = circular_arc(1.3 * mm, mm, 80), disk(mm, n_boundary=260)
    setup = Setup(curve, region, ImageGrid(21, mm), mm * either_plan.radii)
    plan = build_plan(setup, method=method_of(either_plan))
    assert np.allclose(
        reconstruct(plan, data * mm), reconstruct(either_plan, data), atol=1e-6
    )  # rounding, amplified by the smallest singular values kept


def test_radii_must_reach_sources_outside_the_region_too():
    """Circles that miss the region still carry what lies outside it; cutting them is an error."""
    grid = ImageGrid(33, 0.6)
    curve, region = circular_arc(1.3, 1.0, 200), disk(0.6)
    outside = phantoms.Bells([[0.5, 0.3], [-0.6, -0.3]], [0.4, 0.35])
    whole = data_radii(curve, region, 1 / 40, sources=disk(1.0))
    plan = build_plan(Setup(curve, region, grid, whole, max_frequency=100.0))
    g = np.asarray(data_of(outside, plan.setup))
    assert largest_error(plan, reconstruct(plan, g), outside) < 1e-4
    meeting = data_radii(curve, region, 1 / 40)
    cut = g * ((whole >= meeting[0]) & (whole <= meeting[-1]))
    assert largest_error(plan, reconstruct(plan, cut), outside) > 0.1


def test_the_plan_keeps_the_rule_that_was_used(either_plan):
    assert isinstance(either_plan.regularization, NormBound)
    assert float(either_plan.regularization.K) == PAPER_K
    kinds = {"cylindrical": CylindricalDensities, "collocation": SampledDensities}
    assert type(either_plan.densities) is kinds[method_of(either_plan)]


@pytest.mark.parametrize("method", SOLVED)
def test_rules_may_differ_between_frequencies(arc, method):
    setup, K = with_boundary(arc), np.linspace(2.0, 5.0, 20)
    varied = build_plan(setup, NormBound(K), method=method)
    for i in (0, 19):
        plain = build_plan(setup, NormBound(K[i]), method=method)
        for name in ("j_max", "norm", "residual"):
            found, expected = getattr(varied.report, name)[i], getattr(plain.report, name)[i]
            assert_allclose(found, expected, rtol=1e-9)


def test_the_default_method_is_cylindrical_waves(arc_plan):
    assert method_of(arc_plan) == "cylindrical"


@pytest.mark.parametrize(
    ("rule", "method", "message"),
    [
        (FixedRank(3), "series", "closed form"),
        (Tikhonov(1e-6), "series", "closed form"),
        (
            FixedRank([3.0, 4.0]),
            "cylindrical",
            r"j_max has shape \(2,\), expected a number or",
        ),
        (FixedRank([3.0, 4.0]), "collocation", "j_max has shape"),
    ],
)
def test_rules_that_a_method_cannot_use_are_refused(arc, rule, method, message):
    with pytest.raises(ValueError, match=message):
        build_plan(arc, rule, method=method)


def test_the_closed_form_needs_a_known_geometry(ring):
    with pytest.raises(ValueError, match="series"):
        jax.grad(lambda r: build_plan(ring.replace(radii=r), method="series").radii.sum())(
            ring.radii
        )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jaxtat.AccuracyWarning")
def test_derivatives_of_the_image_in_the_geometry(check_both_modes):
    """By collocation. By waves: ../test_gradients.py."""

    def geometry(end, radius, cut, turn):
        return circular_arc(1.3 * radius, end, 24, angle=turn), disk(radius, cut, angle=turn)

    curve, region = geometry(0.05, 1.0, 0.0, 0.02)
    curve = detector_curve(curve.points, closed=False)  # every detector by itself
    setup = Setup(curve, region, ImageGrid(9), max_frequency=7.0, n_directions=8)
    g = data_of(BELL, setup)
    weights = np.random.default_rng(0).standard_normal((9, 9))

    def loss(end, radius, turn, K, cut, shift):
        curve, region = geometry(end, radius, cut, turn)
        curve = detector_curve(curve.points + shift, closed=False)
        moved = setup.replace(curve=curve, region=region)
        plan = build_plan(moved, NormBound(K), method="collocation")
        return jnp.sum(weights * reconstruct(plan, g))

    shift = 0.01 * np.random.default_rng(1).standard_normal((24, 2))
    at = 0.05, 1.0, 0.02, 3.3, 0.0, shift
    slopes = check_both_modes(loss, at, 1e-6, rtol=1e-4, atol=1e-4)
    assert all(np.isfinite(slope).all() and np.abs(slope).max() > 0 for slope in slopes)


def test_too_few_detectors_are_reported(arc):
    with pytest.warns(AccuracyWarning, match="of the plane waves are off"):
        build_plan(Setup(circular_arc(1.3, 1.0, 16), arc.region, arc.grid))


def test_batches_are_reconstructed_alike(collocation_plan, data):
    """By waves: test_stack.py."""
    g = np.asarray(data)
    batch = np.stack([g, 2 * g, -g, 0 * g]).reshape(2, 2, *g.shape)
    images = np.asarray(reconstruct(collocation_plan, batch))
    one = reconstruct(collocation_plan, g)
    assert images.shape == (2, 2, 21, 21)
    assert np.allclose(images[0, 1], 2 * one, atol=1e-12)
    assert np.allclose(images[1, 1], 0)
    assert np.allclose(reconstruct(collocation_plan, g[None])[0], one, atol=1e-13)


def test_single_precision_densities_cost_little(data, either_plan):
    plan = build_plan(either_plan.setup, method=method_of(either_plan), precision="single")
    large = plan.densities.groups if method_of(plan) == "cylindrical" else plan.densities
    assert {leaf.dtype.name for leaf in jax.tree.leaves(large)} <= {"float32", "complex64"}
    image = reconstruct(plan, data)
    assert image.dtype == jnp.float64
    assert np.allclose(image, reconstruct(either_plan, data), atol=1e-5)


def test_float32_data_are_accepted(either_plan, data):
    single = reconstruct(either_plan, data.astype(jnp.float32))
    assert np.allclose(single, reconstruct(either_plan, data), atol=1e-5)


def test_low_pass_smooths(arc_plan, data):
    noise = phantoms.noise_like(jax.random.key(0), data, 0.15)
    within = inside(arc_plan.setup)
    rough = reconstruct(arc_plan, noise)[within].std()
    assert reconstruct(arc_plan, noise, low_pass=cosine_filter)[within].std() < 0.6 * rough


def test_gradient_with_respect_to_the_data_is_the_adjoint(collocation_plan):
    """By filtered back-projection. By a Fourier sum: interop/test_linear_operators.py."""
    plan, rng = collocation_plan, np.random.default_rng(0)
    g, image = map(rng.standard_normal, (plan.setup.data_shape, plan.grid.shape))
    forward, back = jax.vjp(lambda g: reconstruct(plan, g, inversion="fbp"), g)
    one, other = np.vdot(forward, image), np.vdot(g, back(image)[0])
    assert abs(one - other) < 1e-10 * np.linalg.norm(forward) * np.linalg.norm(image)


def test_plans_for_other_numbers_of_a_rule_have_the_same_sizes(arc):
    """And so share the program of `reconstruct`: sizes are rounded up."""
    plans = [build_plan(arc, NormBound(K)) for K in (3.0, 3.5, 4.0)]
    sizes = [[leaf.shape for leaf in jax.tree.leaves(plan.densities)] for plan in plans]
    assert sizes[0] == sizes[1] == sizes[2]


def test_the_bar_shows_progress_if_it_is_asked_for(either_plan, capsys):
    for progress in (False, True):
        build_plan(either_plan.setup, method=method_of(either_plan), progress=progress)
        assert ("densities: 100%" in capsys.readouterr().err) == progress


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "expected one of auto, cylindrical, collocation, series"),
        ({"precision": "half"}, "expected 'double' or 'single'"),
    ],
)
def test_bad_options_are_refused(arc, options, message):
    with pytest.raises(ValueError, match=message):
        build_plan(arc, **options)


def test_too_few_boundary_points_matter_to_collocation_alone(arc):
    """A number that an expert asked for; waves about the centre of a whole disk need none."""
    few = Setup(arc.curve, disk(1.0, n_boundary=12), arc.grid, arc.radii)
    with pytest.raises(ValueError, match="n_boundary"):
        build_plan(few, method="collocation")
    with pytest.raises(ValueError, match="n_boundary"):
        Setup(arc.curve, disk(1.0, 0.9, n_boundary=12), arc.grid, arc.radii)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda g: g[:-1], r"g has shape \(79, "),
        (lambda g: g.T, "g has shape"),
        (lambda g: g[0], "g has shape"),
        (lambda g: g.at[3, 4].set(jnp.nan), r"first at index \(3, 4\)"),
        (lambda g: g.at[3, 4].set(jnp.inf), "NaN or infinite"),
        (lambda g: "pressure.npz", "no array of real numbers"),
        (lambda g: g + 0j, "complex128, expected float64 or float32"),
        (lambda g: (1000 * g).astype(jnp.uint16), "raw counts"),
    ],
)
def test_bad_data_are_refused(arc_plan, data, change, message):
    with pytest.raises(ValueError, match=message):
        reconstruct(arc_plan, change(data))


def test_an_unknown_inversion_and_a_second_rule_are_refused(arc_plan, data):
    with pytest.raises(ValueError, match="inversion is 'magic', expected one of fourier, fbp"):
        reconstruct(arc_plan, data, inversion="magic")
    with pytest.raises(ValueError, match="the plan has its own"):
        reconstruct(arc_plan, data, 1e-3)


def test_32_bits_are_refused_with_the_remedy(arc, arc_plan):
    with jax.enable_x64(False):
        with pytest.raises(ValueError, match="jax_enable_x64"):
            circular_arc(1.3, 1.0, 10)
        with pytest.raises(ValueError, match="jax_enable_x64"):
            Setup(arc.curve, arc.region, arc.grid)
        with pytest.raises(ValueError, match="jax_enable_x64"):
            reconstruct(arc_plan, np.zeros((80, 21), np.float32))
