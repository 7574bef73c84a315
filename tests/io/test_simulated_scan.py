"""The sample scan: always the same, read like any other, and showing what was put into it."""

import numpy as np
import pytest

from jaxtat.cli import main
from jaxtat.io import load_scan
from jaxtat.io.datasets import sample_scan
from jaxtat.io.simulated_scan import SOUND_SPEED, sample_phantom
from jaxtat.scans import choose, reconstruct


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("sample") / "scan.npz"
    sample_scan(path)
    return path


def test_the_command_writes_the_same_file(path, tmp_path):
    other = tmp_path / "scan.npz"
    assert main(["sample", str(other), "--quiet"]) == 0
    assert other.read_bytes() == path.read_bytes()
    assert other.stat().st_size < 600_000


def test_it_is_a_scanners_record(path):
    with np.load(path) as file:
        assert file["pressure"].dtype == np.uint16
        assert file["detectors"].shape == (256, 3)
        assert set(file.files) == {"pressure", "detectors", "sampling_rate"}
        assert file["pressure"].min() > 0
    chosen = choose(load_scan(path), sound_speed=SOUND_SPEED)
    assert chosen.model == "in-plane"
    assert len(chosen.channels) == 256
    assert 8.5e-3 < chosen.region_radius < 1.5 * 8.5e-3


def test_the_image_shows_the_phantom(path):
    """Up to a factor and the slow parts that the record has not."""
    scan = load_scan(path)
    choices = choose(scan, sound_speed=SOUND_SPEED, pixels=41, max_frequency=4000.0)
    found = reconstruct(scan, choices)
    points = found.grid.points
    inside = np.asarray(found.region.contains(points))
    image = np.asarray(found.image).reshape(found.grid.shape)[inside]
    truth = np.asarray(sample_phantom()(points))[inside]
    assert np.corrcoef(image, truth)[0, 1] > 0.7


@pytest.mark.parametrize("name", ["scan.h5", "nowhere/scan.npz"])
def test_bad_places_are_refused(name, tmp_path):
    with pytest.raises(ValueError, match="cannot write"):
        sample_scan(tmp_path / name)
