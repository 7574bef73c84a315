"""From coarse to fine: the levels, and that a fit which stops is at its end."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxtat
from jaxtat import ImageGrid, VolumeGrid, model_based
from jaxtat.fitting import Ridge, SecondOrderVariation, TotalVariation
from jaxtat.fitting.ladder import between_nodes, ladder, weight_on
from jaxtat.records import circular_integrals_to_pressure, condition_record


def test_each_level_covers_the_same_square_with_half_the_nodes():
    levels = ladder(ImageGrid((433, 300), (2.0, 1.4), (0.3, 0.1)))
    assert [level.shape for level in levels] == [(55, 38), (109, 75), (217, 150), (433, 300)]
    for level in levels:
        assert_allclose(level.half_width, [2.0, 1.4])
        assert_allclose(level.center, [0.3, 0.1])
    assert [level.shape for level in ladder(VolumeGrid(32))] == [(32, 32, 32)]


@pytest.mark.parametrize("grid", [ImageGrid((9, 12)), VolumeGrid((5, 6, 7))])
def test_planes_are_kept_between_nodes(grid):
    slope = np.arange(1.0, grid.dimension + 1)
    fine = type(grid)(tuple(2 * n for n in grid.shape))
    found = between_nodes(jnp.asarray(grid.points @ slope)[None], fine.shape)
    assert_allclose(found[0], fine.points @ slope, atol=1e-12)


@pytest.mark.parametrize(
    ("penalty", "of_points"),
    [
        (TotalVariation(), lambda x: x[..., 0]),
        (SecondOrderVariation(), lambda x: x[..., 0] ** 2),
        (Ridge(), lambda x: x[..., 0] + 1),
    ],
    ids=["tv", "second order", "ridge"],
)
def test_a_penalty_costs_as_much_on_all_levels(penalty, of_points):
    def cost(grid, weight):
        image = jnp.asarray(of_points(grid.points))[None]
        if isinstance(penalty, Ridge):
            return weight * jnp.sum(image**2) / 2
        return weight * penalty.value(image, 1e-9)

    fine, coarse = ImageGrid(257), ImageGrid(129)
    weight = weight_on(coarse.shape, fine.shape, penalty, jnp.asarray(0.3))
    assert_allclose(cost(coarse, weight), cost(fine, 0.3), rtol=0.03)


def in_the_plane():
    arc = jaxtat.circular_arc(1.3, 1.0, 16, element_width=0.1)
    bell = jaxtat.phantoms.Bells([[0.1, 0.2]], [0.7])
    setup = jaxtat.Setup(arc, jaxtat.disk(1.0), ImageGrid(49), max_frequency=20.0)
    return setup, bell.image, ImageGrid(25)


def off_circles():
    ellipse = jaxtat.detector_curve(
        np.stack([1.5 * np.cos(np.arange(24) / 4), 1.3 * np.sin(np.arange(24) / 4)], axis=-1)
    )
    bell = jaxtat.phantoms.Bells([[0.1, 0.2]], [0.7])
    return jaxtat.Setup(ellipse, jaxtat.disk(0.9), ImageGrid(49)), bell.image, ImageGrid(25)


def in_space():
    cap = jaxtat.spherical.spherical_cap(1.5, 1.0, 5, 8)
    bell = jaxtat.spherical.Bells([[0.1, 0.0, 0.2]], [0.8])
    setup = jaxtat.Setup(cap, jaxtat.spherical.ball(1.0), VolumeGrid(33), max_frequency=9.0)
    return setup, bell.volume, VolumeGrid(17)


def at_points_in_space():
    setup, volume, grid = in_space()
    points = jaxtat.geometry.caps.DetectorPoints(np.asarray(setup.curve.points).reshape(-1, 3))
    setup = jaxtat.Setup(points, setup.region, setup.grid, setup.radii, max_frequency=9.0)
    return setup, volume, grid


@pytest.mark.parametrize("make", [in_the_plane, off_circles, in_space, at_points_in_space])
def test_coarser_operators_give_the_same_integrals(make):
    """Of a bell that both grids hold; and theirs are those of a setup of that grid."""
    setup, image, grid = make()
    fine = jaxtat.forward_operator(setup)
    coarse = jaxtat.forward_operator(setup, grid=grid)
    wanted = fine.mv(image(setup.grid))
    found = coarse.mv(image(grid))
    assert coarse.report.n_frequencies < 0.55 * fine.report.n_frequencies
    assert_allclose(found, wanted, atol=3e-3 * float(abs(wanted).max()))
    random = np.random.default_rng(0)
    f, g = random.standard_normal(grid.shape), random.standard_normal(setup.data_shape)
    assert_allclose(np.vdot(coarse.mv(f), g), np.vdot(f, coarse.T.mv(g)), rtol=1e-6)


@pytest.fixture(scope="module")
def arc():
    """Few detectors, and a grid of three levels."""
    curve = jaxtat.circular_arc(1.3, 1.0, 40)
    return jaxtat.Setup(curve, jaxtat.disk(1.0), ImageGrid(65))


DISKS = jaxtat.phantoms.Disks([[0.3, 0.2], [-0.3, -0.1]], [0.3, 0.4], [1.0, 0.6])


def integrals(setup):
    g = DISKS.circular_integrals(setup.curve, setup.radii)
    noise = jaxtat.phantoms.noise_like(jax.random.key(0), g, 0.05)
    return g + noise, {"noise": float(noise.std())}


def band_passed(setup):
    """Of pressure without the low frequencies, which f >= 0 brings back last."""
    times = jnp.linspace(0.0, 3.0, 300)
    g = DISKS.circular_integrals(setup.curve, setup.radii)
    passed = functools.partial(condition_record, times=times, band=(0.5, 25.0), baseline=False)
    record = passed(circular_integrals_to_pressure(g, setup.radii, times))
    noise = jaxtat.phantoms.noise_like(jax.random.key(1), record, 0.05)
    return record + noise, {"times": times, "conditioning": passed}


@pytest.mark.parametrize("make", [integrals, band_passed])
def test_where_it_stops_the_image_is_that_of_ten_times_as_many_steps(arc, make):
    data, known = make(arc)
    stopped = model_based(arc, data, nonnegative=True, **known)
    assert stopped.converged and float(stopped.gap) <= 2e-4
    much = model_based(
        arc, data, nonnegative=True, **known, initial=stopped.image, tolerance=1e-12,
        max_steps=10 * int(stopped.steps),
    )  # fmt: skip
    assert not much.converged and int(much.steps) >= 10 * int(stopped.steps)
    off = jnp.linalg.norm(stopped.image - much.image) / jnp.linalg.norm(much.image)
    assert float(off) < 0.02


def test_the_gap_bounds_what_is_above_the_minimum(arc):
    """By a fit to the end; both at the same weight."""
    from jaxtat.fitting.arguments import checked_data, data_fits
    from jaxtat.fitting.fista import scale_of
    from jaxtat.fitting.implicit import Problem, objective

    data, _ = integrals(arc)
    (fit,) = data_fits(arc, None, True, None, None, False, None, [arc.grid])
    whitened, _ = checked_data(data, fit)
    options = {"weight": 0.02, "nonnegative": True, "initial": jnp.zeros(arc.grid.shape)}
    scale = jax.jit(scale_of)(fit, whitened)

    @jax.jit
    def value(image):
        problem = Problem(fit, whitened, TotalVariation(), jnp.asarray(0.02), scale)
        return objective(problem, image[None]) * scale.square

    best = value(model_based(arc, data, tolerance=1e-9, max_steps=4000, **options).image)
    size = jnp.sum(whitened**2) / 2
    gaps = []
    for steps in (5, 20, 80):
        found = model_based(arc, data, tolerance=1e-15, max_steps=steps, **options)
        assert float((value(found.image) - best) / size) <= float(found.gap) * (1 + 1e-6)
        gaps.append(float(found.gap))
    assert gaps[-1] < 0.1 * gaps[0]


@pytest.mark.parametrize("factor", [2.0**600, 2.0**-600, 1e200, 1e-200])
@pytest.mark.parametrize("known", [False, True])
def test_images_are_in_proportion_to_their_data(arc, factor, known):
    """To the last bit for a power of two; else rounding differs from the first step on."""
    data, noise = integrals(arc)
    size = noise["noise"]
    options = {"nonnegative": True, "max_steps": 30}
    one = model_based(arc, data, noise=size if known else None, **options)
    many = model_based(arc, factor * data, noise=factor * size if known else None, **options)
    exact = np.log2(factor) % 1 == 0
    assert_allclose(many.image / factor, one.image, rtol=0, atol=0 if exact else 1e-9)
    assert_allclose(many.residual, one.residual, rtol=1e-9)
    assert int(many.steps) == int(one.steps)


def test_data_that_single_precision_cannot_hold_are_refused(arc):
    data, _ = integrals(arc)
    with pytest.raises(ValueError, match=r"data are as large as .*e\+200, which float32 cannot"):
        model_based(arc, 1e200 * data, dtype=jnp.float32)


def test_progress_shows_level_step_gap_and_time(arc, capsys):
    data, known = integrals(arc)
    model_based(arc, data, nonnegative=True, progress=True, **known)
    said = capsys.readouterr().err
    for part in ("17 x 17", "33 x 33", "65 x 65", "step=", "gap=", "left", "100%"):
        assert part in said
