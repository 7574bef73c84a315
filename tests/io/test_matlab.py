"""MATLAB files against scipy's, and what is in them beside matrices of real numbers."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
import scipy.io
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scan_writers import write_matlab73

from jaxtat.io import load_scan

DATA = np.random.default_rng(3).standard_normal((6, 9))
POSITIONS = np.random.default_rng(4).standard_normal((6, 2))
DTYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")


@given(
    values=st.sampled_from(DTYPES).flatmap(
        lambda dtype: arrays.arrays(dtype, st.tuples(st.integers(2, 4), st.integers(5, 7)))
    ),
    packed=st.booleans(),
)
@settings(deadline=None, max_examples=40)
def test_numbers_are_those_that_scipy_wrote(tmp_path_factory, values, packed):
    path = tmp_path_factory.getbasetemp() / "any.mat"
    others = {"note": "text", "list": np.array([1, "a"], object), "a_long_name_of_no_use": 3}
    scipy.io.savemat(path, {**others, "raw": values}, do_compression=packed)
    found = load_scan(path).data
    assert found.dtype == values.dtype
    assert np.array_equal(np.asarray(found), values, equal_nan=values.dtype.kind == "f")


def element(kind, content, order="<"):
    return struct.pack(f"{order}II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(name, shape, stored, content, kind=6, order="<"):
    """A matrix as an element, with any claims."""
    parts = element(6, struct.pack(f"{order}II", kind, 0), order)
    parts += element(5, struct.pack(f"{order}{len(shape)}i", *shape), order)
    parts += element(1, name.encode(), order) + element(stored, content, order)
    return element(14, parts, order)


def write(path, *elements, order="<"):
    mark = b"\0\1IM" if order == "<" else b"\1\0MI"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + mark + b"".join(elements))
    return path


@pytest.mark.parametrize("order", ["<", ">"])
def test_doubles_stored_as_small_integers_in_both_byte_orders(tmp_path, order):
    values = np.arange(54).reshape(6, 9)
    content = values.T.astype(f"{order}i2").tobytes()
    path = write(tmp_path / "a.mat", matrix("raw", (6, 9), 3, content, order=order), order=order)
    assert np.array_equal(scipy.io.loadmat(path)["raw"], values)
    found = load_scan(path).data
    assert found.dtype == np.dtype(float)
    assert np.array_equal(np.asarray(found), values)


@pytest.mark.parametrize(
    "value",
    [
        {"field": DATA},
        np.array([DATA, 1], object),
        scipy.sparse.csc_array(np.eye(5)),
        "pressure",
        DATA > 0,
        DATA * 1j,
    ],
)
def test_what_is_no_matrix_of_real_numbers_is_refused(tmp_path, value):
    scipy.io.savemat(tmp_path / "a.mat", {"raw": value})
    with pytest.raises(ValueError, match=r"raw is a .*, expected real numbers"):
        load_scan(tmp_path / "a.mat")


NUMBERS = DATA.T.tobytes()


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (matrix("raw", (6, 10**8), 9, NUMBERS), "raw has 432 bytes of type 9 for"),
        (matrix("raw", (6, 8), 9, NUMBERS), "raw has 432 bytes of type 9 for"),
        (matrix("raw", (6, -9), 9, NUMBERS), "raw claims the shape"),
        (matrix("raw", (6,), 9, NUMBERS), "raw claims the shape"),
        (matrix("raw", (6, 9), 10, NUMBERS), "raw has 432 bytes of type 10"),
        (matrix("raw", (6, 9), 9, NUMBERS, kind=77), "raw is a matrix of an unknown kind"),
        (matrix("raw", (1,) * 40, 9, NUMBERS), "a part of type 5 claims 160 bytes"),
        (matrix("raw", (6, 9), 9, NUMBERS)[:-9], "cut off|ends after"),
        (element(9, NUMBERS), "type 9"),
    ],
)
def test_false_claims_are_refused_before_any_memory_is_given(tmp_path, packed, content, message):
    if packed:
        small = zlib.compress(content)
        content = struct.pack("<II", 15, len(small)) + small
    path = write(tmp_path / "a.mat", content)
    tracemalloc.start()
    with pytest.raises(ValueError, match=f"cannot read .*a.mat: .*({message})"):
        load_scan(path)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_an_element_that_claims_more_than_the_file_is_refused(tmp_path):
    content = struct.pack("<II", 14, 2**31) + matrix("raw", (6, 9), 9, NUMBERS)[8:]
    with pytest.raises(ValueError, match=r"an element claims 2147483648 bytes, .* are left"):
        load_scan(write(tmp_path / "a.mat", content))


def test_what_inflates_to_much_needs_leave(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"raw": np.zeros((100, 50_000))}, do_compression=True)
    assert path.stat().st_size < 1e5
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"raw takes 40000000 bytes.*allow more"):
        load_scan(path, max_bytes=10**7)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    assert load_scan(path, max_bytes=4 * 10**7).data.shape == (100, 50_000)
    assert tracemalloc.get_traced_memory()[1] < 1.3e8  # three times as much, as documented
    tracemalloc.stop()


def test_damage_in_a_name_is_told(tmp_path):
    """A matrix that is not wanted any more because its name is damaged has its checksum too."""
    path = tmp_path / "a.mat"
    content = matrix("fs", (1, 1), 9, struct.pack("<d", 4e7))
    small = bytearray(zlib.compress(content, 0))
    small[small.index(b"fs")] ^= 1
    damaged = struct.pack("<II", 15, len(small)) + small
    with pytest.raises(ValueError, match="cannot read"):
        load_scan(write(path, matrix("raw", (6, 9), 9, NUMBERS), damaged))


def test_version_7_3_has_its_axes_reversed(tmp_path):
    frames = np.random.default_rng(5).standard_normal((6, 9, 4))
    path = write_matlab73(tmp_path / "a.mat", raw=frames, positions=POSITIONS, fs=4e7)
    scan = load_scan(path)
    assert scan.data.shape == (4, 6, 9)
    assert np.array_equal(np.asarray(scan.data), np.moveaxis(frames, -1, 0))
    assert np.array_equal(scan.known["detectors"], POSITIONS)
    assert scan.known["sampling_rate"].shape == ()
    turned = write_matlab73(tmp_path / "b.mat", raw=DATA.T, t=np.arange(9.0))
    assert np.array_equal(load_scan(turned).data, DATA)


def test_texts_of_version_7_3_are_no_data(tmp_path):
    import h5py

    path = write_matlab73(tmp_path / "a.mat", raw=np.ones((2, 9), np.uint16))
    with h5py.File(path, "a") as file:
        file["raw"].attrs["MATLAB_class"] = np.bytes_("char")
    with pytest.raises(ValueError, match="raw is a char, expected real numbers"):
        load_scan(path)


def test_version_7_3_is_known_by_its_marks_where_the_header_is_not_matlab_s(tmp_path):
    path = write_matlab73(tmp_path / "a.mat", raw=DATA, positions=POSITIONS)
    path.write_bytes(bytes(512) + path.read_bytes()[512:])
    scan = load_scan(path)
    assert scan.about["format"] == "MATLAB 7.3"
    assert np.array_equal(scan.data, DATA)
    assert np.array_equal(scan.known["detectors"], POSITIONS)


def test_hdf5_of_another_program_under_matlab_s_name_is_read(tmp_path):
    import h5py

    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["raw"], file["positions"] = DATA, POSITIONS
    scan = load_scan(tmp_path / "a.mat")
    assert scan.about["format"] == "HDF5"
    assert np.array_equal(scan.data, DATA)


def test_what_a_struct_holds_is_said(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"scan": {"raw": DATA, "fs": 4e7}, "note": "text"})
    message = r"it holds scan \(a struct of raw, fs\), note \(a char\), expected data under"
    with pytest.raises(ValueError, match=message):
        load_scan(tmp_path / "a.mat")
