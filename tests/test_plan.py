"""Plans and the whole pipeline: accuracy, invariances, batches, derivatives and refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxtat
from jaxtat import (
    AccuracyWarning,
    FixedRank,
    ImageGrid,
    NormBound,
    VisibilityWarning,
    build_plan,
    circular_arc,
    circular_integrals,
    cosine_filter,
    data_radii,
    phantoms,
    reconstruct,
    truncated_disk,
)
from jaxtat.reconstruction import pipeline

BELL = phantoms.Bells([[0.2, 0.1], [-0.3, -0.2]], [0.6, 0.5], [1.0, 0.7])


def largest_error(plan, image, phantom):
    inside = plan.region.contains(plan.grid.points)
    return float(jnp.abs(image - phantom.image(plan.grid))[inside].max())


def test_a_smooth_phantom_comes_back(small_plan):
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    assert largest_error(small_plan, reconstruct(small_plan, g), BELL) < 1e-3


def test_half_circle_and_half_disk():
    grid = ImageGrid(33)
    curve, region = circular_arc(1.3, 0.0, 130), truncated_disk(1.0, 0.0, 260)
    radii = data_radii(curve, region, grid.spacing[0])
    plan = build_plan(curve, region, grid, radii, progress=False)
    bell = phantoms.Bells([[-0.45, 0.1]], [0.4])
    image = reconstruct(plan, bell.circular_integrals(curve, radii))
    assert largest_error(plan, image, bell) < 1e-2


def turned(points, angle, shift):
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]]) + shift


def test_turning_and_moving_everything_changes_nothing(small, small_plan):
    angle, shift = 2.0, np.array([5.0, -3.0])
    place = {"center": shift, "angle": angle}
    curve = circular_arc(1.3, 1.0, 130, **place)
    region = truncated_disk(1.0, 1.0, 260, **place)
    grid, radii = ImageGrid(33, 1.0, shift), small[3]
    plan = build_plan(curve, region, grid, radii, progress=False)
    moved = phantoms.Bells(turned(BELL.centers, angle, shift), BELL.radii, BELL.amplitudes)
    image = reconstruct(plan, moved.circular_integrals(curve, radii))
    assert largest_error(plan, image, moved) < 1e-3
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    assert np.allclose(g, moved.circular_integrals(curve, radii), atol=1e-13)


def test_the_unit_of_length_does_not_matter(small, small_plan):
    mm = 1e-3
    curve = circular_arc(1.3 * mm, 1.0 * mm, 130)
    region = truncated_disk(mm, mm, 260)
    plan = build_plan(curve, region, ImageGrid(33, mm), small[3] * mm, progress=False)
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    assert np.allclose(
        reconstruct(plan, g * mm), reconstruct(small_plan, g), atol=1e-6
    )  # rounding, amplified by the smallest singular values kept


def test_radii_must_reach_sources_outside_the_region_too():
    """Circles that miss the region still carry what lies outside it; cutting them is an error."""
    grid = ImageGrid(33, 0.6)
    curve, region = circular_arc(1.3, 1.0, 200), truncated_disk(0.6, 0.6, 400)
    outside = phantoms.Bells([[0.5, 0.3], [-0.6, -0.3]], [0.4, 0.35])

    def error(radii):
        plan = build_plan(curve, region, grid, radii, max_frequency=100.0, progress=False)
        image = reconstruct(plan, outside.circular_integrals(curve, radii))
        return largest_error(plan, image, outside)

    whole = data_radii(curve, region, 1 / 40, sources=truncated_disk(1.0, 1.0, 200))
    assert error(whole) < 1e-4
    assert error(data_radii(curve, region, 1 / 40)) > 0.1


def test_the_plan_keeps_the_rule_that_was_used(small, small_plan):
    assert isinstance(small_plan.regularization, NormBound)
    assert float(small_plan.regularization.K) == jaxtat.PAPER_K
    with pytest.raises(ValueError, match="closed form"):
        build_plan(*small, FixedRank(3), method="series")


def test_plans_can_be_built_under_jit_for_a_traced_K(small):
    curve, region, grid, radii = small
    g = BELL.circular_integrals(curve, radii)

    def image(K):
        plan = build_plan(
            curve, region, grid, radii, NormBound(K), max_frequency=15.0, progress=False
        )
        return reconstruct(plan, g)

    assert np.allclose(jax.jit(image)(3.0), image(3.0), atol=1e-10)


def test_traced_geometry_is_refused_in_one_line(small):
    curve, region, grid, radii = small
    with pytest.raises(ValueError, match="traced geometry"):
        jax.grad(lambda r: build_plan(curve, region, grid, r, progress=False).densities.real.sum())(
            radii
        )


def test_too_few_detectors_are_reported():
    grid = ImageGrid(33)
    curve, region = circular_arc(1.3, 1.0, 20), truncated_disk(1.0, 1.0, 260)
    radii = data_radii(curve, region, grid.spacing[0])
    with pytest.warns(AccuracyWarning, match="of the plane waves are off"):
        build_plan(curve, region, grid, radii, progress=False)


def test_batches_are_reconstructed_alike(small_plan):
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    batch = jnp.stack([g, 2 * g, -g, 0 * g]).reshape(2, 2, *g.shape)
    images = reconstruct(small_plan, batch)
    one = reconstruct(small_plan, g)
    assert images.shape == (2, 2, 33, 33)
    assert np.allclose(images[0, 1], 2 * one, atol=1e-12)
    assert np.allclose(images[1, 1], 0)
    assert np.allclose(reconstruct(small_plan, g[None])[0], one, atol=1e-13)


def test_single_precision_densities_cost_little(small, small_plan):
    plan = build_plan(*small, precision="single", progress=False)
    assert plan.densities.dtype == jnp.complex64
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    image = reconstruct(plan, g)
    assert image.dtype == jnp.float64
    assert np.allclose(image, reconstruct(small_plan, g), atol=1e-5)


def test_float32_data_are_accepted(small_plan):
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    assert np.allclose(
        reconstruct(small_plan, g.astype(jnp.float32)), reconstruct(small_plan, g), atol=1e-5
    )


def test_low_pass_smooths(small_plan):
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    noise = phantoms.noise_like(jax.random.key(0), g, 0.15)
    inside = small_plan.region.contains(small_plan.grid.points)
    rough = reconstruct(small_plan, noise)[inside].std()
    assert reconstruct(small_plan, noise, low_pass=cosine_filter)[inside].std() < 0.6 * rough


def test_gradient_with_respect_to_the_data_is_the_adjoint(small_plan):
    rng = np.random.default_rng(0)
    shape = (small_plan.curve.n_detectors, small_plan.radii.shape[0])
    g = jnp.asarray(rng.standard_normal(shape))
    image = jnp.asarray(rng.standard_normal(small_plan.grid.shape))
    forward, back = jax.vjp(lambda g: reconstruct(small_plan, g), g)
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
def test_derivatives_of_the_image_in_K_and_j_max():
    grid = ImageGrid(9)
    curve, region = circular_arc(1.3, 0.6, 24), truncated_disk(1.0, 0.6, 48)
    radii = data_radii(curve, region, grid.spacing[0])
    g = BELL.circular_integrals(curve, radii)

    def total(rule):
        plan = build_plan(curve, region, grid, radii, rule, n_directions=8, progress=False)
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


def test_the_bar_shows_progress(small, capsys):
    curve, region, grid, radii = small
    build_plan(curve, region, grid, radii, max_frequency=20.0, n_directions=8)
    assert "densities: 100%" in capsys.readouterr().err


def test_a_poking_region_is_reported_not_refused():
    grid = ImageGrid(9)
    curve, region = circular_arc(1.3, 0.0, 30), truncated_disk(1.0, 1.0, 60)
    radii = data_radii(curve, region, grid.spacing[0])
    with pytest.warns(VisibilityWarning, match="of the lines through the region miss the curve"):
        build_plan(curve, region, grid, radii, n_directions=8, progress=False)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"curve": circular_arc(1.0, 1.0, 60)}, "detectors lie inside or on the region"),
        ({"curve": circular_arc(1300.0, 1000.0, 60)}, "same unit of length"),
        ({"region": truncated_disk(1.0, 1.0, 12)}, "use n_collocation >= "),
        ({"radii": np.linspace(0.6, 1.5, 20)}, "meet the region of interest for radii"),
        ({"radii": np.linspace(0.3, np.nan, 20)}, "NaN"),
        ({"radii": np.linspace(0.3, 2.3, 20)[:, None]}, "radii has shape"),
        ({"grid": ImageGrid(9, 0.1, (5.0, 5.0))}, "no node of the image grid"),
        ({"max_frequency": -1.0}, "max_frequency is -1"),
        ({"n_directions": 0}, "n_directions is 0"),
        ({"method": "magic"}, "expected 'collocation' or 'series'"),
        ({"precision": "half"}, "expected 'double' or 'single'"),
    ],
)
def test_bad_geometries_are_refused(change, message):
    grid = ImageGrid(9)
    curve, region = circular_arc(1.3, 1.0, 60), truncated_disk(1.0, 1.0, 120)
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


def test_32_bits_are_refused_with_the_remedy(small_plan):
    with jax.enable_x64(False):
        with pytest.raises(ValueError, match="jax_enable_x64"):
            circular_arc(1.3, 1.0, 10)
        with pytest.raises(ValueError, match="jax_enable_x64"):
            reconstruct(small_plan, np.zeros((130, 33), np.float32))


def test_public_names_are_what_the_package_says():
    for name in jaxtat.__all__:
        assert getattr(jaxtat, name).__doc__, name
