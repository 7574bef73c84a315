"""The speed of sound at which an image is least negative, of detectors on one side."""

import numpy as np
import pytest
from made_scans import RATE, positions, record

from jaxtat.io import Scan
from jaxtat.scans import choose
from jaxtat.scans.least_negative import SPEEDS, highest_peak, positive_share, speed_least_negative

pytestmark = pytest.mark.slow

SHORT = slice(25, 65)  # detectors of made scans, on 118 degrees


def short_arc(faster, samples=None):
    known = {"detectors": positions()[SHORT], "sampling_rate": faster * RATE}
    return Scan("pressure", record()[SHORT, :samples], known)


@pytest.mark.parametrize("faster", [0.97, 1.04])
def test_a_short_arc_gives_a_guess(faster):
    """Of bells, to 1.5 %: they hardly have an edge."""
    made = short_arc(faster)
    found = choose(made, region_radius=0.012, max_frequency=8000.0)
    assert found.sound_speed == pytest.approx(1500 * faster, rel=0.015)
    reason = dict(found.reasons)["sound_speed"]
    assert reason.startswith("the image is least negative: from 118")
    assert reason.endswith("little of the region is between any two detectors")
    assert found.grade("sound_speed") == "guessed"


def test_of_a_record_that_ends_early_there_is_no_image():
    made = short_arc(1.0, round(0.05 / 1500 * RATE))
    assert speed_least_negative(made, choose(made)) is None


def test_the_positive_share_is_of_squares_in_the_window():
    images = np.array([[[3.0, -1.0, 9.0]], [[0.0, -2.0, 9.0]], [[0.0, 0.0, 0.0]]])
    windows = np.broadcast_to([[1.0, 3.0, 0.0]], images.shape)
    np.testing.assert_allclose(positive_share(images, windows), [9 / 12, 0.0, 0.0])


def test_a_peak_counts_beside_a_rise_to_an_end_of_the_range():
    peak = np.exp(-(((SPEEDS - 1.0125) / 0.01) ** 2))
    assert highest_peak(0.5 * peak + 2 * SPEEDS) == pytest.approx(1.0125, abs=1e-3)
    assert highest_peak(5 * SPEEDS) is None
