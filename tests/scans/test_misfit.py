"""What the best image leaves of a record: the model of the record, its derivatives, its least."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_scans import BELLS, RADIUS, SPEED, TIMES, positions, record

from jaxtat import detector_curve, phantoms
from jaxtat.scans.acquisition import FASTEST, SLOWEST
from jaxtat.scans.misfit import IN_PLANE, Fit, Sound, misfit_of, place_of
from jaxtat.scans.sound_speed import STEP, least_share

pytestmark = pytest.mark.slow

PIXELS = 61  # fewer than by default, where many fits are made
ENDS = (0.92 * SLOWEST * SPEED, 1.08 * FASTEST * SPEED)
BODY = phantoms.Bells(BELLS["centers"], BELLS["radii"], [1.0, 0.7, 0.5])


def sound(pressure=None, curve=None, times=TIMES):
    curve = detector_curve(positions()[:, :2]) if curve is None else curve
    pressure = record() if pressure is None else pressure
    good = np.ones(len(pressure), bool)
    center, reach = np.zeros(2), 0.95 * float(np.hypot(*np.asarray(curve.points).T).min())
    return Sound(curve, pressure, times, good, times[0], times[-1], center, reach)


@pytest.fixture(scope="module")
def misfit():
    return misfit_of(sound(), "in-plane", ENDS)


def coarse(made):
    """The criterion on fewer pixels than by default."""
    return misfit_of(made, "in-plane", ENDS, place_of(made, ENDS[1], pixels=PIXELS))


def pixels(misfit, reach=0.95 * RADIUS):
    axis = np.linspace(-reach, reach, misfit.support.shape[0])
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)


def test_the_true_image_gives_the_record(misfit):
    """But for the waves of the smallest bell, of 6 pixels across, that pixels do not hold."""
    image = jnp.asarray(BODY(pixels(misfit)), jnp.float32)[None]
    fit = misfit.fit_at(jnp.asarray(SPEED), jnp.asarray(0.0))
    found, wanted = np.asarray(fit.modelled(image)[0]), np.asarray(misfit.data[0])
    scale = np.sum(found * wanted) / np.sum(found**2)  # data are in a unit of their own
    assert np.linalg.norm(scale * found - wanted) < 0.05 * np.linalg.norm(wanted)


def test_derivatives_in_speed_and_shift_are_differences(misfit):
    """With the image held, by which they are those of the best share."""
    image = jnp.asarray(BODY(pixels(misfit)))[None]

    def left(speed, shift):
        series = misfit.waves(speed, shift)
        modelled = misfit.integrals
        g = jnp.einsum("kr,bdk->bdr", series, _coefficients(modelled, image))
        return jnp.sum((g * misfit.whitening - misfit.data) ** 2)

    at = jnp.asarray(SPEED * 1.003), jnp.asarray(2e-7)
    for which, step in ((0, 1e-3), (1, 1e-12)):
        ahead = [x + step * (k == which) for k, x in enumerate(at)]
        behind = [x - step * (k == which) for k, x in enumerate(at)]
        difference = (left(*ahead) - left(*behind)) / (2 * step)
        assert jax.grad(left, which)(*at) == pytest.approx(float(difference), rel=1e-5)


def _coefficients(integrals, image):
    """G of all frequencies, by a series that leaves them apart."""
    import equinox as eqx

    n = integrals.of.frequencies.shape[0]
    apart = eqx.tree_at(lambda tree: tree.series, integrals, jnp.eye(n, dtype=jnp.float32))
    return apart(image.astype(jnp.float32)).astype(float)


def test_another_speed_or_shift_compiles_nothing(misfit):
    from jaxtat.scans import misfit as module

    misfit.best(1490.0, weight=1.0)
    before = module._fitted._cached._cache_size() if hasattr(module._fitted, "_cached") else None
    misfit.best(1512.5, 1e-7, weight=2.0)
    after = module._fitted._cached._cache_size() if hasattr(module._fitted, "_cached") else None
    assert before == after


def test_detectors_that_do_not_count_change_nothing():
    one = sound()
    spoilt = one.record.copy()
    spoilt[[3, 40]] = 7.0
    good = np.ones(len(spoilt), bool)
    good[[3, 40]] = False
    shares = [
        misfit_of(one._replace(record=pressure, good=good), "in-plane", ENDS).best(SPEED).share
        for pressure in (one.record, spoilt)
    ]
    assert shares[0] == pytest.approx(shares[1], rel=1e-4)


@pytest.mark.parametrize("speed", [1440.0, 1523.0, 1580.0])
def test_the_share_is_least_at_the_true_speed(speed):
    """The record of 1500 m/s at another rate is one of another speed."""
    misfit = coarse(sound(times=TIMES * SPEED / speed))
    weight = misfit.best(SPEED).weight
    speeds = SPEED * np.arange(SLOWEST, FASTEST, STEP)
    told = least_share(partial(misfit.best, weight=weight), speeds, np.ones(90, bool))
    assert told.value == pytest.approx(speed, rel=1e-3)
    assert told.inside and told.depth > 0.5 and told.standard_error < 2e-3 * speed


def leaving(left):
    """A fit that leaves sums over detectors."""
    return Fit(left, float(np.sqrt(left.sum())), 0.0, np.zeros((1, 1)))


def test_parabolas_give_their_least_and_the_error_of_a_mean():
    """Of parabolas about s_k the sum is least at their mean, and the jackknife is exact."""
    places = 3.03 + 0.02 * np.random.default_rng(0).standard_normal(8)
    values, good = np.arange(0.0, 6.0), np.ones(8, bool)
    told = least_share(lambda x, steps: leaving(1 + (x - places) ** 2), values, good)
    assert told.value == pytest.approx(places.mean(), abs=1e-9)
    assert told.standard_error == pytest.approx(places.std(ddof=1) / np.sqrt(8), rel=1e-6)
    ends = least_share(lambda x, steps: leaving(np.full(8, 9.0 + x)), values, good)
    assert not ends.inside and ends.value == 0.0


def test_where_few_steps_are_a_little_off_whole_fits_go_on_downhill():
    """Least by a few steps is at 2, by whole fits at 3.4; the depth is that of these at 2."""
    values, good = np.arange(0.0, 9.0), np.ones(8, bool)

    def fit_at(x, *, steps):
        return leaving(np.full(8, (x - 2.0) ** 2 if steps < IN_PLANE.whole else 1 + (x - 3.4) ** 2))

    told = least_share(fit_at, values, good)
    assert told.value == pytest.approx(3.4, abs=1e-9)
    typical = 1 + (7.0 - 3.4) ** 2  # few steps leave as much at 7 as at most values
    assert told.depth == pytest.approx(1 - (1 + 1.4**2) / typical, rel=1e-9)
