"""Scan files: every accepted name, and refusals of what is damaged or no data."""

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat.io import load_scan
from jaxtat.io.scans import NAMES

SUFFIXES = (".npz", ".h5", ".hdf5")
RNG = np.random.default_rng(3)
DATA = RNG.standard_normal((6, 9))
POSITIONS = RNG.standard_normal((6, 2))


def write(path, **arrays):
    """Arrays by name in a file of the kind that the suffix says."""
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    else:
        with h5py.File(path, "w") as file:
            for name, array in arrays.items():
                file[name] = array
    return path


def same(one, two):
    return one.dtype == two.dtype and one.shape == two.shape and one.tobytes() == two.tobytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("kind", "name"),
    [(kind, name) for kind in ("circular_integrals", "pressure") for name in NAMES[kind]],
)
def test_data_under_each_name(tmp_path, suffix, kind, name):
    scan = load_scan(write(tmp_path / f"scan{suffix}", **{name: DATA}))
    assert scan.kind == kind
    assert same(scan.data, DATA)
    assert scan.known == {}


KNOWN = [(thing, name) for thing in NAMES for name in NAMES[thing]][4:]


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize(("thing", "name"), KNOWN)
def test_what_else_is_known_under_each_name(tmp_path, suffix, thing, name):
    value = POSITIONS if thing == "detectors" else np.array(1500.0)
    scan = load_scan(write(tmp_path / f"scan{suffix}", raw=DATA, **{name: value}))
    assert list(scan.known) == [thing]
    assert same(scan.known[thing], value)


def test_the_names_are_those_of_the_documentation():
    assert {thing for thing, _ in KNOWN} == {
        *("detectors", "times", "sampling_rate", "radii", "sound_speed")
    }
    assert {"positions", "geometry", "fs", "t", "r", "speed_of_sound"} <= {n for _, n in KNOWN}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_first_names_and_circular_integrals_come_first_and_strangers_are_left(tmp_path, suffix):
    path = write(
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


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize("dtype", ["u1", "i2", "u2", "i8", "f2", "f4", "f8", ">f8", ">i2"])
def test_all_real_types_are_read_with_their_values_in_native_order(tmp_path, suffix, dtype):
    values = np.arange(54).reshape(6, 9).astype(dtype)
    scan = load_scan(write(tmp_path / f"scan{suffix}", raw=values))
    assert scan.data.dtype == np.dtype(dtype).newbyteorder("=")
    assert np.array_equal(scan.data, values)


def test_compressed_files_and_groups_beside_the_data(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", pressure=DATA)
    assert same(load_scan(tmp_path / "a.npz").data, DATA)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("pressure", data=DATA, chunks=(2, 3), compression="gzip")
        file.create_group("radii")["g"] = POSITIONS
    scan = load_scan(str(tmp_path / "a.h5"))
    assert same(scan.data, DATA)
    assert scan.known == {}


class Trap:
    """Tells when it is unpickled."""

    sprung = False

    def __init__(self):
        self.state = 1

    def __setstate__(self, state):
        Trap.sprung = True


def test_objects_are_refused_without_unpickling(tmp_path):
    np.savez(tmp_path / "a.npz", raw=np.array([Trap(), None], dtype=object))
    with pytest.raises(ValueError, match=r"a\.npz.*Object arrays"):
        load_scan(tmp_path / "a.npz")
    assert not Trap.sprung
    with np.load(tmp_path / "a.npz", allow_pickle=True) as file:
        assert file["raw"][1] is None
    assert Trap.sprung, "the trap works"


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize("values", [DATA + 1j, DATA > 0, "abc", b"abc", np.array([b"ab", b"cd"])])
@pytest.mark.parametrize("name", ["g", "sound_speed"])
def test_what_is_no_real_number_is_refused(tmp_path, suffix, values, name):
    arrays = {"pressure": DATA, name: values}
    with pytest.raises(ValueError, match=rf"a\{suffix}.*{name} has dtype .* expected real numbers"):
        load_scan(write(tmp_path / f"a{suffix}", **arrays))


def test_missing_files_folders_and_suffixes(tmp_path):
    for path in (tmp_path / "nowhere.npz", tmp_path):
        with pytest.raises(FileNotFoundError, match=path.name):
            load_scan(path)
    np.save(tmp_path / "a.npy", DATA)
    with pytest.raises(ValueError, match=r"a\.npy: expected a name ending in \.npz, \.h5"):
        load_scan(tmp_path / "a.npy")


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_missing_data_are_explained(tmp_path, suffix):
    path = write(tmp_path / f"a{suffix}", radii=np.arange(3.0), detectors=POSITIONS, Pressure=DATA)
    with pytest.raises(ValueError, match=r"holds \['Pressure', 'detectors', 'radii'\].*pressure"):
        load_scan(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "content", [b"", b"time,pressure\n1,2\n", b"PK\x03\x04", b"\x89HDF\r\n\x1a\n"]
)
def test_other_files_are_refused(tmp_path, suffix, content):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"cannot read .*a\{suffix}"):
        load_scan(path)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    arrays = {"pressure": DATA, "detectors": POSITIONS, "fs": np.array(2.5)}
    compressed = folder / "compressed.npz"
    np.savez_compressed(compressed, **arrays)
    return {
        "plain": write(folder / "plain.npz", **arrays),
        "compressed": compressed,
        "hdf5": write(folder / "hdf5.h5", **arrays),
    }


def is_whole(scan):
    return (
        same(scan.data, DATA)
        and set(scan.known) == {"detectors", "sampling_rate"}
        and same(scan.known["detectors"], POSITIONS)
        and float(scan.known["sampling_rate"]) == 2.5
    )


@pytest.mark.parametrize("kind", ["plain", "compressed", "hdf5"])
@given(kept=st.floats(0, 1, exclude_max=True))
@settings(deadline=None, max_examples=40)
def test_truncated_files_are_refused(files, kind, kept):
    content = files[kind].read_bytes()
    path = files[kind].with_stem("cut")
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(ValueError, match=r"cannot read .*cut"):
        load_scan(path)


@pytest.mark.parametrize("kind", ["plain", "compressed"])
@given(place=st.floats(0, 1, exclude_max=True), change=st.integers(1, 255))
@settings(deadline=None, max_examples=150)
def test_a_wrong_byte_in_npz_is_refused_or_changes_nothing(files, kind, place, change):
    content = bytearray(files[kind].read_bytes())
    content[int(place * len(content))] ^= change
    path = files[kind].with_stem("flipped")
    path.write_bytes(content)
    try:
        scan = load_scan(path)
    except ValueError as error:
        assert "flipped" in str(error)
    else:
        assert is_whole(scan)


@given(place=st.floats(0, 1, exclude_max=True), change=st.integers(1, 255))
@settings(deadline=None, max_examples=150)
def test_a_wrong_byte_in_hdf5_is_refused_or_gives_real_numbers(files, place, change):
    """HDF5 of others carries no checksum: a wrong digit cannot be told, but nothing else passes."""
    content = bytearray(files["hdf5"].read_bytes())
    content[int(place * len(content))] ^= change
    path = files["hdf5"].with_stem("flipped")
    path.write_bytes(content)
    try:
        scan = load_scan(path)
    except ValueError as error:
        assert "flipped" in str(error)
    else:
        assert all(array.dtype.kind in "fiu" for array in (scan.data, *scan.known.values()))


@pytest.mark.parametrize("kind", ["plain", "compressed", "hdf5"])
def test_the_undamaged_files_are_whole(files, kind):
    assert is_whole(load_scan(files[kind]))


def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path, monkeypatch):
    path = write(tmp_path / "a.npz", raw=DATA)

    def refused(*arguments, **options):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(np, "load", refused)
    with pytest.raises(PermissionError, match="Permission denied"):
        load_scan(path)
