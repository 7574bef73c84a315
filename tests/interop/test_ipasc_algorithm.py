"""The interface of IPASC's image reconstruction, and PACFISH's checks of what is written."""

from dataclasses import replace

import numpy as np
import pytest
from spectral_scans import (
    CENTER,
    ENERGIES,
    GIVEN,
    RATE,
    SPEED,
    WAVELENGTHS,
    light,
    positions,
    spectral_scan,
)

from jaxtat.interop import IpascAlgorithm
from jaxtat.io import Scan, load_scan, save_ipasc
from jaxtat.scans import choose, reconstruct


@pytest.fixture(scope="module")
def data():
    return light()


class Base:
    """What their base class has: metadata of a file, and a call for each record of it."""

    class ipasc_data:
        @staticmethod
        def get_speed_of_sound():
            return SPEED


class Algorithm(IpascAlgorithm, Base):
    pass


@pytest.mark.slow
def test_the_image_is_that_of_the_scan(data):
    known = {"detectors": positions(), "sampling_rate": RATE, "sound_speed": SPEED}
    scans = [Scan("pressure", frame, known) for frame in data[0, :2]]
    chosen = choose(scans[0], **GIVEN)
    inside = np.asarray(chosen.region.contains(chosen.grid.points))
    step = 0.0005  # the pixels of 45 in 22 mm
    fov = [CENTER[0] - 0.011, CENTER[0] + 0.011, CENTER[1] - 0.011, CENTER[1] + 0.011, 0.0, 0.0]
    choices = {name: value for name, value in GIVEN.items() if name != "pixels"}
    algorithm = Algorithm()
    for scan in scans:  # the second by what was chosen for the first
        image = algorithm.implementation(
            time_series_data=scan.frame(0),
            detection_elements={"positions": positions()},
            sampling_rate=RATE,
            field_of_view=np.array(fov),
            spacing_m=step,
            choices=choices,
            fnumber=0,
        )
        assert image.shape == (45, 45, 1)
        wanted = np.where(inside, reconstruct(scan, chosen).image, 0.0)
        assert np.linalg.norm(image[..., 0] - wanted) < 0.01 * np.linalg.norm(wanted)
    with pytest.raises(ValueError, match=r"at least 4 pixels of 0\.0005 apart along two of them"):
        algorithm.implementation(scans[0].frame(0), {"positions": positions()}, RATE, np.zeros(6))


def test_pacfish_finds_no_fault_with_what_is_written(data, tmp_path):
    pacfish = pytest.importorskip("pacfish", reason="PACFISH is not installed: pip install pacfish")
    path = tmp_path / "scan.hdf5"
    scan = spectral_scan(data, field_of_view=[-0.01, 0.01, -0.01, 0.01, 0.0, 0.0])
    save_ipasc(path, replace(scan, about={"device": "an array"}))  # it asks for both
    read = pacfish.load_data(str(path))
    checker = pacfish.ConsistencyChecker()
    assert checker.check_acquisition_meta_data(read.meta_data_acquisition)
    assert checker.check_device_meta_data(read.meta_data_device)
    assert checker.check_binary_data(read.binary_time_series_data)
    assert np.allclose(read.get_acquisition_wavelengths(), WAVELENGTHS / 1e9)
    energies = read.meta_data_acquisition[pacfish.MetadataAcquisitionTags.PULSE_ENERGY.tag]
    assert np.allclose(energies, ENERGIES / 1e3)


def test_energies_come_back(data, tmp_path):
    path = tmp_path / "scan.hdf5"
    save_ipasc(path, spectral_scan(data))
    assert np.allclose(load_scan(path).known["laser_energy"], ENERGIES.ravel(), rtol=1e-14)
