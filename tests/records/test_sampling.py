"""What record and detectors support, and an image that fails beyond it."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    NoiseLevel,
    Setup,
    circular_arc,
    detector_curve,
    disk,
    phantoms,
    polyline,
    reconstruct,
)
from jaxtat.geometry import keep_detectors
from jaxtat.records import first_arrival, supported

TIMES = np.linspace(0.0, 2.4, 481)


ARC, REGION = circular_arc(1.3, 1.0, 64), disk(1.0)


def test_circles_about_a_disk_follow_the_formula():
    found = supported(ARC, REGION, TIMES, sound_speed=1.0)
    step = 2 * 1.3 * np.sin(float(ARC.span) / 64 / 2)
    assert abs(found.frequency_of_detectors / (np.pi * 1.3 / step) - 1) < 1e-4
    assert abs(found.frequency_of_times / (np.pi / 0.005) - 1) < 1e-12
    assert abs(found.reach_of_end - 1.1) < 1e-9
    assert abs(found.reach_of_start - 0.98 * 1.3) < 1e-9
    assert found.shortfalls == ()
    assert "at most 1.1" in str(found)


def test_gaps_do_not_decide_and_few_missing_detectors_little():
    def without(missing):
        keep = ~np.isin(np.arange(64), missing)
        return float(supported(keep_detectors(ARC, keep), REGION, TIMES).frequency_of_detectors)

    whole = float(supported(ARC, REGION, TIMES).frequency_of_detectors)
    assert abs(without(np.arange(20, 36)) / whole - 1) < 1e-6  # a gap
    assert abs(without(np.arange(1, 64, 4)) / whole - 8 / 11) < 0.01  # 8 of them take 11 steps
    assert abs(without(np.arange(1, 32, 2)) / whole - 0.5) < 1e-2  # half of the arc is coarser


def test_two_densities_are_both_sampled():
    """The sparse side of an L decides, first or last: its steps are no gaps."""
    region = disk(0.3, n_boundary=64)
    corners = [(-1, 1), (-1, -1), (1, -1)]
    first, last = (
        float(supported(polyline(corners, n), region, TIMES).frequency_of_detectors)
        for n in ((15, 90), (90, 15))
    )
    assert abs(first / last - 1) < 1e-9
    assert np.pi / (2 / 15) < first < 0.5 * np.pi / (2 / 90)


def test_a_straight_array_is_sampled_by_its_steepest_wave():
    """A line at distance 1 from a disk of radius 1/2: its ends see waves the flattest."""
    x = np.linspace(-2, 2, 48)
    curve = detector_curve(np.stack([x, np.full(48, -1.0)], axis=1))
    found = supported(curve, disk(0.5), TIMES)
    angle = np.arctan2(np.abs(x), 1.0) + np.arcsin(0.5 / np.hypot(x, 1.0))
    steepest = np.where(angle < np.pi / 2, np.sin(angle), 1.0)
    expected = np.pi / np.quantile(4 / 47 * steepest, 0.9)
    assert abs(found.frequency_of_detectors / expected - 1) < 1e-4


def test_first_sound_arrives_from_the_nearest_point():
    region = disk(0.4, center=(-0.5, 0.0))
    nearest = np.linalg.norm(np.asarray(ARC.points) - [-0.5, 0.0], axis=1).min() - 0.4
    assert abs(first_arrival(ARC, region, sound_speed=2.0) - nearest / 2) < 1e-5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"sound_speed": 0.9}, ["the record ends 0.14 before", "up to 0.86 is possible"]),
        ({"dead_time": 0.5}, ["the record starts 0.2 after", "up to 0.8 is possible"]),
        (
            {"max_frequency": 50.0},
            ["detectors are too few", "details of 0.06283", "more detectors"],
        ),
        ({"max_frequency": 700.0}, ["too few", "samples are too slow", "higher sampling rate"]),
    ],
)
def test_what_cannot_be_had_is_said_with_numbers(options, words):
    found = supported(ARC, REGION, TIMES, **options)
    assert all(word in str(found) for word in words), str(found)
    assert len(found.shortfalls) == 1 + ("too slow" in str(found))


def test_a_region_as_large_as_can_be_had_is_covered():
    options = {"sound_speed": 0.9, "dead_time": 0.3}
    most = float(supported(ARC, REGION, TIMES, **options).largest_reach)
    for factor, ok in ((0.999, True), (1.001, False)):
        region = disk(factor * most)
        assert (supported(ARC, region, TIMES, **options).shortfalls == ()) == ok


def test_derivatives_in_geometry_and_sound_speed(check_both_modes):
    region = disk(0.9, n_boundary=41)

    def found(speed, radius, center):
        curve = circular_arc(radius, 1.0, 16, center=center)
        seen = supported(curve, region, TIMES, sound_speed=speed)
        return seen.largest_reach, seen.max_frequency, seen.covered

    arguments = (jnp.asarray(0.9), jnp.asarray(1.31), jnp.array([0.13, 0.07]))
    check_both_modes(found, arguments, rtol=1e-4)


def test_images_fail_beyond_the_supported_frequency_and_not_before():
    """Bells of radius r0, whose waves are all but 1e-4 below 30/r0, from 72 detectors.

    The smallest comes out again in a region half as large, where the same detectors support twice
    the frequency: it was they that failed, not frequencies, pixels or radii.
    """
    arc, grid = circular_arc(1.3, 1.0, 72), ImageGrid(33)
    radii = np.arange(19, 149) / 64
    limit = float(supported(arc, REGION, TIMES).frequency_of_detectors)

    def error(ratio, region):
        setup = Setup(arc, region, grid, radii, max_frequency=2 * limit)
        bell = phantoms.Bells([[0.15, 0.1]], [30 / (ratio * limit)])
        g = bell.circular_integrals(arc, radii)
        hardly = NoiseLevel(np.full(len(setup.frequencies), 1e-8))
        image = reconstruct(setup, g, hardly, inversion="fourier")
        error = np.abs(np.asarray(image) - np.asarray(bell.image(grid)))
        return error[region.contains(grid.points)].max()

    errors = [error(ratio, REGION) for ratio in (0.9, 1.4, 2.0)]
    assert errors[0] < 1e-6
    assert errors[1] > 10 * errors[0] and errors[2] > 30 * errors[1]
    assert error(2.0, disk(0.5)) < 0.2 * errors[2]
