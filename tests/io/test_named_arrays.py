"""Arrays by name, as .npz, .h5 and .mat hold them: every accepted name and order of axes."""

import h5py
import numpy as np
import pytest
from scan_writers import write_named

from jaxtat.io import load_scan
from jaxtat.io.named_arrays import NAMES, NAMES_OF_DATA

SUFFIXES = (".npz", ".h5", ".hdf5", ".mat")
RNG = np.random.default_rng(3)
DATA = RNG.standard_normal((6, 9))
POSITIONS = RNG.standard_normal((6, 2))
VALUES = {
    "detectors": POSITIONS,
    "times": np.arange(9.0),
    "sampling_rate": np.array(4e7),
    "radii": np.arange(9.0),
    "sound_speed": np.array(1500.0),
    "wavelengths": np.array([700.0]),
    "laser_energy": np.array([60.0]),
    "field_of_view": np.arange(6.0),
    "impulse_response": np.arange(5.0),
    "frequency_response": RNG.standard_normal((6, 2, 3)),
    "element_radius": np.array(1e-3),
    "element_size": np.arange(1.0, 7.0),
    "normals": RNG.standard_normal((6, 3)),
}


def same(one, two):
    one, two = np.asarray(one), np.asarray(two)
    return one.dtype == two.dtype and one.shape == two.shape and np.array_equal(one, two)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in NAMES_OF_DATA for name in NAMES[kind]]
)
def test_data_under_each_name(tmp_path, suffix, kind, name):
    scan = load_scan(write_named(tmp_path / f"scan{suffix}", **{name: DATA}))
    assert scan.kind == kind
    assert same(scan.data, DATA)
    assert scan.known == {}


KNOWN = [(thing, name) for thing in NAMES for name in NAMES[thing] if thing not in NAMES_OF_DATA]


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
@pytest.mark.parametrize(("thing", "name"), KNOWN)
def test_what_else_is_known_under_each_name(tmp_path, suffix, thing, name):
    scan = load_scan(write_named(tmp_path / f"scan{suffix}", raw=DATA, **{name: VALUES[thing]}))
    assert list(scan.known) == [thing]
    assert same(scan.known[thing], VALUES[thing])


def test_the_names_are_those_of_the_documentation():
    assert set(VALUES) == {thing for thing, _ in KNOWN}
    assert {"positions", "geometry", "fs", "t", "r", "speed_of_sound"} <= {n for _, n in KNOWN}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_first_names_come_first_and_strangers_are_left(tmp_path, suffix):
    path = write_named(
        tmp_path / f"scan{suffix}",
        raw=DATA + 1,
        g=DATA,
        positions=POSITIONS + 1,
        detectors=POSITIONS,
        comment="of another kind",
    )
    scan = load_scan(path)
    assert scan.kind == "circular_integrals"
    assert same(scan.data, DATA)
    assert set(scan.known) == {"detectors"}
    assert same(scan.known["detectors"], POSITIONS)
    pressure = load_scan(path, kind="pressure")
    assert pressure.kind == "pressure"
    assert same(pressure.data, DATA + 1)


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize("dtype", ["u1", "i2", "u2", "i8", "f2", "f4", "f8", ">f8", ">i2"])
def test_all_real_types_are_read_with_their_values_in_native_order(tmp_path, suffix, dtype):
    values = np.arange(54).reshape(6, 9).astype(dtype)
    scan = load_scan(write_named(tmp_path / f"scan{suffix}", raw=values))
    assert scan.data.dtype == np.dtype(dtype).newbyteorder("=")
    assert np.array_equal(scan.data, values)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
@pytest.mark.parametrize("by", ["detectors", "times"])
def test_data_in_the_other_order_are_told_by_what_is_known(tmp_path, suffix, by):
    value = POSITIONS.T if by == "detectors" else np.arange(9.0)[:, None]
    scan = load_scan(write_named(tmp_path / f"scan{suffix}", raw=DATA.T, **{by: value}))
    assert same(scan.data, DATA)
    assert scan.known[by].shape == ((6, 2) if by == "detectors" else (9,))


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
@pytest.mark.parametrize("turned", [False, True])
def test_many_frames(tmp_path, suffix, turned):
    data = RNG.standard_normal((3, 6, 9))
    stored = data.swapaxes(1, 2) if turned else data
    if suffix == ".mat":  # frames last
        stored = np.moveaxis(stored, 0, -1)
    scan = load_scan(write_named(tmp_path / f"scan{suffix}", raw=stored, positions=POSITIONS))
    assert scan.data.shape == (3, 6, 9)
    assert same(scan.data[1:], data[1:])
    assert same(scan.frame(2), data[2])


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
@pytest.mark.parametrize("values", [DATA + 1j, DATA > 0, "abc"])
@pytest.mark.parametrize("name", ["g", "sound_speed"])
def test_what_is_no_real_number_is_refused(tmp_path, suffix, values, name):
    arrays = {"pressure": DATA, name: values}
    with pytest.raises(ValueError, match=rf"a\{suffix}: {name} .*expected real numbers"):
        load_scan(write_named(tmp_path / f"a{suffix}", **arrays))


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
def test_missing_data_are_explained(tmp_path, suffix):
    arrays = {"radii": np.arange(3.0), "detectors": POSITIONS, "Pressure": DATA}
    path = write_named(tmp_path / f"a{suffix}", **arrays)
    with pytest.raises(
        ValueError,
        match=r"holds (Pressure, detectors, radii|radii, detectors, Pressure), .*pressure",
    ):
        load_scan(path)
    path = write_named(tmp_path / f"b{suffix}", pressure=DATA)
    with pytest.raises(
        ValueError,
        match=r"holds pressure, expected .* circular_integrals, spherical_integrals, g",
    ):
        load_scan(path, kind="circular_integrals")


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
def test_shapes_that_do_not_fit_are_refused(tmp_path, suffix):
    path = write_named(tmp_path / f"a{suffix}", raw=DATA, detectors=POSITIONS[:-1])
    with pytest.raises(ValueError, match=rf"cannot read .*a\{suffix}: .*the data have 6 detectors"):
        load_scan(path)


def test_groups_beside_the_data_are_left(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["pressure"] = DATA
        file.create_group("radii")["g"] = POSITIONS
    scan = load_scan(str(tmp_path / "a.h5"))
    assert same(scan.data, DATA)
    assert scan.known == {}
