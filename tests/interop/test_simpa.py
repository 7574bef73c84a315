"""SIMPA judges: its pipeline runs the adapter, and its own delay-and-sum shows the same place."""

import numpy as np
import pytest
from spectral_scans import N_TIMES, RATE, SATURATIONS, SPEED, N, record

from jaxtat.io import Scan
from jaxtat.scans import choose, reconstruct

simpa = pytest.importorskip("simpa", reason="SIMPA is not installed: make test-deepinv")
HALF = 9.0  # of the field of view [mm]
GIVEN = {"region_radius": 0.009, "region_center": [0.0, 0.0], "max_frequency": 3500.0}
GIVEN |= {"alpha": 1e-3, "inversion": "fourier"}


@pytest.fixture(scope="module")
def device():
    """270 degrees of a circle of 40 mm, in the plane of x and z."""
    return simpa.CurvedArrayDetectionGeometry(
        pitch_mm=40 * np.radians(270) / N,
        radius_mm=40,
        number_detector_elements=N,
        sampling_frequency_mhz=RATE / 1e6,
        field_of_view_extent_mm=np.array([-HALF, HALF, 0, 0, -HALF, HALF]),
    )


@pytest.fixture(scope="module")
def pressure(device):
    places = 1e-3 * np.asarray(device.get_detector_element_positions_base_mm())
    p = record(SATURATIONS, np.arange(N_TIMES) / RATE, places[:, [0, 2]])
    return p + 1e-3 * np.abs(p).max() * np.random.default_rng(0).standard_normal(p.shape)


def settings_of(path):
    settings = simpa.Settings({simpa.Tags.SIMPA_OUTPUT_FILE_PATH: str(path)})
    settings[simpa.Tags.WAVELENGTH] = 800
    own = {simpa.Tags.SPACING_MM: 0.4, "jaxtat": GIVEN}
    own[simpa.Tags.RECONSTRUCTION_MODE] = simpa.Tags.RECONSTRUCTION_MODE_PRESSURE
    settings.set_reconstruction_settings(own)
    return settings


@pytest.mark.filterwarnings("default:torch.meshgrid")  # in their delay-and-sum
def test_the_pipeline_stores_our_image_where_its_own_lies(device, pressure, tmp_path):
    from jaxtat.interop.simpa import JaxtatAdapter

    path, tags = tmp_path / "simulated.hdf5", simpa.Tags
    simpa.save_hdf5({"simulations": {}}, str(path))
    simpa.save_data_field(pressure, str(path), tags.DATA_FIELD_TIME_SERIES_DATA, 800)
    # as simulated: not quite the same everywhere
    speeds = SPEED + np.array([[-10.0, 10.0], [5.0, -5.0]])
    simpa.save_data_field(speeds, str(path), tags.DATA_FIELD_SPEED_OF_SOUND)
    images = []
    for adapter in (JaxtatAdapter, simpa.DelayAndSumAdapter):
        adapter(settings_of(path)).run(device)
        images.append(simpa.load_data_field(str(path), tags.DATA_FIELD_RECONSTRUCTED_DATA, 800))
    ours, theirs = images
    assert ours.shape == theirs.shape == (45, 45)
    places = 1e-3 * np.asarray(device.get_detector_element_positions_base_mm())
    known = {"detectors": places, "sampling_rate": RATE, "sound_speed": SPEED}
    scan = Scan("pressure", pressure, known)
    found = reconstruct(scan, choose(scan, **GIVEN, pixels=45))
    middle = (slice(5, -5),) * 2  # of pixels of 9 / 22 mm in place of 0.4
    image = np.asarray(found.image)
    assert np.corrcoef(ours[middle].ravel(), image[middle].ravel())[0, 1] > 0.97
    # sums of pressures have other signs and ripples: it is the place that is compared
    here = np.corrcoef(ours.ravel(), np.abs(theirs).ravel())[0, 1]
    others = [
        np.corrcoef(other(ours).ravel(), np.abs(theirs).ravel())[0, 1]
        for other in (np.transpose, np.flipud, np.fliplr, np.rot90)
    ]
    assert here > max(others) + 0.1


def test_what_is_missing_is_said(device, pressure):
    from jaxtat.interop.simpa import JaxtatAdapter

    settings = simpa.Settings()
    settings.set_reconstruction_settings({})
    with pytest.raises(ValueError, match="no spacing of pixels"):
        JaxtatAdapter(settings).reconstruction_algorithm(pressure, device)
