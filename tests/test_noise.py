"""The choice of K(lambda) and alpha(lambda): closed forms, brute force, and better images."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from numpy.testing import assert_allclose

from jaxtat import (
    PAPER_K,
    FixedRank,
    ImageGrid,
    NormBound,
    Setup,
    SingularValueCutoff,
    Tikhonov,
    build_plan,
    circular_arc,
    disk,
    phantoms,
    reconstruct,
)
from jaxtat.densities.harmonic import harmonic_orders, polar_geometry, wave_system, wave_table
from jaxtat.steps.radial_transform import noise_power, radial_transform
from jaxtat.studies import choose_regularization, image_power

BELL = phantoms.Bells([[0.2, 0.1], [-0.3, -0.2]], [0.6, 0.5], [1.0, 0.7])
POWER = 1e-3 * np.arange(1.0, 33.0) ** -3


@pytest.fixture(scope="module")
def choices(small):
    """K and alpha for noise that drowns the high frequencies."""
    return {
        kind: choose_regularization(Setup(*small), 0.02, POWER, kind=kind)
        for kind in (NormBound, Tikhonov)
    }


def test_alpha_is_noise_over_signal(small, choices):
    """Minimum of P ||A q - u||² / ||u||² + sigma² p ||q||² / 4π² over all q: the Wiener filter."""
    curve, region, _, radii = small
    choice, geometry = choices[Tikhonov], polar_geometry(curve, region)
    assert choice.converged
    gain = 0.02**2 * noise_power(radii, choice.frequencies, curve.weights) / (4 * jnp.pi**2)
    for i in (3, 17, 31):
        one = choice.frequencies[i : i + 1]
        n_max = int(harmonic_orders(geometry, np.asarray(one)).max())
        wave = jax.tree.map(lambda leaf: leaf[0], wave_table(geometry, one, n_max))
        angles = jnp.arange(32) * jnp.pi / 32 - geometry.axis
        _, rhs, _, unit = wave_system(geometry, wave, angles)
        size = jnp.mean(jnp.sum(jnp.abs(rhs) ** 2, axis=(0, 1)))  # alike for all on a disk
        alpha = gain[i] * size / POWER[i] / unit
        assert_allclose(choice.regularization.alpha[i], alpha, rtol=1e-2)


def test_derivatives_of_the_choice():
    """Implicit ones of the descent's end: alpha goes with sigma²/P(lambda), and nothing else."""
    curve, region, grid = circular_arc(1.3, 1.0, 30), disk(1.0, n_boundary=60), ImageGrid(9)
    radii = jnp.linspace(0.3, 2.3, 21)
    power = 1e-3 * jnp.arange(1.0, 5.0) ** -3

    def alpha(sigma, power):
        found = choose_regularization(
            Setup(curve, region, grid, radii, max_frequency=6.0), sigma, power, kind=Tikhonov
        )
        return found.regularization.alpha

    value, slope = jax.jvp(lambda s: alpha(s, power), (jnp.array(0.02),), (jnp.array(1.0),))
    assert_allclose(slope, 2 * value / 0.02, rtol=1e-3)
    _, back = jax.vjp(lambda p: alpha(0.02, p), power)
    assert_allclose(back(jnp.ones(4))[0], -value / power, rtol=1e-3)


def test_no_other_K_is_better(small, choices):
    """At each frequency, among many: from the reports of plans, by the definition of the error."""
    curve, _, _, radii = small
    choice = choices[NormBound]
    gain = 0.02**2 * noise_power(radii, choice.frequencies, curve.weights) / (4 * jnp.pi**2)
    least = np.full(32, np.inf)
    for K in (0.1, 0.3, 1.0, 1.2, 1.4, 1.6, 2.0, 3.0, PAPER_K, 8.0):
        report = build_plan(Setup(*small, n_directions=32), NormBound(np.full(32, K))).report
        left = POWER * np.mean(report.residual**2, axis=1)
        least = np.minimum(least, left + np.asarray(gain) * np.mean(report.norm**2, axis=1))
    found = np.asarray(choice.left + choice.noise)
    assert np.max(found / least) < 1.03  # at the bottom of a valley, one of several
    assert found.sum() < least.sum()


def test_tikhonov_has_less_error_than_truncation(choices):
    assert choices[Tikhonov].image_error < choices[NormBound].image_error
    assert 0 < choices[Tikhonov].relative_error < 1


def test_expected_errors_are_those_of_images(small, choices):
    """Of noise alone, in 40 draws, at the frequencies that let most of it through."""
    curve, _, _, radii = small
    choice = choices[NormBound]
    plan = build_plan(Setup(*small), choice.regularization)
    noise = 0.02 * jax.random.normal(jax.random.key(0), (40, curve.n_detectors, radii.shape[0]))
    transformed = radial_transform(noise, radii, plan.frequencies)
    fhat = plan.densities.polar_fourier(transformed, curve.weights)
    found = jnp.mean(jnp.abs(fhat) ** 2, axis=(0, 2))
    # J_0 and Y_0 have the same power where lambda r is large
    most = (plan.frequencies > 10) & (choice.noise > 0.3 * choice.noise.max())
    assert most.sum() > 5
    assert_allclose(found[most], choice.noise[most], rtol=0.1)


def test_power_of_the_data_is_that_of_the_phantom(small, small_plan):
    curve, _, _, radii = small
    g = BELL.circular_integrals(curve, radii)
    exact = jnp.mean(jnp.abs(BELL.fourier(small_plan.frequencies, small_plan.angles)) ** 2, axis=1)
    noisy = g + 0.02 * jax.random.normal(jax.random.key(1), g.shape)
    found = image_power(small_plan, noisy, 0.02)
    assert_allclose(found[1:5], exact[1:5], rtol=0.3)
    assert np.all(found > 0)
    # beyond the bells' spectrum there is nothing but noise, most of which is subtracted
    raw = image_power(small_plan, noisy, 1e-9)
    assert np.sum(found[16:]) < 0.3 * np.sum(raw[16:])


def test_derivatives_of_the_power(small, small_plan):
    curve, _, _, radii = small
    g = BELL.circular_integrals(curve, radii)

    def power(scale, sigma):  # of the data and of their noise
        return image_power(small_plan, jnp.asarray(scale) * g, jnp.asarray(sigma))[:8]

    check_grads(power, (1.0, 0.01), 1, ["fwd", "rev"], rtol=1e-5)


@pytest.mark.parametrize("kind", [NormBound, Tikhonov])
def test_images_of_noisy_data_are_better_than_with_the_papers_K(small, small_plan, choices, kind):
    """Of a phantom whose power was taken from its own noisy data."""
    curve, region, grid, radii = small
    inside, truth = region.contains(grid.points), BELL.image(grid)
    exact = BELL.circular_integrals(curve, radii)
    g = exact + 0.1 * jax.random.normal(jax.random.key(2), (20, *exact.shape))
    power = image_power(small_plan, g[0], 0.1)
    rule = choose_regularization(Setup(*small), 0.1, power, kind=kind).regularization
    chosen = build_plan(Setup(*small), rule)

    def errors(plan):
        return jnp.linalg.norm((reconstruct(plan, g) - truth) * inside, axis=(1, 2))

    assert jnp.max(errors(chosen)) < 0.7 * jnp.min(errors(small_plan))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": SingularValueCutoff}, "expected NormBound, Tikhonov or FixedRank"),
        ({"sigma": 0.0}, "sigma is"),
        ({"power": POWER[1:]}, "power has shape"),
        ({"power": -POWER}, "power is"),
    ],
)
def test_what_cannot_be_chosen_is_refused(small, change, message):
    given = {"sigma": 0.1, "power": POWER} | change
    with pytest.raises(ValueError, match=message):
        choose_regularization(Setup(*small), **given)


def test_ranks_can_be_chosen_too(small, choices):
    choice = choose_regularization(Setup(*small), 0.02, POWER, kind=FixedRank)
    assert choice.image_error < 1.5 * choices[NormBound].image_error
