"""Truncation, Tikhonov and jaxopt at one frequency: against plans, and each other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxtat import (
    ImageGrid,
    NormBound,
    Setup,
    Tikhonov,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    phantoms,
)
from jaxtat.studies import compare_regularizations

BELL = phantoms.Bells([[-0.45, 0.1], [-0.5, -0.2]], [0.4, 0.4], [1.0, 0.5])
K, ALPHA = [2.0, 5.0], [1e-2, 1e-4]


def setup_of(right, shift):
    center = np.array(shift)
    curve = circular_arc(1.3, right, 70, center=center)
    region, grid = disk(1.0, right, center=center), ImageGrid(25, 1.0, center)
    radii = data_radii(curve, region, grid.spacing[0] / 4)
    return Setup(curve, region, grid, radii, n_directions=64)


@pytest.fixture(scope="module")
def compared():
    right, shift = 0.0, (0.1, -0.2)
    setup = setup_of(right, shift)
    moved = phantoms.Bells(BELL.centers + jnp.array(shift), BELL.radii, BELL.amplitudes)
    frequency = setup.frequencies[9]
    options = {"K": K, "alpha": ALPHA, "noise": 0.1, "n_directions": 64, "max_steps": 3000}
    return setup, moved, compare_regularizations(setup, moved, frequency, **options)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["truncation", "tikhonov"])
def test_residuals_and_norms_are_those_of_plans(compared, name):
    setup, _, comparison = compared
    found = getattr(comparison, name)
    for i in (0, 1):
        rule = NormBound(K[i]) if name == "truncation" else Tikhonov(ALPHA[i])
        report = build_plan(setup, rule).report
        residual = np.sqrt(np.mean(report.residual[9] ** 2))
        norm = np.sqrt(np.mean(report.norm[9] ** 2)) / report.unit_norm[9]
        assert_allclose((found.residual[i], found.norm[i]), (residual, norm), rtol=1e-5)


def test_iterations_reach_tikhonovs_minimum(compared):
    """As far as they have converged: the error of the solution exceeds that of the gradient."""
    _, _, comparison = compared
    direct, iterative = comparison.tikhonov, comparison.iterative
    assert iterative.converged.all()
    assert (iterative.iterations > 10).all() and not direct.iterations.any()
    assert_allclose(iterative.residual, direct.residual, rtol=1e-2)
    assert_allclose(iterative.norm, direct.norm, rtol=1e-3)
    assert_allclose(iterative.noisy, direct.noisy, rtol=1e-2)


def test_less_regularisation_is_more_exact_and_noisier(compared):
    _, _, comparison = compared
    for curve in (comparison.truncation, comparison.tikhonov, comparison.iterative):
        assert curve.residual[1] < curve.residual[0]
        assert curve.norm[1] > curve.norm[0]
        assert (curve.noisy > curve.clean).all()
        assert (curve.seconds > 0).all()
    for curve in (comparison.tikhonov, comparison.iterative):
        assert curve.clean[1] < curve.clean[0]


def test_the_part_of_the_image_is_that_of_its_fourier_transform(compared):
    """The exact part comes from the phantom's own transform, the other from data and densities."""
    _, _, comparison = compared
    assert comparison.truncation.clean[1] < 1e-4
    assert comparison.tikhonov.clean[1] < 1e-2


def test_what_cannot_be_compared_is_refused():
    setup = setup_of(1.0, (0.0, 0.0))
    for change, message in (
        ({"K": [0.0]}, "K is"),
        ({"alpha": [[1.0]]}, "alpha has shape"),
        ({"frequency": -1.0}, "frequency is"),
    ):
        with pytest.raises(ValueError, match=message):
            compare_regularizations(setup, BELL, **({"frequency": 10.0} | change))
    with pytest.raises(ValueError, match="nothing of it can be traced"):
        jax.jit(lambda f: compare_regularizations(setup, BELL, f))(10.0)
