"""Plain HDF5: claims, links, filters and pieces that are not what they should be."""

import zlib

import h5py
import numpy as np
import pytest

from jaxtat.io import load_scan
from jaxtat.io.frames import LazyFrames
from jaxtat.io.hdf5 import _checksums

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
    with pytest.raises(ValueError, match="a piece of raw takes 4000000 bytes"):
        load_scan(tmp_path / "a.h5", max_bytes=10**6)
    assert load_scan(tmp_path / "a.h5").data.shape == (100, 50_000)


@pytest.mark.parametrize("frames", [1, 2])
def test_a_piece_with_more_than_its_bytes_is_refused(tmp_path, frames):
    """HDF5 itself would inflate all of it."""
    shape = (2, 6, 9) if frames == 2 else (6, 9)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("raw", shape, "f8", chunks=shape, compression="gzip")
        data.id.write_direct_chunk((0,) * len(shape), zlib.compress(bytes(200_000)))
    with pytest.raises(ValueError, match=r"the piece at .* has more than its"):
        np.asarray(load_scan(tmp_path / "a.h5").data)


@pytest.mark.parametrize(
    "options", [{"compression": "gzip", "chunks": (1, 6, 9)}, {"chunks": (1, 5, 5)}]
)
def test_a_missing_piece_is_refused(tmp_path, options):
    """HDF5 itself would give zeros."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("raw", (4, 6, 9), "f8", **options)
        data[:3] = DATA[:3]
    scan = load_scan(tmp_path / "a.h5")
    assert np.array_equal(scan.frame(2), DATA[2])
    with pytest.raises(ValueError, match=r"the piece at \(3, 0, 0\) is missing"):
        scan.frame(3)


def twice_packed(path):
    """Pieces that gzip went over two times, which could give a million times their size."""
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_chunk((1, 6, 9))
    creation.set_deflate(4)
    creation.set_deflate(4)
    with h5py.File(path, "w") as file:
        space = h5py.h5s.create_simple(DATA.shape)
        h5py.h5d.create(file.id, b"raw", h5py.h5t.NATIVE_DOUBLE, space, creation)
        file["raw"][...] = DATA
    return path


@pytest.mark.parametrize("options", [{"compression": "lzf"}, {"scaleoffset": 3}, "twice"])
def test_other_filters_are_refused(tmp_path, options):
    path = tmp_path / "a.h5"
    if options == "twice":
        twice_packed(path)
    else:
        write(path, chunks=(1, 6, 9), **options)
    with pytest.raises(ValueError, match=r"raw has filters .*expected gzip or none"):
        load_scan(path)


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
    with pytest.raises(ValueError, match=r"the piece at \(1, 0, 0\) is missing or damaged"):
        scan.frame(1)


@pytest.mark.parametrize("size", [1, 2, 3, 8, 1001, 2**18 + 1])
@pytest.mark.parametrize("value", [None, 0, 255])
def test_checksums_are_those_of_hdf5(tmp_path, size, value):
    """Of noise, of zeros, and of ones, whose sums are multiples of 2^16 - 1."""
    noise = np.random.default_rng(size).integers(0, 256, size, np.uint8)
    content = noise if value is None else np.full(size, value, np.uint8)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("raw", data=content, chunks=(size,), fletcher32=True)
        stored = data.id.read_direct_chunk((0,))[1]
    assert _checksums(content.tobytes())[0] == int.from_bytes(stored[-4:], "little")


def test_numbers_of_an_unusual_kind_are_refused(tmp_path):
    """Of 12 bits in 16, for instance, which only the library can tell apart."""
    kind = h5py.h5t.STD_U16LE.copy()
    kind.set_precision(12)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        h5py.h5d.create(file.id, b"raw", kind, h5py.h5s.create_simple((6, 9)))
        file["raw"][...] = 1
    with pytest.raises(ValueError, match="raw has numbers of an unusual kind, expected uint16"):
        load_scan(tmp_path / "a.h5")
