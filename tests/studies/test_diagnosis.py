"""A diagnosis against what it is made of: images, densities and standard deviations."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import j0, j1, y0, y1

from jaxtat import (
    FixedRank,
    ImageGrid,
    Reconstruction,
    RelativeTikhonov,
    Setup,
    Tikhonov,
    build_plan,
    circular_arc,
    cosine_filter,
    disk,
    phantoms,
    reconstruct,
)
from jaxtat.regularization import SolveReport
from jaxtat.studies import (
    NoiseSource,
    affordable_pixels,
    diagnose,
    pixel_standard_deviation,
    plan_of,
    wave_accuracy,
)
from jaxtat.studies.diagnosis import _affordable

CURVE, REGION, GRID = circular_arc(1.3, 1.0, 24), disk(0.8, n_boundary=48), ImageGrid(11, 0.8)
SETUP = Setup(CURVE, REGION, GRID, max_frequency=2 * np.pi / 0.8)
DATA = np.asarray(phantoms.Bells([[0.1, -0.15]], [0.6]).circular_integrals(CURVE, SETUP.radii))


@pytest.fixture(scope="module")
def plan():
    """By collocation, which compiles fastest."""
    return build_plan(SETUP, FixedRank(20.5), method="collocation")


@pytest.fixture(scope="module")
def image(plan):
    return reconstruct(plan, DATA)


@pytest.fixture(scope="module")
def diagnosis(image, plan):
    return diagnose(SETUP, DATA, image, plan=plan, uncertainty_pixels=5)


def test_standard_deviations_of_large_plans_are_fewer(plan):
    """No more than those of which work and number are bounded; a block at least."""

    assert affordable_pixels(plan) == 24
    found = [
        _affordable(plan.curve.n_detectors, size, size, size) for size in (100, 300, 450, 700, 5000)
    ]
    assert found == sorted(found, reverse=True)
    assert set(found) == {24, 16, 8}


@pytest.mark.parametrize(
    ("basis", "kind", "method"),
    [("cylindrical", Tikhonov, "cylindrical"), ("boundary", RelativeTikhonov, "collocation")],
)
def test_the_plan_of_a_reconstruction_has_its_alphas(plan, monkeypatch, basis, kind, method):
    """That such plans make the same images is tested in test_setup and test_boundary."""
    asked = {}

    def build(*arguments, **options):
        asked.update(arguments=arguments, options=options)
        return plan

    monkeypatch.setattr("jaxtat.studies.diagnosis.build_plan", build)
    alphas = jnp.array([1e-3, 2e-3, 4e-3, 8e-3])
    solved = SolveReport(2 * alphas, alphas, 0 * alphas, jnp.ones(4, bool))
    assert plan_of(SETUP, Reconstruction(jnp.zeros(GRID.shape), solved, basis)) is plan
    setup, rule = asked["arguments"]
    assert setup is SETUP and isinstance(rule, kind) and asked["options"]["method"] == method
    assert_allclose(rule.alpha if basis == "cylindrical" else rule.kappa**2, alphas)


def test_error_and_gain_are_those_of_the_densities(plan):
    """Potentials of the densities on the boundary, by Bessel functions of another library."""
    waves = wave_accuracy(plan, cosine_filter)
    number, direction = 2, 5
    frequency, theta = float(plan.frequencies[number]), float(plan.angles[direction])
    xi = frequency * np.array([np.cos(theta), np.sin(theta)])
    rho = np.asarray(plan.densities.of_frequency(number, CURVE.weights))[direction]
    x, n, z = (np.asarray(a) for a in (REGION.points, REGION.normals, CURVE.points))
    offset = x[:, None] - z
    distance = np.linalg.norm(offset, axis=-1)
    cosine = np.sum(offset * n[:, None], axis=-1) / distance
    t, weighted = frequency * distance, rho * np.asarray(CURVE.weights)
    value = j0(t) @ weighted[0] + y0(t) @ weighted[1]
    slope = -(j1(t) * cosine) @ weighted[0] - (y1(t) * cosine) @ weighted[1]
    wave = np.exp(-1j * x @ xi)
    misfit = np.stack([value - wave, slope + 1j * (n @ xi) / frequency * wave])
    error = np.linalg.norm(misfit) / np.linalg.norm(np.stack([wave, (n @ xi) / frequency * wave]))
    assert 1e-4 < error < 0.9
    assert_allclose(waves.residual[number, direction], error, rtol=1e-6)
    norm = np.sqrt(np.sum(np.asarray(CURVE.weights) * np.abs(rho) ** 2))
    gain = norm / (frequency * np.sqrt(2 * 0.8) / 2)  # of a disk, sampled at 48 points
    assert_allclose(waves.noise_gain[number, direction], gain, rtol=3e-3)
    assert_allclose(waves.low_pass, np.cos(np.pi / 2 * np.arange(1, 5) / 4))


def test_standard_deviations_are_for_the_noise_that_is_given_or_what_is_left(diagnosis, plan):
    coarse = diagnosis.uncertainty.grid
    unit = pixel_standard_deviation(plan, 1.0, grid=coarse)
    left = float(diagnosis.noise.sigma)
    assert left > 0
    assert_allclose(diagnosis.uncertainty.deviation, left * unit, rtol=1e-12)
    assert diagnosis.noise.source is not NoiseSource.GIVEN
    assert_allclose(coarse.points[[0, -1], [0, -1]], GRID.points[[0, -1], [0, -1]], atol=1e-15)
    image = np.zeros(GRID.shape)
    options = {"plan": plan, "uncertainty_pixels": 5}
    given = diagnose(SETUP, DATA, image, sigma=0.3, **options)
    assert_allclose(given.uncertainty.deviation, 0.3 * unit, rtol=1e-12)
    assert given.noise.source is NoiseSource.GIVEN
    assert_allclose(given.residual.relative, 1, rtol=1e-12)


def test_a_sample_of_the_noise_stands_for_white_noise_that_does_as_much_to_the_image(plan):
    """Judged by its image, at the pixels whose deviations are asked for."""
    draws = 0.2 * np.random.default_rng(5).standard_normal((200, *DATA.shape))
    options = {"plan": plan, "uncertainty_pixels": 5}
    found = diagnose(SETUP, DATA, np.zeros(GRID.shape), noise=draws[0], **options)
    assert found.noise.source is NoiseSource.RECORD
    assert_allclose(found.noise.sigma, 0.2, rtol=0.1)
    unit = np.asarray(found.uncertainty.deviation / found.uncertainty.sigma)
    here = eqx.tree_at(lambda tree: tree.setup.grid, plan, found.uncertainty.grid)
    made = np.asarray(reconstruct(here, draws))
    sizes = np.sqrt(np.sum(made**2, axis=(1, 2), where=np.isfinite(unit)) / np.nansum(unit**2))
    assert_allclose(found.uncertainty.sigma, sizes[0], rtol=1e-9)
    # this image has few degrees of freedom, so that single samples scatter: their mean square
    assert_allclose(np.sqrt(np.mean(sizes**2)), 0.2, rtol=0.1)
    with pytest.raises(ValueError, match="sigma and noise are both given"):
        diagnose(SETUP, DATA, np.zeros(GRID.shape), sigma=0.1, noise=draws[0])


def test_outside_the_region_there_is_nothing(diagnosis):
    inside = np.asarray(REGION.contains(GRID.points))
    for field in (diagnosis.image, diagnosis.visible):
        assert (np.isfinite(field) == inside).all()


def test_without_a_plan_the_rest_is_there(diagnosis, image):
    bare = diagnose(SETUP, DATA, image)
    assert bare.waves is None
    assert bare.uncertainty is None
    assert_allclose(bare.residual.values, diagnosis.residual.values)


def test_a_noise_that_is_none_is_refused(image):
    with pytest.raises(ValueError, match=r"sigma is 0\.0, expected a value above zero"):
        diagnose(SETUP, DATA, image, sigma=0.0)
