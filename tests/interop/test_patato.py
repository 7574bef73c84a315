"""PATATO judges: it opens what is written, unmixes it, and its own back-projection still runs."""

import numpy as np
import pytest
from scipy.signal import resample
from spectral_scans import (
    BELLS,
    CENTER,
    ENERGIES,
    GIVEN,
    N_TIMES,
    OPTIONS,
    SATURATIONS,
    light,
    spectral_scan,
    write_patato,
)

from jaxtat import phantoms
from jaxtat.cli import main
from jaxtat.interop import save_patato
from jaxtat.scans import choose, reconstruct

patato = pytest.importorskip("patato", reason="PATATO is not installed: pip install jaxtat[patato]")

PRESET = {
    "PREPROCESSING_ALGORITHM": "Standard Preprocessor",
    "RECONSTRUCTION_ALGORITHM": "jaxtat",
    "HILBERT_TRANSFORM": False,
    "IRF": False,
    "INTERPOLATE_TIME": 1,
    "INTERPOLATE_DETECTORS": 1,
    "RECONSTRUCTION_NX": 45,
    "RECONSTRUCTION_NY": 31,
    "RECONSTRUCTION_FIELD_OF_VIEW_X": [CENTER[0] - 0.011, CENTER[0] + 0.011],
    "RECONSTRUCTION_FIELD_OF_VIEW_Y": [CENTER[1] - 0.0075, CENTER[1] + 0.0075],
    "RECONSTRUCTION_FIELD_OF_VIEW_Z": [0.0, 0.0],
    "RECONSTRUCTION_PARAMS": {
        "region_radius": 0.011,
        "region_center": [0.0, 0.0],
        "max_frequency": 3500.0,
        "alpha": 1e-3,
        "model": "in-plane",
        "inversion": "fourier",
    },
}


@pytest.fixture(scope="module")
def data():
    # 1150 samples: its filter takes 1024 at least
    return resample(light(), 5 * N_TIMES, axis=-1)


@pytest.fixture(scope="module")
def written(data, tmp_path_factory):
    """By the command, into a file of PATATO with a region of interest."""
    path = write_patato(tmp_path_factory.mktemp("patato") / "scan.hdf5", data)
    assert main([*f"reconstruct {path} --format patato {OPTIONS} --out".split(), str(path)]) == 0
    return path


def opened(path):
    return patato.PAData.from_hdf5(str(path), "r+")


def unmixed(images, pa):
    """PATATO's own unmixing, sO2 and total haemoglobin of a reconstruction."""
    mixer = patato.SpectralUnmixer(["Hb", "HbO2"], pa.get_wavelengths())
    parts, _, _ = mixer.run(images, pa)
    so2, _, _ = patato.SO2Calculator().run(parts, pa)
    thb, _, _ = patato.THbCalculator().run(parts, pa)
    return mixer, parts, so2, thb


@pytest.mark.slow
def test_saturation_is_that_of_arrays_given_directly_and_the_true_one(written, data):
    pa = opened(written)
    recons = pa.get_scan_reconstructions()
    assert list(recons) == [("jaxtat", "0")]
    mixer, _, so2, _ = unmixed(recons["jaxtat", "0"], pa)
    direct = spectral_scan(data / ENERGIES[..., None, None])
    known = {name: value for name, value in direct.known.items() if name != "laser_energy"}
    direct = type(direct)("pressure", direct.data, known)
    found = reconstruct(direct, choose(direct, **GIVEN))
    images = found.image.reshape(2, 4, 45, 45)
    hb, hbo2 = np.einsum("fwxy,wk->kfxy", images, np.linalg.pinv(mixer.forward_matrix))
    strong = phantoms.Bells(BELLS["centers"], BELLS["radii"]).image(found.grid) > 0.3
    wanted = (hbo2 / (hb + hbo2))[:, strong]
    got = np.asarray(so2.raw_data)[:, 0, 0].swapaxes(1, 2)[:, strong]
    assert got.shape == wanted.shape
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-6)
    x = np.asarray(found.grid.points)
    nearest = np.linalg.norm(x[..., None, :] - np.array(BELLS["centers"]), axis=-1).argmin(-1)
    true = SATURATIONS[nearest][strong]
    # PATATO's spectra are not the five numbers of the phantom's, and bells overlap a little
    assert np.median(np.abs(got - true)) < 0.03
    # without the energies it is far off
    wrong = images * ENERGIES[..., None, None] / ENERGIES.mean()
    hb, hbo2 = np.einsum("fwxy,wk->kfxy", wrong, np.linalg.pinv(mixer.forward_matrix))
    assert np.median(np.abs((hbo2 / (hb + hbo2))[:, strong] - true)) > 0.1
    pa.close()


def test_what_it_made_is_saved_and_measured_in_the_region_of_interest(written):
    pa = opened(written)
    for image in unmixed(pa.get_scan_reconstructions()["jaxtat", "0"], pa)[1:]:
        image.save(pa.scan_writer)
    pa.set_default_recon(("jaxtat", "0"))
    table = pa.summary_measurements(["so2", "thb"], roi_kwargs={})
    assert list(table["name"]) == [("vessel_left", "0")]
    # the square lies in the first bell
    assert abs(float(np.ravel(table["so2_mean"][0])[0]) - SATURATIONS[0]) < 0.05
    image = pa.get_scan_so2()
    nodes = np.asarray(image.da.coords["x"])
    assert np.allclose(nodes[[0, -1]], pa.get_scan_reconstructions().fov[0])
    pa.close()


def backprojected(path):
    pa = opened(path)
    pre = patato.PreProcessor(
        time_factor=1, detector_factor=1, hilbert=False, universal_backprojection=True
    )
    series, extra, _ = pre.run(pa.get_time_series(), pa)
    fov = [(c - 0.011, c + 0.011) for c in CENTER] + [(0.0, 0.0)]
    algorithm = patato.ReferenceBackprojection([45, 45, 1], fov)
    image, _, _ = algorithm.run(series, pa, **extra)
    pa.close()
    return np.asarray(image.raw_data)[:, :, 0].swapaxes(2, 3)


def test_its_own_back_projection_runs_on_the_file_and_sees_the_same(written, data, tmp_path):
    """On the file that was extended, and on one that was made anew."""
    old = backprojected(written)
    scan = spectral_scan(data)
    found = reconstruct(scan, choose(scan, **GIVEN))
    save_patato(tmp_path / "new.hdf5", scan, found)
    new = backprojected(tmp_path / "new.hdf5")
    np.testing.assert_allclose(new, old, rtol=1e-4, atol=1e-5 * np.abs(old).max())
    # what is bright in one is bright in the other, and nowhere mirrored or turned
    images = found.image.reshape(2, 4, 45, 45)
    here = np.corrcoef(images[0, 2].ravel(), old[0, 2].ravel())[0, 1]
    others = [
        np.corrcoef(images[0, 2].ravel(), other(old[0, 2]).ravel())[0, 1]
        for other in (np.transpose, np.flipud, np.fliplr, np.rot90)
    ]
    assert here > 0.6
    assert here > max(others) + 0.2
    # and of pulses of other energies in the next round too
    ratio = np.linalg.norm(images, axis=(2, 3)) / np.linalg.norm(old, axis=(2, 3))
    np.testing.assert_allclose(ratio[0], ratio[1], rtol=1e-4)


def test_a_reconstruction_class_is_registered_and_makes_our_images(written, data):
    import jaxtat.interop.patato as plugin

    assert patato.recon.RECONSTRUCTION_NAMES["jaxtat"] is plugin.JaxtatReconstruction
    pa = opened(written)
    start = patato.read_reconstruction_preset(PRESET)
    series, extra, _ = start.run(pa.get_time_series(), pa)
    image, _, _ = start.children[0].run(series, pa, **extra)
    assert image.shape == (2, 4, 1, 31, 45)
    ours = np.asarray(pa.get_scan_reconstructions()["jaxtat", "0"].raw_data)
    # pixels are as large, and in the middle of the other image
    got = np.asarray(image.raw_data)
    assert np.linalg.norm(got - ours[..., 7:38, :]) < 0.01 * np.linalg.norm(got)
    series.attributes["HILBERT_TRANSFORM"] = True
    with pytest.raises(ValueError, match="the record is a Hilbert transform"):
        start.children[0].run(series, pa, **extra)
    pa.close()


@pytest.mark.slow
def test_a_preset_without_alpha_asks_for_fitted_images(data, tmp_path):
    """f >= 0, of the same bells as in direct images, which go below."""
    import jaxtat.interop.patato  # noqa: F401

    pa = opened(write_patato(tmp_path / "scan.hdf5", data[:1], ENERGIES[:1]))
    of_formula = PRESET["RECONSTRUCTION_PARAMS"]
    of_fit = {name: of_formula[name] for name in of_formula if name not in ("alpha", "inversion")}
    images = []
    for params in (of_fit, of_formula):
        start = patato.read_reconstruction_preset(PRESET | {"RECONSTRUCTION_PARAMS": params})
        series, extra, _ = start.run(pa.get_time_series(), pa)
        images.append(np.asarray(start.children[0].run(series, pa, **extra)[0].raw_data))
    pa.close()
    fitted, direct = images
    for one, other in zip(fitted[0], direct[0], strict=True):
        assert other.min() < -0.02 * other.max() < 0 <= one.min()
        assert np.corrcoef(one.ravel(), other.ravel())[0, 1] > 0.9
