"""The search for the speed of sound: data of all speeds at once, and sharpness without images."""

import re
import warnings
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from made_scans import RATE, positions, record, scan

from jaxtat import ImageGrid, Setup, circular_arc, disk, phantoms
from jaxtat.io import Scan, load_scan
from jaxtat.io.datasets import sample_scan
from jaxtat.reconstruction.plane_bases import plane_basis
from jaxtat.reconstruction.setup import plane_of
from jaxtat.regularization import tikhonov_rule
from jaxtat.scans import choose, estimate_sound_speed
from jaxtat.scans.all_speeds import data_by_speed
from jaxtat.scans.facts import FASTEST, SLOWEST
from jaxtat.scans.speed import _sharpness, at_speed, by_both, compare_sound_speed, sharpest
from jaxtat.scans.speed_found import SpeedFound, unknown
from jaxtat.steps import AccuracyWarning, polar_grid, radial_transform
from jaxtat.studies import sharpness

SETUP = Setup(circular_arc(1.3, 1.3, 96), disk(0.8), ImageGrid(41, 0.8), max_frequency=50.0)
FREQUENCIES, RADII = SETUP.frequencies, SETUP.radii
STRETCHES = jnp.array([0.94, 1.0, 1.05])


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """The scan that the package writes to try things on."""
    path = tmp_path_factory.mktemp("sample") / "scan.npz"
    sample_scan(path)
    return load_scan(path)


def data(bells):
    return bells.circular_integrals(SETUP.curve, RADII)


def test_data_of_all_speeds_are_those_of_stretched_radii():
    g = data(phantoms.Bells([[0.1, -0.15]], [0.5]))
    found = data_by_speed(g, RADII, STRETCHES, FREQUENCIES)
    for number, stretch in enumerate(STRETCHES):
        one = radial_transform(g, stretch * RADII, FREQUENCIES)
        np.testing.assert_allclose(found[number], one, atol=1e-12 * np.abs(one).max())


def test_sharpness_without_an_image_is_the_images():
    """Up to a factor, of bells of two sizes; fhat² itself would be half as large. Times speed²."""
    wide, narrow = (phantoms.Bells([[0.1, -0.15]], [size]) for size in (0.6, 0.45))
    basis = plane_basis(*plane_of(SETUP), None)
    rule, eta = tikhonov_rule(1e-8, len(FREQUENCIES)), jnp.ones(len(FREQUENCIES) + 1)
    values, exact = [], []
    for bells in (wide, narrow):
        fhat, _ = basis.fhat(data_by_speed(data(bells), RADII, STRETCHES, FREQUENCIES), rule)
        values.append(np.asarray(_sharpness(fhat, eta, STRETCHES, FREQUENCIES)).sum(axis=1))
        fine = ImageGrid(201, 0.8)
        exact.append(float(sharpness(bells.image(fine), fine)))
    assert values[1][1] / values[0][1] == pytest.approx(exact[1] / exact[0], rel=0.01)
    twice = _sharpness(fhat, eta, 2 * STRETCHES, FREQUENCIES)
    np.testing.assert_allclose(twice.sum(axis=1), 4 * values[1], rtol=1e-12)


def bump(speeds, at, height=0.3):
    """In one sector, over a sharpness of 1."""
    return 1 + height * np.exp(-(((speeds[:, None] - at) / 0.01) ** 2))


def test_no_speed_is_believed_that_hardly_stands_out():
    found = sharpest(lambda speeds: bump(speeds, 0.99, 0.04))
    assert (found.stretch, found.grade, found.standard_error) == (1.0, "guessed", None)
    assert "none within 10 %" in found.why
    found = sharpest(lambda speeds: bump(speeds, 0.9837))
    assert found.stretch == pytest.approx(0.9837, abs=1e-5)
    assert (found.why, found.grade) == ("the image is sharpest, by 30%", "likely")


def test_a_peak_counts_beside_a_slow_rise_to_an_end_of_the_range():
    """The end is sharper than the peak, and no peak."""
    found = sharpest(lambda speeds: bump(speeds, 0.9837) + 6 * (speeds[:, None] - 0.93))
    assert found.stretch == pytest.approx(0.9837, abs=1e-3)
    assert "sharpest, by" in found.why
    rising = sharpest(lambda speeds: 1 + 6 * (speeds[:, None] - 0.93))
    assert rising.stretch == 1.0 and rising.grade == "guessed"


def test_the_standard_error_is_that_of_a_mean_of_sectors():
    """Of parabolas about s_k the sum is highest at their mean, and the jackknife is exact."""
    places = 1.01 + 1e-3 * np.random.default_rng(0).standard_normal(8)

    def parabolas(speeds):
        """With surroundings that are no part of it."""
        off = speeds[:, None] - places
        return np.where(np.abs(off) < 0.02, 2 - (off / 0.02) ** 2, 1.0)

    found = sharpest(parabolas)
    assert found.stretch == pytest.approx(places.mean(), abs=1e-6)
    assert found.standard_error == pytest.approx(places.std(ddof=1) / np.sqrt(8), rel=1e-3)


def test_directions_that_do_not_agree_are_not_believed():
    """Two halves, of which one alone would be."""
    found = sharpest(lambda speeds: np.hstack([bump(speeds, 0.976), bump(speeds, 0.99)]))
    assert found.stretch == 1.0 and found.grade == "guessed"
    assert "do not agree" in found.why


SHARP = SpeedFound(1.02, "the image is sharpest", "likely", 1e-4)


@pytest.mark.parametrize("speed", [1.0151, 1.0249])
def test_the_sharpest_image_is_believed_if_opposite_detectors_agree(speed):
    assert by_both(SHARP, SpeedFound(speed, "detectors", "likely", 1e-4)) == SHARP


@pytest.mark.parametrize(
    ("sharp", "agreed", "speed", "why"),
    [
        (SHARP, unknown("detectors know none"), 1.02, "but detectors know none"),
        (unknown("no peak"), SpeedFound(1.03, "detectors", "likely", 1e-4), 1.03, "but no peak"),
    ],
)
def test_a_speed_that_one_of_them_shows_is_a_guess(sharp, agreed, speed, why):
    found = by_both(sharp, agreed)
    assert (found.stretch, found.grade, found.standard_error) == (speed, "guessed", None)
    assert why in found.why


@pytest.mark.parametrize(("speed", "more"), [(1.01, "1.0% more"), (1.03, "1.0% less")])
def test_two_speeds_that_contradict_each_other_are_a_guess_and_a_note(speed, more):
    with pytest.warns(AccuracyWarning, match=f"sharpest at a speed of sound {more} than .*start"):
        found = by_both(SHARP, SpeedFound(speed, "detectors", "likely", 1e-4))
    assert (found.stretch, found.grade, found.standard_error) == (speed, "guessed", None)
    assert f"sharpest at {more}" in found.why


def test_without_either_there_is_none():
    assert by_both(unknown("no peak"), unknown("detectors know none")) is None


@pytest.mark.parametrize("faster", [0.97, 1.04])
def test_a_record_that_ends_early_shows_the_speed_beyond_the_middle(faster):
    """1455 and 1560 m/s, and a record of 48 mm before detectors at 40 mm: to 1 %, of bells."""
    short = record()[:, : round(0.048 / 1500 * RATE)]
    made = Scan("pressure", short, {"detectors": positions(), "sampling_rate": faster * RATE})
    found = estimate_sound_speed(made, choose(made))
    assert found.model_based
    assert found.sound_speed == pytest.approx(1500 * faster, rel=0.01)
    assert "opposite detectors agree best" in dict(found.reasons)["sound_speed"]
    assert found.grade("sound_speed") == "guessed"


def test_noise_alone_agrees_on_no_speed():
    noise = np.random.default_rng(0).standard_normal((90, 128))
    sound = record()[:, :128]
    made = Scan(
        "pressure",
        sound + 3 * np.abs(sound).max() * noise,
        {"detectors": positions(), "sampling_rate": RATE},
    )
    found = estimate_sound_speed(made, choose(made, region_radius=0.011))
    assert dict(found.reasons)["sound_speed"].startswith("water's: ")


def of_speed(sample, speed):
    return replace(sample, known=dict(sample.known) | {"sound_speed": np.asarray(speed)})


def test_a_speed_in_the_file_is_compared_with_that_of_the_sharpest_image(sample):
    """The sample was made with 1510 m/s."""
    right = of_speed(sample, 1510.0)
    assert choose(right) == compare_sound_speed(right, choose(right))
    assert choose(right).grade("sound_speed") == "sure"
    wrong = of_speed(sample, 1480.0)
    found = compare_sound_speed(wrong, choose(wrong))
    assert (found.sound_speed, found.grade("sound_speed")) == (1480.0, "guessed")
    why = dict(found.reasons)["sound_speed"]
    said = re.fullmatch(r"from the file; but the image is sharpest, by \d+%, at (.*) m/s: .*", why)
    assert said and float(said[1]) == pytest.approx(1510.0, rel=0.003)
    given = choose(wrong, sound_speed=1480.0)
    assert compare_sound_speed(wrong, given) is given


def test_a_map_of_speeds_is_said_to_be_one_and_never_sure(sample):
    chosen = choose(of_speed(sample, np.full((3, 4), 1510.0)))
    assert (chosen.sound_speed, chosen.grade("sound_speed")) == (1510.0, "sure")
    chosen = choose(of_speed(sample, np.repeat([[1500.0, 1560.0]], 6, axis=0)))
    assert (chosen.sound_speed, chosen.grade("sound_speed")) == (1530.0, "guessed")
    why = dict(chosen.reasons)["sound_speed"]
    assert "the mean of 6 x 2 speeds in the file, 1500 m/s to 1560 m/s" in why


def test_another_speed_keeps_the_times_of_the_radii_and_their_steps_or_shorter_ones():
    chosen = choose(scan(record()), pixels=33)
    last = chosen.first_radius + chosen.radial_step * (chosen.n_radii - 1)
    for stretch in (SLOWEST, 1.0, 1.003, FASTEST):
        moved = at_speed(chosen, stretch)
        assert moved.sound_speed == stretch * chosen.sound_speed
        assert moved.first_radius == stretch * chosen.first_radius
        assert moved.radial_step <= chosen.radial_step * (1 + 1e-9)
        end = moved.first_radius + moved.radial_step * (moved.n_radii - 1)
        assert end == pytest.approx(stretch * last, rel=1e-12)
    assert at_speed(chosen, 1.0).n_radii == chosen.n_radii


@pytest.mark.parametrize("pixels", [17, *range(33, 434, 50), 64, 129, 433])
def test_choices_of_pixels_do_not_cause_an_alarm(sample, pixels):
    """At any speed of sound that may be estimated: the radii sample the shortest wave."""
    chosen = choose(sample, pixels=pixels)
    for stretch in (SLOWEST, 1.0007, FASTEST):
        moved = at_speed(chosen, stretch)
        with warnings.catch_warnings():
            warnings.simplefilter("error", AccuracyWarning)
            polar_grid(moved.region, moved.grid, moved.radii, moved.max_frequency, None)
