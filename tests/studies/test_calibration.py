"""Calibration on data of images it does not know: exact integrals of phantoms, with 2 % noise.

Notebook 04 asserts sound speed and centre together, from 2 % and two pixels off.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    Setup,
    circular_arc,
    detector_curve,
    disk,
    phantoms,
    reconstruct,
)
from jaxtat.densities.cylindrical_waves import polar_geometry
from jaxtat.studies import calibrate
from jaxtat.studies.calibration import ScannerParameters, _CalibrationProblem, _corrected, _fit

pytestmark = pytest.mark.slow

DETECTORS = 24
GRID = ImageGrid(23)
STEP = float(GRID.spacing[0])
CURVE, REGION = circular_arc(1.3, 1.0, DETECTORS), disk(0.95)
RADII = 0.25 + STEP * jnp.arange(24)
COARSE = Setup(circular_arc(1.3, 1.0, 40), disk(1.0), ImageGrid(13), 0.2 + 0.1 * jnp.arange(24))
CENTERS = [[0.1, 0.05], [0.3, 0.25], [-0.35, -0.1], [0.2, -0.4]]
BELLS = phantoms.Bells(CENTERS, [0.7, 0.4, 0.3, 0.3], [1, 1.5, -1.5, 1])


def noisy(g, seed=0):
    return g + phantoms.noise_like(jax.random.key(seed), g, 0.02)


@pytest.fixture(scope="module")
def exact():
    return BELLS.circular_integrals(COARSE.curve, COARSE.radii)


def gains_and_delays(g, radii, detectors, rng):
    """Gains of 10 % and delays up to a step, in eighths: data on ``radii`` from a finer table."""
    gains = np.exp(0.1 * rng.standard_normal(detectors))
    gains /= np.exp(np.log(gains).mean())
    eighths = rng.integers(-8, 9, detectors)
    g = np.stack([row[8 - d :: 8][: len(radii)] for row, d in zip(g, eighths, strict=True)])
    return g * gains[:, None], gains, eighths * STEP / 8


@pytest.mark.filterwarnings("ignore:detectors are too few")  # images are compared, alike in this
def test_gains_and_delays_of_every_detector(caplog):
    """Gains to 1 % and delays to a tenth of a pixel; then the image is what it would have been.

    Of detectors that are given one by one, on no arc that is known. Derivatives with respect to
    data are implicit ones, of the optimum that the steps end at; all stages share their program.
    """
    setup = Setup(detector_curve(CURVE.points), REGION, GRID, RADII)
    fine = RADII[0] - STEP + STEP / 8 * jnp.arange(8 * len(RADII) + 16)
    table = np.asarray(BELLS.circular_integrals(CURVE, fine))
    g, gains, delays = gains_and_delays(table, RADII, DETECTORS, np.random.default_rng(1))
    g = jax.device_put(g)
    given, direction = (
        np.asarray(noisy(g)),
        0.01 * np.random.default_rng(5).standard_normal(g.shape),
    )

    def calibrated(size):
        found = calibrate(setup, given + size * direction, unknown=("gains", "delays"))
        return (found.parameters.gains, found.parameters.delays, found.stages.misfit[-1]), found

    with jax.log_compiles():
        _, tangent, found = jax.linearize(calibrated, 0.0, has_aux=True)
    said = [record.getMessage() for record in caplog.records]
    assert sum(text.startswith("Compiling") and "_fit" in text for text in said) == 1

    assert found.converged
    assert np.isnan(found.parameters.radius)
    assert np.std(found.parameters.gains / gains) < 0.01
    assert np.abs(found.parameters.delays - delays).max() < 0.1 * STEP
    off = np.concatenate([found.parameters.gains - gains, found.parameters.delays - delays])
    errors = np.concatenate([found.standard_errors.gains, found.standard_errors.delays])
    assert 0.6 < np.sqrt(np.mean((off / errors) ** 2)) < 1.4

    ahead = tangent(1.0)
    far, near = (jax.linearize(calibrated, size, has_aux=True)[0] for size in (0.1, -0.1))
    for slope, high, low in zip(ahead, far, near, strict=True):
        np.testing.assert_allclose(slope, (high - low) / 0.2, atol=1e-5, rtol=1e-3)
    (back,) = jax.linear_transpose(tangent, 0.0)(ahead)
    np.testing.assert_allclose(back, sum(np.sum(np.square(slope)) for slope in ahead), rtol=1e-9)

    def error(g):
        image = reconstruct(setup, g, 1e-3)
        return float(jnp.linalg.norm((image - BELLS.image(GRID))[REGION.contains(GRID.points)]))

    untouched = noisy(BELLS.circular_integrals(CURVE, RADII))
    assert error(found.g) < 1.5 * error(untouched) < 0.5 * error(g)


def test_delays_are_taken_out_at_any_radii():
    """Delayed data are known exactly: those of radii that are shorter by c times the delay."""
    rng, curve = np.random.default_rng(4), circular_arc(1.3, 1.0, 5)
    radii = 0.2 + (jnp.arange(75) + rng.uniform(-0.2, 0.2, 75)) / 28
    delays = rng.uniform(-1, 1, 5) / 14
    late = [BELLS.circular_integrals(curve, radii - delay)[k] for k, delay in enumerate(delays)]
    problem = _CalibrationProblem(
        curve=curve,
        region=REGION,
        geometry=polar_geometry(curve, REGION),
        radii=radii,
        g=jnp.stack(late),
        sound_speed=jnp.ones(()),
        turns=jnp.zeros(1),
        alpha=jnp.ones(()),
        sizes=Setup(CURVE, REGION, GRID, RADII).sizes,
    )
    found = ScannerParameters(
        jnp.ones(()), jnp.ones(()), jnp.zeros(2), jnp.ones(5), jnp.asarray(delays)
    )
    true = BELLS.circular_integrals(curve, radii)
    assert np.abs(_corrected(problem, found) - true).max() < 1e-3 * np.abs(true).max()


def test_standard_errors_are_the_scatter_of_many_draws(exact):
    found = [calibrate(COARSE, noisy(exact, i)) for i in range(5)]
    speed = np.array([calibration.parameters.sound_speed for calibration in found])
    error = np.array([calibration.standard_errors.sound_speed for calibration in found])
    chi_square = np.sum(((speed - 1.0) / error) ** 2)
    assert 0.41 < chi_square < 16.8  # 0.5 and 99.5 % of chi square for 5
    assert np.ptp(error) < 0.3 * error.mean()


def test_what_is_not_unknown_stays_as_it_is(exact):
    g = noisy(exact)
    found = calibrate(COARSE, g, sound_speed=1500.0)
    assert found.parameters.radius == 1.3
    assert np.array_equal(found.parameters.gains, np.ones(40))
    assert np.array_equal(found.parameters.delays, np.zeros(40))
    assert found.standard_errors.sound_speed > 0
    for name in ("radius", "center", "gains", "delays"):
        assert np.all(getattr(found.standard_errors, name) == 0)
    assert np.allclose(found.g, g, atol=1e-12)
    assert np.all(np.diff(found.stages.max_frequency) > 0)


def test_it_can_be_traced_with_the_setup_closed_over(exact):
    found = jax.eval_shape(lambda g: calibrate(COARSE, g).parameters.sound_speed, exact)
    assert found.shape == ()


def test_new_numbers_need_no_new_program(exact):
    programs = set()
    for i, speed in enumerate((1.0, 1480.0)):
        calibrate(COARSE, noisy(exact, i), sound_speed=speed, alpha=1e-5 * (i + 1))
        programs.add(_fit._cached._cache_size())
    assert len(programs) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unknown": ()}, "expected some of"),
        ({"unknown": ("speed",)}, "expected some of"),
        ({"unknown": ("sound_speed", "radius")}, "cannot both be unknown"),
        ({"unknown": ("center",)}, "in a single view"),
        ({"unknown": ("center",), "turns": [1.0, 1.0 + 2 * np.pi]}, "in a single view"),
        ({"curve": detector_curve(CURVE.points), "unknown": ("radius",)}, "only a circular"),
        ({"turns": [0.0, 1.0]}, "g has shape"),
        ({"sound_speed": 0.0}, "sound_speed is"),
        ({"alpha": -1.0}, "alpha is"),
        ({"g": jnp.zeros((DETECTORS, len(RADII)))}, "zero everywhere"),
    ],
)
def test_what_cannot_be_calibrated_is_refused(change, message):
    given = {"curve": CURVE, "g": jnp.ones((DETECTORS, len(RADII)))} | change
    curve, g = given.pop("curve"), given.pop("g")
    with pytest.raises(ValueError, match=message):
        calibrate(Setup(curve, REGION, GRID, RADII), g, **given)
