"""The speed of sound at which an image explains most of a record from half a circle."""

import jax.numpy as jnp
import numpy as np
import pytest
from made_scans import RATE, positions, record

from jaxtat.io import Scan
from jaxtat.scans import choose
from jaxtat.scans.all_speeds import data_by_speed
from jaxtat.scans.best_explained import SPEEDS, deepest

pytestmark = pytest.mark.slow

HALF = slice(15, 75)  # detectors of made scans, on 179 degrees
SIZES = {"region_radius": 0.011, "max_frequency": 3500.0}  # the same for all: few programs


def dip(speeds, at, depth=0.5, width=0.008):
    """A share that is 1 but for a dip, in frequencies as many as places."""
    off = speeds - np.atleast_1d(at)[:, None]
    return np.exp(-depth * np.maximum(1 - (off / width) ** 2, 0.0))


def half(faster=1.0, noise=0.01, samples=None):
    """A record of bells from one side, whose speed of sound is so much faster than water's."""
    sound = record()[HALF, :samples]
    drawn = np.random.default_rng(0).standard_normal(sound.shape)
    sound = sound + noise * np.abs(sound).max() * drawn
    known = {"detectors": positions()[HALF], "sampling_rate": faster * RATE}
    return Scan("pressure", sound, known)


@pytest.mark.parametrize("faster", [0.97, 1.04])
def test_half_a_circle_shows_the_speed(faster):
    made = half(faster)
    found = choose(made, **SIZES)
    assert found.sound_speed == pytest.approx(1500 * faster, rel=2e-3)
    assert dict(found.reasons)["sound_speed"].startswith("an image explains the record best")


def test_a_record_that_ends_early_gives_a_guess():
    made = half(1.04, samples=round(0.05 / 1500 * RATE))
    found = choose(made)
    assert found.sound_speed == pytest.approx(1500 * 1.04, rel=5e-3)
    assert dict(found.reasons)["sound_speed"].endswith("but the record ends early")
    assert found.grade("sound_speed") == "guessed"


@pytest.mark.filterwarnings("ignore:no image explains")
def test_noise_from_one_side_shows_no_speed():
    made = half(noise=3.0)
    found = choose(made, **SIZES)
    assert "no speed explains the record much better" in dict(found.reasons)["sound_speed"]
    assert found.grade("sound_speed") == "guessed"


def test_the_standard_error_is_that_of_a_mean_of_bands():
    """Of parabolas about s_k the sum is deepest at their mean, and the jackknife is exact."""
    places = SPEEDS[15] + 5e-4 * np.random.default_rng(0).standard_normal(8)
    found, depth, _ = deepest(lambda speeds: dip(speeds, places))
    assert found.value == pytest.approx(places.mean(), abs=1e-6)
    assert found.standard_error == pytest.approx(places.std(ddof=1) / np.sqrt(8), rel=1e-3)
    assert depth == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize(
    "share_at",
    [
        lambda speeds: dip(speeds, [1.01] * 8, 0.15),  # shallow
        lambda speeds: dip(speeds, [1.01] * 8) * dip(speeds, [1.06] * 8, 0.3),  # one of two
        lambda speeds: np.exp(-4 * np.abs(speeds - 0.94)) * np.ones((8, 1)),  # wide
    ],
)
def test_no_dip_is_believed_that_does_not_stand_out(share_at):
    found, *_ = deepest(share_at)
    assert (found.value, found.standard_error) == (1.0, None)
    assert found.why == "no speed explains the record much better than others"


def test_bands_that_do_not_agree_are_not_believed():
    places = [SPEEDS[15]] * 4 + [SPEEDS[16]] * 4
    found, *_ = deepest(lambda speeds: dip(speeds, places, 2.0, 0.003))
    assert (found.value, found.standard_error) == (1.0, None)
    assert "do not agree" in found.why


def test_only_sound_from_the_region_counts_at_every_speed():
    """Radii are so wide apart that each is a node of the quadrature."""
    g = np.ones((2, 200))
    radii, frequencies = jnp.linspace(0.5, 1.5, 200), jnp.array([3.0, 20.0])
    sounding, speeds = jnp.array([[0.8, 1.2], [0.7, 1.3]]), jnp.array([0.95, 1.0, 1.1])
    found = data_by_speed(g, radii, speeds, frequencies, sounding)
    everywhere = data_by_speed(g, radii, speeds, frequencies, jnp.array([[0.1, 2.0]] * 2))
    np.testing.assert_array_equal(everywhere, data_by_speed(g, radii, speeds, frequencies))
    for number, speed in enumerate(np.asarray(speeds)):
        r = speed * np.asarray(radii)
        outside = (r[None] < sounding[:, :1] - 0.05) | (r[None] > sounding[:, 1:] + 0.05)
        left_out = data_by_speed(np.where(outside, 5.0, g), radii, speeds, frequencies, sounding)
        np.testing.assert_allclose(left_out[number], found[number], atol=1e-12)
