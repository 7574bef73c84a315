"""The expected error by a plan: of noise, the Wiener filter, better images."""

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
    disk,
    phantoms,
    reconstruct,
)
from jaxtat.densities.cylindrical_waves import (
    polar_geometry,
    wave_orders,
    wave_system,
    wave_table,
)
from jaxtat.steps.radial_transforms import noise_power, radial_transform
from jaxtat.studies import expected_error, image_power

BELL = phantoms.Bells([[0.2, 0.1], [-0.3, -0.2]], [0.6, 0.5], [1.0, 0.7])
POWER = 1e-3 * np.arange(1.0, 21.0) ** -3
SIGMA = 0.02


@pytest.fixture(scope="module")
def fine():
    """With high frequencies, most of which is noise."""
    return Setup(circular_arc(1.3, 1.0, 130), disk(1.0), ImageGrid(33))


@pytest.fixture(scope="module")
def fine_plan(fine):
    return build_plan(fine)


def wiener_alpha(setup):
    """Minimum of P ||A q - u||² / ||u||² + sigma² p ||q||² / 4π² over all q, in Tikhonov's unit."""
    geometry = polar_geometry(setup.curve, setup.region)
    n_max = int(wave_orders(geometry, np.asarray(setup.frequencies)).max())

    @jax.jit
    @jax.vmap
    def size_over_unit(wave):
        _, rhs, _, unit = wave_system(geometry, wave, jnp.arange(32) * jnp.pi / 32 - geometry.axis)
        return jnp.mean(jnp.sum(jnp.abs(rhs) ** 2, axis=(0, 1))) / unit  # alike for all on a disk

    ratio = size_over_unit(wave_table(geometry, setup.frequencies, n_max))
    noise = SIGMA**2 * noise_power(setup.radii, setup.frequencies, setup.curve.weights)
    return noise / (4 * jnp.pi**2) / POWER * ratio


def test_least_is_the_error_of_the_wiener_filter(arc):
    """Its alpha is stationary at every frequency, and no other or truncation has less error."""
    best = wiener_alpha(arc)

    def error(alpha):
        return expected_error(build_plan(arc, Tikhonov(alpha)), SIGMA, POWER)

    least, slope = jax.jvp(lambda t: error(best * jnp.exp(t)), (0.0,), (1.0,))
    assert np.max(np.abs(slope) / least) < 1e-6
    for rule in (Tikhonov(2 * best), Tikhonov(best / 2)):
        assert np.all(expected_error(build_plan(arc, rule), SIGMA, POWER) > least)
    for K in (0.3, 1.0, 1.4, 2.0, 3.0, 8.0):
        truncated = expected_error(build_plan(arc, NormBound(np.full(20, K))), SIGMA, POWER)
        assert np.all(truncated > 0.999 * least)


def test_expected_errors_are_those_of_noise(fine):
    """Of noise alone, in 40 draws, at the frequencies that let most of it through."""
    plan = build_plan(fine, Tikhonov(np.full(32, 1e-2)))
    noise = SIGMA * jax.random.normal(jax.random.key(0), (40, *fine.data_shape))
    transformed = radial_transform(noise, fine.radii, plan.frequencies)
    fhat = plan.densities.polar_fourier(transformed, fine.curve.weights)
    drawn = jnp.mean(jnp.abs(fhat) ** 2, axis=(0, 2))
    expected = expected_error(plan, SIGMA, np.full(32, 1e-300))  # no image
    # J_0 and Y_0 have the same power where lambda r is large
    most = (plan.frequencies > 10) & (expected > 0.3 * expected.max())
    assert most.sum() > 5
    assert_allclose(drawn[most], expected[most], rtol=0.1)


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


@pytest.mark.slow
@pytest.mark.parametrize("kind", [NormBound, Tikhonov])
def test_images_of_noisy_data_are_better_than_with_the_papers_K(fine, fine_plan, kind):
    """Of a phantom whose power was taken from its own noisy data, by the best of eight numbers."""
    inside, truth = fine.region.contains(fine.grid.points), BELL.image(fine.grid)
    exact = BELL.circular_integrals(fine.curve, fine.radii)
    g = exact + 0.1 * jax.random.normal(jax.random.key(2), (16, *exact.shape))  # one group
    power = image_power(fine_plan, g[0], 0.1)
    numbers = np.geomspace(0.1, 8, 8) if kind is NormBound else np.geomspace(1e-4, 1e4, 8)
    plans = [build_plan(fine, kind(np.full(32, number))) for number in numbers]
    errors = np.stack([expected_error(plan, 0.1, power) for plan in plans])
    chosen = build_plan(fine, kind(numbers[errors.argmin(axis=0)]))

    def misses(plan):
        return jnp.linalg.norm((reconstruct(plan, g) - truth) * inside, axis=(1, 2))

    assert jnp.max(misses(chosen)) < 0.7 * jnp.min(misses(fine_plan))


def test_wrong_arguments_are_refused(arc, arc_plan):
    for change, message in (
        ({"sigma": 0.0}, "sigma is"),
        ({"power": POWER[1:]}, "power has shape"),
        ({"power": -POWER}, "power is"),
    ):
        with pytest.raises(ValueError, match=message):
            expected_error(arc_plan, **({"sigma": 0.1, "power": POWER} | change))
