"""The choice of K(lambda) and alpha(lambda): closed forms, brute force, and better images."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
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
from jaxtat.densities.cylindrical_waves import (
    harmonic_orders,
    polar_geometry,
    wave_system,
    wave_table,
)
from jaxtat.steps.radial_transforms import noise_power, radial_transform
from jaxtat.studies import choose_regularization, image_power

BELL = phantoms.Bells([[0.2, 0.1], [-0.3, -0.2]], [0.6, 0.5], [1.0, 0.7])
POWER = 1e-3 * np.arange(1.0, 21.0) ** -3


@pytest.fixture(scope="module")
def choices(arc):
    """K and alpha for noise that drowns the high frequencies."""
    return {
        kind: choose_regularization(arc, 0.02, POWER, kind=kind) for kind in (NormBound, Tikhonov)
    }


@pytest.fixture(scope="module")
def fine():
    """With high frequencies, most of which is noise."""
    return Setup(circular_arc(1.3, 1.0, 130), disk(1.0), ImageGrid(33))


def gain_of(setup):
    """sigma² p(lambda) / 4π²."""
    power = noise_power(setup.radii, setup.frequencies, setup.curve.weights)
    return 0.02**2 * power / (4 * jnp.pi**2)


def test_alpha_is_noise_over_signal(arc, choices):
    """Minimum of P ||A q - u||² / ||u||² + sigma² p ||q||² / 4π² over all q: the Wiener filter."""
    choice, geometry = choices[Tikhonov], polar_geometry(arc.curve, arc.region)
    assert choice.converged
    some = np.array([3, 11, 19])
    n_max = int(harmonic_orders(geometry, np.asarray(choice.frequencies)[some]).max())

    @jax.jit
    @jax.vmap
    def size_over_unit(wave):
        _, rhs, _, unit = wave_system(geometry, wave, jnp.arange(32) * jnp.pi / 32 - geometry.axis)
        return jnp.mean(jnp.sum(jnp.abs(rhs) ** 2, axis=(0, 1))) / unit  # alike for all on a disk

    ratio = size_over_unit(wave_table(geometry, choice.frequencies[some], n_max))
    alpha = gain_of(arc)[some] / POWER[some] * ratio
    assert_allclose(choice.regularization.alpha[some], alpha, rtol=1e-2)


def test_derivatives_of_the_choice(arc):
    """Implicit ones of the descent's end: alpha goes with sigma²/P(lambda), and nothing else."""

    def alpha(sigma, power):
        return choose_regularization(arc, sigma, power, kind=Tikhonov).regularization.alpha

    value, tangent = jax.linearize(alpha, 0.02, POWER)
    assert_allclose(tangent(1.0, 0 * POWER), 2 * value / 0.02, rtol=1e-3)
    _, back = jax.linear_transpose(tangent, 0.02, POWER)(jnp.ones(20))
    assert_allclose(back, -value / POWER, rtol=1e-3)


def test_no_other_K_is_better(arc, choices):
    """At each frequency, among many: from the reports of plans, by the definition of the error."""
    choice, gain = choices[NormBound], gain_of(arc)
    setup = Setup(arc.curve, arc.region, arc.grid, arc.radii, n_directions=32)
    least = np.full(20, np.inf)
    for K in (0.1, 0.3, 1.0, 1.2, 1.4, 1.6, 2.0, 3.0, PAPER_K, 8.0):
        report = build_plan(setup, NormBound(np.full(20, K))).report
        left = POWER * np.mean(report.residual**2, axis=1)
        least = np.minimum(least, left + np.asarray(gain) * np.mean(report.norm**2, axis=1))
    found = np.asarray(choice.left + choice.noise)
    assert np.max(found / least) < 1.03  # at the bottom of a valley, one of several
    assert found.sum() < least.sum()


def test_tikhonov_has_less_error_than_truncation(choices):
    assert choices[Tikhonov].image_error < choices[NormBound].image_error
    assert 0 < choices[Tikhonov].relative_error < 1


def test_expected_errors_are_those_of_images(fine):
    """Of noise alone, in 40 draws, at the frequencies that let most of it through."""
    choice = choose_regularization(fine, 0.02, 1e-3 * np.arange(1.0, 33.0) ** -3)
    plan = build_plan(fine, choice.regularization)
    noise = 0.02 * jax.random.normal(jax.random.key(0), (40, *fine.data_shape))
    transformed = radial_transform(noise, fine.radii, plan.frequencies)
    fhat = plan.densities.polar_fourier(transformed, fine.curve.weights)
    found = jnp.mean(jnp.abs(fhat) ** 2, axis=(0, 2))
    # J_0 and Y_0 have the same power where lambda r is large
    most = (plan.frequencies > 10) & (choice.noise > 0.3 * choice.noise.max())
    assert most.sum() > 5
    assert_allclose(found[most], choice.noise[most], rtol=0.1)


def test_power_of_the_data_is_that_of_the_phantom(arc, arc_plan):
    g = BELL.circular_integrals(arc.curve, arc.radii)
    exact = jnp.mean(jnp.abs(BELL.fourier(arc.frequencies, arc.sizes.angles)) ** 2, axis=1)
    noisy = g + 0.02 * jax.random.normal(jax.random.key(1), g.shape)
    found = image_power(arc_plan, noisy, 0.02)
    assert_allclose(found[1:5], exact[1:5], rtol=0.3)
    assert np.all(found > 0)
    # beyond the bells' spectrum there is nothing but noise, most of which is subtracted
    raw = image_power(arc_plan, noisy, 1e-9)
    assert np.sum(found[14:]) < 0.3 * np.sum(raw[14:])


def test_derivatives_of_the_power(arc, arc_plan, check_both_modes):
    g = BELL.circular_integrals(arc.curve, arc.radii)

    def power(scale, sigma):  # of the data and of their noise
        return image_power(arc_plan, scale * g, sigma)[:8]

    check_both_modes(power, (1.0, 0.01))


@pytest.fixture(scope="module")
def fine_plan(fine):
    return build_plan(fine)


@pytest.mark.parametrize("kind", [NormBound, Tikhonov])
def test_images_of_noisy_data_are_better_than_with_the_papers_K(fine, fine_plan, kind):
    """Of a phantom whose power was taken from its own noisy data."""
    inside, truth = fine.region.contains(fine.grid.points), BELL.image(fine.grid)
    exact = BELL.circular_integrals(fine.curve, fine.radii)
    g = exact + 0.1 * jax.random.normal(jax.random.key(2), (16, *exact.shape))  # one group
    power = image_power(fine_plan, g[0], 0.1)
    rule = choose_regularization(fine, 0.1, power, kind=kind).regularization
    chosen = build_plan(fine, rule)

    def errors(plan):
        return jnp.linalg.norm((reconstruct(plan, g) - truth) * inside, axis=(1, 2))

    assert jnp.max(errors(chosen)) < 0.7 * jnp.min(errors(fine_plan))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": SingularValueCutoff}, "expected NormBound, Tikhonov or FixedRank"),
        ({"sigma": 0.0}, "sigma is"),
        ({"power": POWER[1:]}, "power has shape"),
        ({"power": -POWER}, "power is"),
    ],
)
def test_what_cannot_be_chosen_is_refused(arc, change, message):
    given = {"sigma": 0.1, "power": POWER} | change
    with pytest.raises(ValueError, match=message):
        choose_regularization(arc, **given)


def test_detectors_that_waves_do_not_reach_are_refused(l_shape):
    power = np.ones(l_shape.sizes.n_frequencies)
    with pytest.raises(ValueError, match="no cylindrical waves reach them"):
        choose_regularization(l_shape, 0.1, power)


def test_ranks_can_be_chosen_too(arc, choices):
    choice = choose_regularization(arc, 0.02, POWER, kind=FixedRank)
    assert choice.image_error < 1.5 * choices[NormBound].image_error
