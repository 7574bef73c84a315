"""Scans of one scanner share programs: from the fourth on nothing is compiled."""

from pathlib import Path

import numpy as np
import pytest
from made_scans import RATE, SPEED, N, raw_counts, record, scan

from jaxtat.io import Scan
from jaxtat.scans import choose, reconstruct

pytestmark = pytest.mark.slow

MAPS = Path("/proc/self/maps")


def a_scan(number: int) -> tuple[Scan, dict]:
    """The number-th scan, and options: channels, region, speed, band, frames, samples differ."""
    rng = np.random.default_rng(number)
    silent = rng.choice(N, number % 3, replace=False)
    counts = raw_counts(record(), seed=number)
    counts[silent] = 0
    counts = counts[:, : len(counts[0]) - number % 4]
    if number % 3 == 1:
        counts = np.stack([counts] * (2 + number % 5))
    radius = 9.8e-3 * rng.uniform(1.0, 1.01)
    options = {"region_radius": radius, "max_frequency": 2900.0 * rng.uniform(0.995, 1.0)}
    if number % 2:
        options["band"] = (2e5 * rng.uniform(0.9, 1.1), 1.9e6)
    return scan(counts, sound_speed=SPEED * rng.uniform(0.999, 1.001)), options


def image_of(number: int, **fit):
    made, options = a_scan(number)
    given = options | fit
    return reconstruct(made, choose(made, **given)).image


@pytest.mark.parametrize("fit", [{}, {"model_based": True}], ids=["direct", "fitted"])
@pytest.mark.filterwarnings("ignore")
def test_the_fourth_scan_compiles_nothing(fit, programs_of, none_made):
    with none_made():
        assert programs_of(lambda: [image_of(k, **fit) for k in range(3)])
        before = len(MAPS.read_bytes().splitlines()) if MAPS.exists() else 0
        for k in range(3, 7):
            assert programs_of(lambda k=k: image_of(k, **fit)) == [], f"scan {k}"
        if MAPS.exists():
            assert len(MAPS.read_bytes().splitlines()) < before + 200


def test_the_pixels_are_those_asked_for(none_made):
    made, options = a_scan(0)
    found = reconstruct(made, choose(made, **options, pixels=70))
    assert found.image.shape == found.grid.shape == (70, 70)
    assert RATE and float(np.asarray(found.grid.half_width)[0]) == options["region_radius"]
