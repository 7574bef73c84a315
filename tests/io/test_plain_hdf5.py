"""Plain HDF5: claims, links, filters and pieces that are not what they should be."""

import zlib

import h5py
import numpy as np
import pytest

from jaxtat.io import load_scan
from jaxtat.io.frames import LazyFrames

DATA = np.random.default_rng(3).standard_normal((4, 6, 9))


def write(path, **options):
    with h5py.File(path, "w") as file:
        file.create_dataset("raw", data=DATA, **options)
    return path


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"chunks": (1, 6, 9)},
        {"chunks": (3, 4, 2), "compression": "gzip", "shuffle": True},
        {"chunks": (1, 6, 9), "compression": "gzip", "fletcher32": True, "maxshape": (None, 6, 9)},
        {"dtype": ">f8"},
    ],
)
def test_frames_are_read_when_asked_for(tmp_path, options):
    scan = load_scan(write(tmp_path / "a.h5", **options), max_bytes=1000)
    assert isinstance(scan.data, LazyFrames)
    assert scan.data.dtype.isnative
    assert np.array_equal(scan.data[1:3], DATA[1:3])
    assert np.array_equal(np.asarray(scan.data), DATA)


def test_a_file_that_changed_is_not_read_on(tmp_path):
    scan = load_scan(write(tmp_path / "a.h5"))
    write(tmp_path / "a.h5", chunks=(1, 2, 3))
    with pytest.raises(ValueError, match="has changed since it was loaded: load it again"):
        scan.frame(0)


def test_the_working_folder_may_change(tmp_path, monkeypatch):
    write(tmp_path / "a.h5")
    monkeypatch.chdir(tmp_path)
    scan = load_scan("a.h5")
    monkeypatch.chdir(tmp_path.parent)
    assert np.array_equal(scan.frame(1), DATA[1])


@pytest.mark.parametrize("options", [{}, {"chunks": (1, 100, 100)}])
def test_datasets_that_were_never_written_are_refused(tmp_path, options):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("raw", (10**9, 100, 100), "f8", **options)
    with pytest.raises(ValueError, match="raw claims 80000000000000 bytes, but the file holds 0"):
        load_scan(tmp_path / "a.h5")


def test_a_shape_that_packed_bytes_cannot_give_is_refused(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("raw", (10**6, 60, 90), "f8", chunks=(1, 60, 90), compression=4)
        data[0] = 0
    with pytest.raises(ValueError, match="raw claims 43200000000 bytes, but the file holds"):
        load_scan(tmp_path / "a.h5")


def test_what_inflates_to_much_needs_leave(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        zeros = np.zeros((100, 50_000))
        file.create_dataset("raw", data=zeros, chunks=(100, 5_000), compression="gzip")
    assert (tmp_path / "a.h5").stat().st_size < 1e5
    with pytest.raises(ValueError, match=r"raw takes 40000000 bytes.*allow more"):
        load_scan(tmp_path / "a.h5", max_bytes=10**7)
    assert load_scan(tmp_path / "a.h5").data.shape == (100, 50_000)


def bomb(nbytes):
    """Zeros packed by gzip, without ever being in memory."""
    pack = zlib.compressobj(9)
    start = pack.compress(b"0") + pack.flush(zlib.Z_FULL_FLUSH)
    block = pack.compress(bytes(2**24)) + pack.flush(zlib.Z_FULL_FLUSH)
    return start + nbytes // 2**24 * block + pack.flush()


@pytest.mark.parametrize("frames", [1, 2])
def test_a_piece_that_inflates_without_end_is_refused(tmp_path, frames):
    """HDF5 inflates all of it; the process that reads it may not."""
    shape = (2, 6, 9) if frames == 2 else (6, 9)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("raw", shape, "f8", chunks=shape, compression="gzip")
        data.id.write_direct_chunk((0,) * len(shape), bomb(2**32))
    assert (tmp_path / "a.h5").stat().st_size < 2**23
    with pytest.raises(ValueError, match=r"cannot read .*a\.h5: "):
        np.asarray(load_scan(tmp_path / "a.h5").data)


@pytest.mark.parametrize(
    "options", [{"compression": "gzip", "chunks": (1, 6, 9)}, {"chunks": (1, 5, 5)}]
)
def test_a_missing_piece_is_refused(tmp_path, options):
    """HDF5 itself would give zeros."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("raw", (4, 6, 9), "f8", **options)
        data[:3] = DATA[:3]
    with pytest.raises(ValueError, match=r"raw has only \d+ of its \d+ pieces in this file"):
        load_scan(tmp_path / "a.h5")


def twice_packed(path):
    """Pieces that gzip went over two times."""
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_chunk((1, 6, 9))
    creation.set_deflate(4)
    creation.set_deflate(4)
    with h5py.File(path, "w") as file:
        space = h5py.h5s.create_simple(DATA.shape)
        h5py.h5d.create(file.id, b"raw", h5py.h5t.NATIVE_DOUBLE, space, creation)
        file["raw"][...] = DATA
    return path


@pytest.mark.parametrize("options", [{"compression": "lzf"}, {"scaleoffset": 9}, "twice"])
def test_every_filter_of_the_library_is_read(tmp_path, options):
    path = tmp_path / "a.h5"
    if options == "twice":
        twice_packed(path)
    else:
        write(path, chunks=(1, 6, 9), **options)
    assert np.allclose(np.asarray(load_scan(path).data), DATA, rtol=0, atol=1e-9)


def test_a_piece_that_was_not_worth_packing_is_read(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("raw", (4, 6, 9), "f8", chunks=(1, 6, 9), compression="gzip")
        data[:3] = DATA[:3]
        data.id.write_direct_chunk((3, 0, 0), DATA[3].tobytes(), filter_mask=1)
    assert np.array_equal(np.asarray(load_scan(tmp_path / "a.h5").data), DATA)


@pytest.mark.parametrize("kind", ["link", "soft link", "external", "virtual"])
def test_no_other_file_is_read(tmp_path, kind):
    (tmp_path / "secret.bin").write_bytes(DATA[0].tobytes())
    write(tmp_path / "other.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        if kind == "link":
            file["raw"] = h5py.ExternalLink("other.h5", "/raw")
        elif kind == "soft link":
            file["raw"] = h5py.SoftLink("/elsewhere")
        elif kind == "external":
            place = [(tmp_path / "secret.bin", 0, h5py.h5f.UNLIMITED)]
            file.create_dataset("raw", (6, 9), "f8", external=place)
        else:
            layout = h5py.VirtualLayout((6, 9), "f8")
            layout[...] = h5py.VirtualSource(tmp_path / "other.h5", "raw", (4, 6, 9))[0]
            file.create_virtual_dataset("raw", layout)
    with pytest.raises(ValueError, match=r"raw has no numbers of its own|expected data under one"):
        load_scan(tmp_path / "a.h5")


def test_empty_datasets_and_strings_are_no_data(tmp_path):
    for value in (h5py.Empty("f8"), "some text", np.zeros((3, 0))):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["raw"] = value
        with pytest.raises(ValueError, match=r"cannot read .*a.h5: "):
            load_scan(tmp_path / "a.h5")


@pytest.mark.parametrize("stored", [0, 1, 2, 3, 4])
def test_a_piece_shorter_than_its_checksum_is_refused(tmp_path, stored):
    """One wrong byte in the index of the pieces; HDF5 itself takes the process down."""
    write(tmp_path / "a.h5", chunks=(1, 6, 9), compression="gzip", fletcher32=True)
    with h5py.File(tmp_path / "a.h5") as file:
        size = file["raw"].id.get_chunk_info(1).size
    content = (tmp_path / "a.h5").read_bytes()
    entry = (size.to_bytes(4, "little") + bytes(4)) + (1).to_bytes(8, "little")  # and its origin
    assert content.count(entry) == 1
    damaged = content.replace(entry, bytes([stored]) + bytes(3) + entry[4:])
    (tmp_path / "a.h5").write_bytes(damaged)
    scan = load_scan(tmp_path / "a.h5")
    assert np.array_equal(scan.frame(0), DATA[0])
    with pytest.raises(ValueError, match=r"cannot read .*a\.h5: it is damaged"):
        scan.frame(1)
    assert np.array_equal(scan.frame(2), DATA[2])  # the file is opened again


def test_numbers_of_an_unusual_kind_are_read(tmp_path):
    """Of 12 bits in 16, for instance, which only the library can tell apart."""
    kind = h5py.h5t.STD_U16LE.copy()
    kind.set_precision(12)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        h5py.h5d.create(file.id, b"raw", kind, h5py.h5s.create_simple((6, 9)))
        file["raw"][...] = 1
    assert np.array_equal(load_scan(tmp_path / "a.h5").data, np.ones((6, 9)))


def test_what_a_group_holds_is_said(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["scan/raw"], file["scan/fs"], file["empty"] = DATA, 4e7, h5py.SoftLink("/nothing")
        file["note"], file["values"] = "text", DATA
        file.create_group("struct").attrs["MATLAB_class"] = np.bytes_("struct")
    words = (
        r"it holds empty \(a link\), note \(text\), scan \(a group of fs, raw\), "
        r"struct \(a struct of nothing\), values, expected data under one of"
    )
    with pytest.raises(ValueError, match=words):
        load_scan(tmp_path / "a.h5")
