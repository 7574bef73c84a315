"""The problem as one thing: refusals, one warning, new positions without new programs, jit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exact import data_of
from jax.extend.core import jaxpr_as_fun
from numpy.testing import assert_allclose

from jaxtat import (
    FixedRank,
    ImageGrid,
    NoiseLevel,
    NormBound,
    RelativeCutoff,
    RelativeTikhonov,
    Setup,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
    VisibilityWarning,
    VolumeGrid,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    forward_operator,
    phantoms,
    polygon,
    reconstruct,
    solve,
)
from jaxtat.geometry import visibility_map, visible_disk
from jaxtat.spherical import DetectorPoints, ball, cap_radii, spherical_cap
from jaxtat.studies import data_residual, pixel_standard_deviation, predict_noise

ARC, DISK, GRID = circular_arc(1.3, 1.0, 24), disk(1.0), ImageGrid(9)
CAP, BALL, VOXELS = spherical_cap(1.5, 1.1, 6, 12), ball(1.0), VolumeGrid(4)
BELL = phantoms.Bells([[-0.3, 0.1]], [0.5])


@pytest.fixture(scope="module")
def small():
    """A few frequencies, for what compiles many programs."""
    return Setup(ARC, DISK, GRID, max_frequency=6.0, n_directions=8)


@pytest.fixture(scope="module")
def small_cut():
    curve, region = circular_arc(1.3, 0.0, 24), disk(1.0, 0.0)
    radii = np.linspace(0.29, 2.42, 10)  # no circle touches the region in one point
    # directions enough for a mean over all of them
    return Setup(curve, region, GRID, radii, max_frequency=6.0)


@pytest.fixture(scope="module")
def small_cap():
    return Setup(CAP, BALL, VOXELS, max_frequency=2.0, n_directions=8)


# ---- what is refused, and what is said once


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ((ARC, BALL, GRID), r"region is a Ball, expected for detectors in the plane.*disk\(rad"),
        ((ARC, DISK, VOXELS), r"grid is a VolumeGrid, expected for .* the plane.*ImageGrid\(n\)"),
        ((CAP, DISK, VOXELS), r"region is a Disk, expected for detectors in space.*ball\(radius"),
        ((CAP, BALL, GRID), r"grid is an ImageGrid, expected for .* space what VolumeGrid\(n\)"),
        ((ARC.points, DISK, GRID), r"curve is an array of shape \(24, 2\).*detector_curve\(pos"),
        ((ARC, DISK, 9), r"grid is 9, expected for .* the plane what ImageGrid\(n\) makes"),
        ((ARC, 1.0, GRID), r"region is 1\.0, expected"),
        ((circular_arc(1.0, 1.0, 24), DISK, GRID), "detectors lie inside or on the region"),
        ((circular_arc(1300.0, 1000.0, 24), DISK, GRID, np.linspace(0.3, 2.3, 9)), "same unit"),
        ((ARC, DISK, GRID, np.linspace(2.4, 3.5, 20)), "meet the region of interest for radii"),
        ((ARC, DISK, GRID, np.linspace(0.3, np.nan, 20)), "radii holds .* NaN"),
        ((ARC, DISK, GRID, np.linspace(0.3, 2.3, 20)[:, None]), "radii has shape"),
        ((ARC, DISK, GRID, np.linspace(2.3, 0.3, 20)), "in increasing order"),
        ((ARC, DISK, ImageGrid(9, 0.1, (5.0, 5.0))), "no node of the image grid"),
        ((spherical_cap(0.9, 0.7, 6, 12), BALL, VOXELS), "detectors are not outside of the region"),
        ((DetectorPoints(CAP.points.reshape(-1, 3)), ball(1.0, 0.0), VOXELS), "needs detectors on"),
    ],
)
def test_what_does_not_go_together_is_refused(parts, message):
    with pytest.raises(ValueError, match=message):
        Setup(*parts)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_frequency": -1.0}, "max_frequency is -1"),
        ({"max_frequency": 0.0}, "max_frequency is 0.*above zero"),
        ({"n_directions": 0}, "n_directions is 0, expected at least 1"),
    ],
)
def test_bad_sizes_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        Setup(ARC, DISK, GRID, **options)


@pytest.mark.parametrize(
    ("highest", "message"),
    [
        (-3.0, "highest is -3.*above zero"),
        (np.nan, "highest is nan"),
        ([1.0], "highest has sh"),
    ],
)
def test_pixels_that_sound_are_asked_of_a_real_frequency(small, highest, message):
    with pytest.raises(ValueError, match=message):
        small.may_sound(GRID, highest)


@pytest.mark.parametrize(
    "make",
    [
        lambda x: Setup(circular_arc(1.3 * x, 1.0, 24), DISK, GRID),
        lambda x: Setup(ARC, DISK, GRID, x * np.linspace(0.3, 2.3, 9)),
        lambda x: Setup(CAP, ball(x), VOXELS),
    ],
)
def test_traced_geometry_asks_for_replace(make):
    with pytest.raises(ValueError, match=r"are traced.*inside setup\.replace\(curve"):
        jax.jit(lambda x: make(x).radii)(1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"curve": circular_arc(1.3, 1.0, 25)}, "curve is a CircularArc of other"),
        ({"curve": CAP}, "curve is a SphericalCap of other sizes.*, a CircularArc"),
        ({"region": disk(1.0, 0.0)}, "region has the boundary pieces"),
        ({"region": polygon([(-0.5, -0.5), (0.5, -0.5), (0.0, 0.5)])}, "region"),
        ({"grid": ImageGrid(10)}, "grid is an ImageGrid of other sizes"),
        ({"radii": np.linspace(0.3, 2.3, 8)}, r"radii has shape \(8,\), expected \(9\)"),
        ({"radii": np.linspace(0.6, 1.5, 9)}, "meet the region of interest for radii"),
        ({"curve": circular_arc(0.9, 0.7, 24)}, "detectors lie inside or on the region"),
    ],
)
def test_replace_keeps_kinds_and_sizes(small, change, message):
    with pytest.raises(ValueError, match=message):
        small.replace(**change)


def test_a_whole_ball_is_not_replaced_by_a_part(small_cap):
    with pytest.raises(ValueError, match="region is a Ball of other sizes"):
        small_cap.replace(region=ball(1.0, 0.5))


def test_what_is_not_seen_is_said_once(small_cut):
    """When the setup is made, and not again by what takes it: warnings are errors here."""
    with pytest.warns(VisibilityWarning, match="of the lines through the region miss") as caught:
        setup = Setup(small_cut.curve, DISK, GRID, max_frequency=6.0, n_directions=8)
    assert len(caught) == 1

    def taken(g):
        again = setup.replace(radii=setup.radii)
        return reconstruct(setup, g), reconstruct(build_plan(again), g)

    jax.eval_shape(taken, jnp.zeros(setup.data_shape))  # positions are known: all that warns runs
    visibility_map(setup.curve, setup.grid, n_angles=8)


def test_radii_and_boundary_points_are_chosen(small, small_cap):
    """A pixel apart; and as many points as the highest frequency asks."""
    for setup, share in ((small, 1), (small_cap, 2)):
        step = float(setup.grid.spacing.max()) / share
        assert_allclose(np.diff(setup.radii), step, rtol=1e-12)
        assert setup.data_shape == (*setup.curve.points.shape[:-1], setup.radii.shape[0])
    fine = Setup(ARC, DISK, ImageGrid(41))
    assert small.region.n_boundary < fine.region.n_boundary < DISK.n_boundary
    asked = Setup(ARC, disk(1.0, n_boundary=100), GRID)
    assert asked.region.n_boundary == 100


# ---- other positions, the same programs


def plane_parts(radius, shift, stretch):
    return {
        "curve": circular_arc(radius, 0.0, 24),
        "region": disk(1.0, shift),
        "grid": ImageGrid(9, stretch),
        "radii": stretch * jnp.linspace(0.29, 2.42, 10),
    }


def space_parts(radius, shift, stretch):
    center = shift * jnp.ones(3)
    return {
        "curve": spherical_cap(radius, 1.1, 6, 12, center=center),
        "region": ball(1.0, center=center),
        "grid": VolumeGrid(4, stretch, center),
        "radii": stretch * jnp.linspace(0.4, 2.5, 8),
    }


@pytest.mark.slow
def test_replace_is_a_new_setup(small_cut):
    """Under jit and vmap: the images of setups that are made anew, by one program.

    Derivatives through it: test_solve.py.
    """
    start, setup = np.array([1.3, 0.0, 1.0]), small_cut
    g = np.random.default_rng(0).standard_normal(setup.data_shape)
    traced = []

    @jax.jit
    @jax.vmap
    def images(given):
        traced.append(1)
        return reconstruct(setup.replace(**plane_parts(*given[:3])), g, given[3])

    shift, alphas = np.array([0.01, -0.01, 0.002]), (1e-3, 2e-3)
    found = images(np.c_[np.stack([start, start + shift]), alphas])
    again = Setup(**plane_parts(*map(float, start + shift)), max_frequency=6.0)
    for image, made, alpha in zip(found, (setup, again), alphas, strict=True):
        expected = reconstruct(made, g, alpha)
        assert_allclose(image, expected, atol=1e-11 * abs(expected).max())
    images(np.c_[np.stack([start + 2 * shift, start]), alphas])
    assert len(traced) == 1


def test_replace_is_a_new_setup_in_space():
    """Under jit, and derivatives through it: spherical/test_reconstruction.py."""
    sizes, moved = {"max_frequency": 2.0, "n_directions": 8}, space_parts(1.51, 0.01, 1.002)
    setup, again = Setup(**space_parts(1.5, 0.0, 1.0), **sizes), Setup(**moved, **sizes)
    g = np.random.default_rng(0).standard_normal(setup.data_shape)
    found, expected = (reconstruct(one, g, 1e-3) for one in (setup.replace(**moved), again))
    assert_allclose(found, expected, atol=1e-11 * abs(expected).max())


def test_new_numbers_compile_nothing(small, none_made, programs_of):
    """Without jit around it: setups, plans and solutions for other radii, positions and rules."""
    g = jnp.asarray(np.random.default_rng(1).standard_normal(small.data_shape))

    def work(x):
        curve = circular_arc(1.3 * x, 1.0, 24)
        setup = small.replace(curve=curve, radii=small.radii * x, grid=ImageGrid(9, x))
        reconstruct(setup, g * x, RelativeTikhonov(0.1 * x))
        image = reconstruct(build_plan(setup, NormBound(3 * x)), g)
        operator = forward_operator(setup)
        operator.T(operator(image))

    with none_made():
        assert programs_of(lambda: work(1.0))  # it does count
        assert programs_of(lambda: work(1.001)) == []


# ---- inside jax.jit


def image_like(setup):
    return jnp.asarray(np.random.default_rng(2).standard_normal(setup.grid.shape))


def data_like(setup):
    return jnp.asarray(np.random.default_rng(3).standard_normal(setup.data_shape))


def plan_image(setup, g):
    """By a rule that is traced, too."""
    return reconstruct(build_plan(setup, Tikhonov(1e-3 + 0 * g[0, 0])), g)


def collocation_image(setup, g):
    return reconstruct(build_plan(setup, NormBound(3 + 0 * g[0, 0]), method="collocation"), g)


def deviation(setup, g):
    return pixel_standard_deviation(setup, jnp.abs(g), Tikhonov(1e-3))


ANYWHERE = {
    "forward_operator": (lambda setup, f: forward_operator(setup)(f), image_like),
    "its transpose": (lambda setup, g: forward_operator(setup).T(g), data_like),
    "solve": (lambda setup, g: solve(setup, g, NoiseLevel(0.1)).image, data_like),
}
IN_THE_PLANE = {
    "build_plan": (plan_image, data_like),
    "collocation": (collocation_image, data_like),
    "data_residual": (lambda setup, f: data_residual(setup, 0 * data_like(setup), f), image_like),
    "pixel_standard_deviation": (deviation, data_like),
    "predict_noise": (lambda setup, g: predict_noise(setup, jnp.abs(g[:, 0])), data_like),
    "visibility_map": (
        lambda setup, g: visibility_map(
            setup.curve, setup.grid, n_angles=32, width=0.3 + 0 * g[0, 0]
        ),
        data_like,
    ),
}
PLANS = ("build_plan", "collocation")
CASES = [(name, "small_cut") for name in ANYWHERE | IN_THE_PLANE]
CASES += [(name, "small_cap") for name in ANYWHERE]


def traced(work, *given):
    """As jax.jit traces it; then evaluated by the programs that there are, of which it is made.

    What a whole program costs to compile would be most of the time of all cases.
    """
    program = eqx.filter_make_jaxpr(work)(*given)[0]
    return jaxpr_as_fun(program)(*filter(eqx.is_array, jax.tree.leaves(given)))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "where"), CASES)
def test_every_function_works_inside_jit(request, name, where):
    """With the setup closed over, and passed in: other positions need no numbers of their own.

    But plans of traced positions keep what those of known ones leave out as below rounding.
    """
    setup = request.getfixturevalue(where)
    work, make = (ANYWHERE | IN_THE_PLANE)[name]
    given = make(setup)
    plain = work(setup, given)
    found = [traced(lambda given: work(setup, given), given)]
    if name in PLANS:
        found.append(traced(work, setup, given))
    else:
        shapes = eqx.filter_eval_shape(work, setup, given)
        assert jax.tree.map(jnp.shape, shapes) == jax.tree.map(jnp.shape, plain)
    for parts in found:
        for one, other in zip(parts, jax.tree.leaves(plain), strict=True):
            scale = np.nanmax(np.abs(other), initial=1e-300)
            assert_allclose(one, other, atol=1e-9 * scale, equal_nan=True)


def series_norms(curve):
    setup = Setup(curve, DISK, GRID, max_frequency=4.0, n_directions=8)
    return build_plan(setup, method="series").report.norm


# of a known geometry they work inside jax.jit; of a traced one the size of the answer is unknown
OF_KNOWN_GEOMETRY = {
    "data_radii": (lambda curve: data_radii(curve, DISK, 0.1), ARC),
    "cap_radii": (lambda curve: cap_radii(curve, BALL, 0.1), CAP),
    "visible_disk": (lambda curve: jnp.asarray(visible_disk(curve, n=9)[1]), ARC),
    "series": (series_norms, circular_arc(1.3, 1.3, 24)),
}


@pytest.mark.parametrize("name", OF_KNOWN_GEOMETRY)
def test_known_geometries_stay_known_inside_jit(name):
    work, curve = OF_KNOWN_GEOMETRY[name]
    inside = traced(lambda factor: factor * work(curve), jnp.asarray(2.0))
    assert_allclose(inside[0], 2 * work(curve), rtol=1e-12)
    with pytest.raises(ValueError, match="traced"):
        eqx.filter_make_jaxpr(work)(curve)


# ---- one family of rules


@pytest.mark.parametrize(
    "rule",
    [
        Tikhonov(1e-3),
        RelativeTikhonov(0.05),
        TikhonovNormBound(2.0),
    ],
    ids=lambda rule: type(rule).__name__,
)
def test_a_rule_means_the_same_in_plan_and_solve(small_cut, rule):
    g = data_like(small_cut)
    plan, direct = reconstruct(build_plan(small_cut, rule), g), reconstruct(small_cut, g, rule)
    assert_allclose(plan, direct, atol=1e-8 * abs(direct).max())


def test_a_number_is_tikhonovs(small_cut):
    g = data_like(small_cut)
    found, expected = (reconstruct(small_cut, g, rule) for rule in (1e-3, Tikhonov(1e-3)))
    assert np.array_equal(found, expected)


@pytest.mark.parametrize(
    ("rule", "smooth"),
    [
        (NormBound(2.0), r"TikhonovNormBound\(K\)"),
        (FixedRank(8.0), r"Tikhonov\(alpha\)"),
        (SingularValueCutoff(0.1), r"Tikhonov\(alpha\)"),
        (RelativeCutoff(0.1), r"RelativeTikhonov\(kappa\)"),
    ],
)
@pytest.mark.parametrize("where", ["small", "small_cap"])
def test_truncations_are_for_plans(request, where, rule, smooth):
    setup = request.getfixturevalue(where)
    for verb in (solve, reconstruct):
        with pytest.raises(ValueError, match=rf"{type(rule).__name__} keeps or drops.*{smooth}"):
            verb(setup, data_like(setup), rule)


def test_rules_that_are_refused_elsewhere(small, small_cap):
    with pytest.raises(ValueError, match=r"NoiseLevel looks at the data.*use solve\(setup, g"):
        build_plan(small, NoiseLevel(0.1))
    with pytest.raises(ValueError, match="not available in space"):
        reconstruct(small_cap, data_like(small_cap), TikhonovNormBound(2.0))
    with pytest.raises(ValueError, match="the setup is in space"):
        build_plan(small_cap)


def test_data_of_a_phantom_have_the_setups_shape(small, small_cap):
    assert data_of(BELL, small).shape == small.data_shape == (24, 9)
    assert small_cap.data_shape[:2] == (6, 12) == small_cap.detectors_shape
