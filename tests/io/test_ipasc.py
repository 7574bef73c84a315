"""IPASC files: as others write them, and as written here."""

import contextlib

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat.io import Scan, load_scan, save_ipasc
from jaxtat.io.frames import LazyFrames

RNG = np.random.default_rng(3)
POSITIONS = RNG.standard_normal((12, 3))
SERIES = RNG.standard_normal((12, 7, 2, 3))  # detectors, samples, wavelengths, measurements


def write(path, series=SERIES, name="{}", positions=POSITIONS, detector=None, **meta):
    """As PACFISH does, with any names of detectors; ``detector`` gives more of each."""
    with h5py.File(path, "w") as file:
        file["binary_time_series_data"] = series
        for tag, value in {"ad_sampling_rate": 4e7, **meta}.items():
            file[f"meta_data/{tag}"] = value
        file["meta_data_device/general/unique_identifier"] = "a device"
        for number, position in enumerate(positions):
            place = f"meta_data_device/detectors/{name.format(number)}"
            file[f"{place}/detector_position"] = position
            for tag, value in (detector(number) if detector else {}).items():
                file[f"{place}/detector_{tag}"] = value
    return path


@pytest.mark.parametrize("name", ["{}", "{:010d}", "detection_element_{}", "ring_2_element_{}"])
def test_detectors_are_in_the_order_of_their_numbers(tmp_path, name):
    scan = load_scan(write(tmp_path / "a.hdf5", name=name))
    assert np.array_equal(scan.known["detectors"], POSITIONS)
    assert scan.about == {"format": "IPASC", "device": "a device"}


def test_frames_are_measurements_with_all_wavelengths(tmp_path):
    path = write(tmp_path / "a.h5", acquisition_wavelengths=np.array([7e-7, 8.5e-7]))
    scan = load_scan(path)
    assert isinstance(scan.data, LazyFrames)
    assert scan.data.shape == (6, 12, 7)
    for number in range(6):
        assert np.array_equal(scan.frame(number), SERIES[:, :, number % 2, number // 2])
    assert np.array_equal(scan.data[1:5:2], SERIES[:, :, 1, :2].transpose(2, 0, 1))
    assert np.array_equal(scan.known["wavelengths"], [700, 850] * 3)


@pytest.mark.parametrize(("named", "kept"), [([700, 750, 800], True), ([700], False)])
def test_three_axes_of_older_files(tmp_path, named, kept):
    series = SERIES[:, :, 0]
    path = write(tmp_path / "a.h5", series, acquisition_wavelengths=np.array(named))
    scan = load_scan(path)
    assert np.array_equal(np.asarray(scan.data), series.transpose(2, 0, 1))
    found = scan.known["wavelengths"]
    assert np.array_equal(found, named if kept else [700] * 3)


def test_a_single_frame(tmp_path):
    for series in (SERIES[:, :, 0, 0], SERIES[:, :, :1, 0], SERIES[:, :, :1, :1]):
        scan = load_scan(write(tmp_path / "a.h5", series))
        assert np.array_equal(scan.data, SERIES[:, :, 0, 0])


@pytest.mark.parametrize("missing", ["None", np.bytes_("None"), np.nan, 0.0, np.array([0.0, 0.0])])
def test_missing_values(tmp_path, missing):
    path = write(tmp_path / "a.h5", speed_of_sound=missing, ad_sampling_rate=missing)
    scan = load_scan(path)
    assert set(scan.known) == {"detectors"}


@pytest.mark.parametrize("speed", [1500.0, np.array([1500.0]), np.array([[1500.0, 1510.0]])])
def test_speed_of_sound_is_a_number_or_a_map(tmp_path, speed):
    scan = load_scan(write(tmp_path / "a.h5", speed_of_sound=speed))
    assert np.array_equal(
        scan.known["sound_speed"], np.squeeze(speed) if np.size(speed) == 1 else speed
    )


@pytest.mark.parametrize("named", [[2, 2], [0.5, 0.6], [700.0, np.nan], [700, 750, 800]])
def test_wavelengths_that_are_none_are_left_out_and_that_is_said(tmp_path, named):
    scan = load_scan(write(tmp_path / "a.h5", acquisition_wavelengths=np.array(named)))
    assert "wavelengths" not in scan.known
    assert (
        scan.about["wavelengths"] == f"{len(named)} left out: no wavelengths, or not of these data"
    )


ROOT_OF_MEAN = np.sqrt((2.0**2 + 2.5**2) / 2) * 1e-3


@pytest.mark.parametrize(
    ("kind", "size", "known"),
    [
        ("CIRCULAR", lambda k: 1.3e-3, {"element_radius": 1.3e-3}),
        ("CIRCLE", lambda k: [1e-3 + k / 1e5], {"element_radius": 1e-3 + np.arange(12) / 1e5}),
        ("CUBOID", lambda k: [0.3e-3, 0.3e-3, 1e-7], {"element_size": 0.3e-3}),
        ("CUBOID", lambda k: [2e-3, 2.5e-3, 0], {"element_size": ROOT_OF_MEAN}),
        ("CUBOID", lambda k: [2.5e-3, 2e-3, 2e-3], {"element_size": ROOT_OF_MEAN}),
    ],
)
def test_sizes_of_elements_are_those_of_the_file(tmp_path, kind, size, known):
    """A rectangle's second moments, a²/12 and b²/12, have the mean of a square's, s²/12."""

    def detector(k):
        return {"geometry_type": kind, "geometry": size(k), "orientation": [0.0, 0.6, -0.8]}

    scan = load_scan(write(tmp_path / "a.h5", detector=detector))
    normals = np.tile([0.0, 0.6, -0.8], (12, 1))
    assert set(scan.known) == {"detectors", "sampling_rate", "normals", *known}
    assert np.array_equal(scan.known["normals"], normals)
    for name, values in known.items():
        assert scan.known[name].shape == np.shape(values)
        np.testing.assert_allclose(scan.known[name], values, rtol=4e-16)
    assert set(scan.about) == {"format", "device"}


@pytest.mark.parametrize(
    ("detector", "why"),
    [
        (lambda k: {"geometry_type": "SPHERE", "geometry": 1e-3}, "of type SPHERE with 1 numbers"),
        (lambda k: {"geometry_type": "MESH", "geometry": "solid"}, "MESH with 0 numbers"),
        (lambda k: {"geometry": [1e-3, 1e-3, 0]}, "no type with 3 numbers"),
        (lambda k: {"geometry_type": "CUBOID"}, "CUBOID with 0 numbers"),
        (lambda k: {"geometry_type": "CUBOID", "geometry": [1.0] * (3 - k % 2)}, "2 and 3 numbers"),
        (lambda k: {"geometry_type": "CUBOID", "geometry": [0, 0, 0]}, "not all are above zero"),
        (lambda k: {"geometry_type": "CIRCULAR", "geometry": float(k)}, "not all are above zero"),
        (lambda k: {"geometry_type": "CUBOID", "geometry": [1, 1, 2]}, "thicker along x3"),
        (
            lambda k: {"geometry_type": "CUBOID", "geometry": [1, 1.6, 0]},
            "one side over 1.5 of the other",
        ),
        (
            lambda k: {"geometry_type": ["CIRCULAR", "CUBOID"][k % 2], "geometry": 1.0},
            "CIRCULAR and CUBOID with 1 numbers",
        ),
    ],
)
def test_elements_that_are_no_disks_or_squares_are_points_and_that_is_said(tmp_path, detector, why):
    scan = load_scan(write(tmp_path / "a.h5", detector=detector))
    assert set(scan.known) == {"detectors", "sampling_rate"}
    assert scan.about["elements"].startswith("their sizes are left out: ")
    assert why in scan.about["elements"]


def test_orientations_that_are_angles_are_no_normals(tmp_path):
    """The format's text has angles of a rotation; those who write it have directions."""
    detector = {"orientation": [0.3, np.pi / 2, 0.0]}
    scan = load_scan(write(tmp_path / "a.h5", detector=lambda k: detector))
    assert "normals" not in scan.known and "length 1" in scan.about["orientations"]


@pytest.mark.parametrize("given", [{"element_radius": 2e-3}, {"element_size": np.arange(1.0, 4)}])
def test_elements_are_written_as_the_format_has_them(tmp_path, given):
    known = {"sampling_rate": 1.0, "normals": 3 * np.eye(3), **given}
    save_ipasc(tmp_path / "a.h5", Scan("pressure", np.ones((3, 7)), known))
    with h5py.File(tmp_path / "a.h5") as file:
        last = file["meta_data_device/detectors/0000000002"]
        kind, size = last["detector_geometry_type"][()], last["detector_geometry"][()].tolist()
        assert (kind, size) in [(b"CIRCULAR", 2e-3), (b"CUBOID", [3.0, 3.0, 0.0])]
        assert last["detector_orientation"][()].tolist() == [0, 0, 1]
    found = load_scan(tmp_path / "a.h5").known
    assert all(np.array_equal(found[name], given[name]) for name in given)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": POSITIONS[:-1]}, "it has 11 detectors, 0 to 10, but data of 12"),
        ({"positions": [*POSITIONS[:-1], np.zeros(2)]}, "positions have shapes"),
        ({"positions": ["None", *POSITIONS[1:]]}, "it has no position of detector 0"),
        ({"name": "{}_0"}, "detectors, .*but data of 12"),
        ({"series": SERIES[0, 0, 0]}, "expected .detectors, samples, wavelengths, measurements."),
        ({"series": SERIES > 0}, "binary_time_series_data has dtype bool"),
        ({"speed_of_sound": -1.0}, "sound speed is -1"),
        ({"positions": POSITIONS * np.inf}, "detectors hold NaN or infinite"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        load_scan(write(tmp_path / "a.h5", **changes))


def test_detectors_need_numbers(tmp_path):
    path = write(tmp_path / "a.h5")
    with h5py.File(path, "a") as file:
        file.move("meta_data_device/detectors/3", "meta_data_device/detectors/three")
    with pytest.raises(ValueError, match="detector 'three' has no number"):
        load_scan(path)


@pytest.mark.slow
def test_texts_that_lead_the_library_astray(tmp_path, monkeypatch):
    """Of any length and alphabet; where one is damaged, HDF5 may loop, crash or fill the memory."""
    monkeypatch.setattr("jaxtat.io.reader.SECONDS", 1)
    path = write(tmp_path / "a.h5", uuid="Größe 7", acoustic_coupling_agent=np.bytes_("water"))
    assert load_scan(path).about["uuid"] == "Größe 7"
    assert load_scan(path).about["coupling agent"] == "water"
    content = path.read_bytes()
    size = content.index(b"Gr\xc3\xb6") - 8
    path.write_bytes(content[:size] + b"\0" * 8 + content[size + 8 :])
    with pytest.raises(ValueError, match="it is damaged: reading it took too long"):
        load_scan(path)
    for damage in (b"\xff" * 8, b"\1" + b"\0" * 7):
        path.write_bytes(content[:size] + damage + content[size + 8 :])
        with contextlib.suppress(ValueError):
            assert load_scan(path).about.get("uuid") in (None, "Größe 7", "G")


known = st.fixed_dictionaries(
    {"sampling_rate": st.floats(1, 1e9)},
    optional={
        "sound_speed": st.floats(1, 1e4),
        "wavelengths": st.sampled_from([[700.0] * 4, [700, 800.5] * 2, [1064, 700, 700, 532]]),
        "detectors": st.just(RNG.standard_normal((3, 3))),
        "field_of_view": st.just(RNG.standard_normal(6)),
        "times": st.just(np.linspace(1, 2, 5)),
        "impulse_response": st.sampled_from([RNG.standard_normal(9), RNG.standard_normal((3, 9))]),
        "normals": st.just(np.eye(3)[[2, 0, 1]]),
        "element_size": st.sampled_from([0.3e-3, np.array([1e-3, 2e-3, 0.7e-3])]),
        "frequency_response": st.just(RNG.standard_normal((3, 2, 4))),
    },
)


@given(known=known, dtype=st.sampled_from(["u2", "i4", "f4", "f8", ">u2"]), lazy=st.booleans())
@settings(deadline=None, max_examples=25)
def test_a_scan_comes_back(tmp_path_factory, known, dtype, lazy):
    path = tmp_path_factory.getbasetemp() / "round.hdf5"
    data = RNG.integers(0, 1000, (4, 3, 5)).astype(dtype)
    frames = LazyFrames(data.shape, data.dtype, lambda chosen: data[chosen]) if lazy else data
    about = {"device": "a", "uuid": "b", "reference": "c", "coupling agent": "d"}
    save_ipasc(path, Scan("pressure", frames, known, about))
    scan = load_scan(path)
    assert scan.data.dtype == data.dtype.newbyteorder("=")
    assert np.array_equal(np.asarray(scan.data), data)
    assert set(scan.known) == set(known)
    assert all(np.array_equal(scan.known[name], known[name]) for name in known)
    assert scan.about == {"format": "IPASC", **about}


def test_positions_in_the_plane_get_a_third_coordinate(tmp_path):
    scan = Scan(
        "pressure", np.ones((12, 7)), {"detectors": POSITIONS[:, :2], "times": np.arange(7)}
    )
    save_ipasc(tmp_path / "a.h5", scan)
    found = load_scan(tmp_path / "a.h5").known
    assert np.array_equal(found["detectors"], np.pad(POSITIONS[:, :2], ((0, 0), (0, 1))))
    assert found["sampling_rate"] == 1


def test_what_the_format_demands_is_there(tmp_path):
    """Mandatory tags of the standard, with the types it names."""
    save_ipasc(tmp_path / "a.h5", Scan("pressure", np.ones((12, 7)), {"sampling_rate": 2.0}))
    with h5py.File(tmp_path / "a.h5") as file:
        meta, general = file["meta_data"], file["meta_data_device/general"]
        for tag in ("uuid", "encoding", "compression", "data_type", "dimensionality"):
            assert isinstance(meta[tag][()], bytes)
        assert meta["dimensionality"][()] == b"time"
        assert meta["sizes"][()].tolist() == [12, 7, 1, 1]
        assert meta["ad_sampling_rate"][()] == 2.0
        assert general["unique_identifier"][()] == general["field_of_view"][()] == b"None"
        assert general["num_detectors"][()] == 12
        detectors = file["meta_data_device/detectors"]
        assert list(detectors) == [f"{number:010d}" for number in range(12)]
        assert detectors["0000000003/detector_position"][()] == b"None"


@pytest.mark.parametrize(
    ("scan", "message"),
    [
        (Scan("circular_integrals", np.ones((3, 4))), "hold pressure"),
        (Scan("pressure", np.ones((3, 4))), "need a sampling_rate, or times at equal steps"),
        (Scan("pressure", np.ones((3, 4)), {"times": [0, 1, 2, 4]}), "times at equal steps"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path, scan, message):
    with pytest.raises(ValueError, match=message):
        save_ipasc(tmp_path / "a.h5", scan)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_while_writing_leaves_what_was_there(tmp_path):
    def fails(numbers):
        raise ValueError("no more frames")

    (tmp_path / "a.h5").write_text("before")
    frames = LazyFrames((2, 3, 4), np.dtype(float), fails)
    with pytest.raises(ValueError, match="no more frames"):
        save_ipasc(tmp_path / "a.h5", Scan("pressure", frames, {"sampling_rate": 1.0}))
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]


@pytest.mark.parametrize("data_file", ["ipasc_compatible_V1.hdf5"], indirect=True)
def test_a_file_of_the_pacfish_project(data_file):
    scan = load_scan(data_file)
    with h5py.File(data_file) as file:
        series = file["binary_time_series_data"][()]
        detectors = file["meta_data_device/detectors"]
        for number in range(4):
            position = detectors[f"detection_element_{number}/detector_position"][()]
            assert np.array_equal(scan.known["detectors"][number], position)
            assert np.array_equal(scan.frame(number % 2)[number], series[number, :, number % 2])
    assert scan.data.shape == (2, 4, 100)
    assert scan.known["sampling_rate"] == 1.2234
    assert scan.known["sound_speed"] == 1540
    assert np.array_equal(scan.known["field_of_view"], [0, 1e-3, 0, 0.03, 0, 0.03])
    assert scan.known["frequency_response"].shape == (4, 2, 2)
    assert scan.about["device"] == "a2fd-48nbsh-sfiush7-chjs"
    assert scan.about["wavelengths"].startswith("2 left out")  # they are 2 and 2


@pytest.mark.parametrize("data_file", ["msot_scan9.npz"], indirect=True)
def test_a_measured_scan_is_converted_exactly(data_file, tmp_path):
    scan = load_scan(data_file)
    save_ipasc(tmp_path / "scan9.hdf5", scan)
    found = load_scan(tmp_path / "scan9.hdf5")
    with np.load(data_file) as file:
        assert found.data.dtype == file["raw"].dtype
        assert np.array_equal(found.data, file["raw"])
        assert np.array_equal(found.known["detectors"], file["geometry"])
        assert found.known["sampling_rate"] == file["fs"]
    assert set(found.known) == set(scan.known)
