"""The interface of IPASC's image reconstruction, and PACFISH's checks of what is written."""

from dataclasses import replace

import numpy as np
import pytest
from spectral_scans import (
    BELLS,
    CENTER,
    ENERGIES,
    GIVEN,
    N_TIMES,
    RATE,
    SPEED,
    WAVELENGTHS,
    light,
    positions,
    spectral_scan,
)

from jaxtat import DiskBody, ImageGrid, Setup, detector_curve, disk, phantoms
from jaxtat.interop import IpascAlgorithm
from jaxtat.io import Scan, load_scan, save_ipasc
from jaxtat.records import simulate_pressure
from jaxtat.scans import choose, reconstruct, with_best_method


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


def image_of(frame, choices, step, algorithm=None):
    """Of the field of view in which 22 mm are pixels of this step."""
    fov = [CENTER[0] - 0.011, CENTER[0] + 0.011, CENTER[1] - 0.011, CENTER[1] + 0.011, 0.0, 0.0]
    image = (algorithm or Algorithm()).implementation(
        time_series_data=frame,
        detection_elements={"positions": positions()},
        sampling_rate=RATE,
        field_of_view=np.array(fov),
        spacing_m=step,
        choices=choices,
        fnumber=0,
    )
    assert image.shape[2] == 1
    return image[..., 0]


def inside_of(chosen, image):
    return np.where(chosen.region.contains(chosen.grid.points), image, 0.0)


def relative(found, wanted):
    assert found.shape == wanted.shape
    return np.linalg.norm(found - wanted) / np.linalg.norm(wanted)


def without(*names):
    return {name: value for name, value in GIVEN.items() if name not in names}


KNOWN = {"detectors": positions(), "sampling_rate": RATE, "sound_speed": SPEED}


@pytest.mark.slow
def test_the_image_is_that_of_the_scan(data):
    scans = [Scan("pressure", frame, KNOWN) for frame in data[0, :2]]
    chosen, algorithm = choose(scans[0], **GIVEN), Algorithm()
    for scan in scans:  # the second by what was chosen for the first
        image = image_of(scan.frame(0), without("pixels"), 0.0005, algorithm)  # 45 across
        assert relative(image, inside_of(chosen, reconstruct(scan, chosen).image)) < 0.01
    with pytest.raises(ValueError, match=r"at least 4 pixels of 0\.0005 apart along two of them"):
        algorithm.implementation(scans[0].frame(0), {"positions": positions()}, RATE, np.zeros(6))


@pytest.mark.slow
def test_without_alpha_the_image_is_the_fitted_one(data):
    """f >= 0, where the formula has what is below."""
    scan, given = Scan("pressure", data[0, 0], KNOWN), without("pixels", "alpha", "inversion")
    chosen = with_best_method(scan, choose(scan, pixels=45, **given))
    assert chosen.model_based
    image = image_of(scan.frame(0), given, 0.0005)
    assert relative(image, inside_of(chosen, reconstruct(scan, chosen).image)) < 0.01
    direct = image_of(scan.frame(0), given | {"alpha": 1e-3}, 0.0005)
    assert direct.min() < -0.02 * direct.max() < 0 <= image.min()


@pytest.mark.slow
def test_a_body_of_another_speed_is_that_of_the_scan():
    """Of its own record; without the body the image is worse."""
    disk_body = DiskBody(CENTER, 0.012, SPEED, 1440.0)
    where = detector_curve(positions()[:, :2]), disk(0.011, center=CENTER)
    setup = Setup(*where, ImageGrid(45, 0.011, CENTER), medium=disk_body)
    truth, times = phantoms.Bells(**BELLS).image(setup.grid), np.arange(N_TIMES) / RATE
    record = simulate_pressure(setup, truth, times, model="in-plane")
    scan = Scan("pressure", np.asarray(record), KNOWN)
    body = {"water_speed": 1440.0, "body_center": CENTER, "body_radius": 0.012}
    given = without("pixels") | {"model": "in-plane"}
    chosen = choose(scan, pixels=45, **given, **body)
    image = image_of(scan.frame(0), given | body, 0.0005)
    assert relative(image, inside_of(chosen, reconstruct(scan, chosen).image)) < 0.01
    errors = [relative(found, truth) for found in (image, image_of(scan.frame(0), given, 0.0005))]
    assert errors[0] < 0.6 * errors[1]


def test_pacfish_finds_no_fault_with_what_is_written(data, tmp_path):
    pacfish = pytest.importorskip("pacfish", reason="PACFISH is not installed: pip install pacfish")
    path = tmp_path / "scan.hdf5"
    scan = spectral_scan(data, field_of_view=[-0.01, 0.01, -0.01, 0.01, 0.0, 0.0])
    scan = replace(scan, known={**scan.known, "element_size": 1e-3})
    save_ipasc(path, replace(scan, about={"device": "an array"}))  # it asks for both
    read = pacfish.load_data(str(path))
    checker = pacfish.ConsistencyChecker()
    assert checker.check_acquisition_meta_data(read.meta_data_acquisition)
    assert checker.check_device_meta_data(read.meta_data_device)
    assert checker.check_binary_data(read.binary_time_series_data)
    assert np.allclose(read.get_acquisition_wavelengths(), WAVELENGTHS / 1e9)
    energies = read.meta_data_acquisition[pacfish.MetadataAcquisitionTags.PULSE_ENERGY.tag]
    assert np.allclose(energies, ENERGIES / 1e3)


@pytest.mark.parametrize(
    ("kind", "size", "known"),
    [
        ("CIRCULAR", 0.5e-3, {"element_radius": 0.5e-3}),
        ("CUBOID", np.array([2e-3, 2e-3, 1e-4]), {"element_size": 2e-3}),
    ],
)
def test_elements_that_pacfish_writes_have_their_size_and_direction(tmp_path, kind, size, known):
    pacfish = pytest.importorskip("pacfish", reason="PACFISH is not installed: pip install pacfish")
    device = pacfish.DeviceMetaDataCreator()
    device.set_general_information("an array", np.zeros(6))
    directions = np.random.default_rng(0).standard_normal((5, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for direction in directions:
        element = pacfish.DetectionElementCreator()
        element.set_detector_position(0.04 * direction)
        element.set_detector_orientation(direction)
        element.set_detector_geometry_type(kind)
        element.set_detector_geometry(size)
        device.add_detection_element(element.get_dictionary())
    path, rate = tmp_path / "a.hdf5", pacfish.MetadataAcquisitionTags.AD_SAMPLING_RATE.tag
    written = pacfish.PAData(np.ones((5, 7, 1, 1)), {rate: 4e7}, device.finalize_device_meta_data())
    pacfish.write_data(str(path), written)
    found = load_scan(path).known
    assert {name: float(found[name]) for name in known} == known
    np.testing.assert_array_equal(found["normals"], directions)
    np.testing.assert_array_equal(found["detectors"], 0.04 * directions)


def test_energies_come_back(data, tmp_path):
    path = tmp_path / "scan.hdf5"
    save_ipasc(path, spectral_scan(data))
    assert np.allclose(load_scan(path).known["laser_energy"], ENERGIES.ravel(), rtol=1e-14)
