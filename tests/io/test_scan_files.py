"""All formats alike: round trips, and refusals of what is damaged, mislabelled or false."""

import os
import re
import shutil
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scan_writers import write_everything

from jaxtat.io import load_scan
from jaxtat.io.formats import FORMATS

NAMES = ("npz", "npy", "hdf5", "ipasc", "patato", "matlab 5", "matlab 7.3", "msot")
# every byte of these is under a checksum, or must be as it is
CHECKED = ("npz", "matlab 5")
SUFFIXES = (".npz", ".npy", ".h5", ".hdf5", ".mat", ".msot", ".dat", "")
RATE = 4e7
DATA = np.random.default_rng(0).integers(0, 2**16, (3, 5, 8), np.uint16)
POSITIONS = np.random.default_rng(1).standard_normal((5, 3))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """One scan in every format, and the content of its file."""
    paths = write_everything(tmp_path_factory.mktemp("scans"), DATA, POSITIONS, RATE)
    return {name: (path, path.read_bytes()) for name, path in paths.items()}


def damaged(files, name, content):
    """The file of that name with another content, beside what belongs to it."""
    path, _ = files[name]
    path.write_bytes(content)
    return path


def restore(files):
    for path, content in files.values():
        path.write_bytes(content)


def is_whole(scan, name):
    known = set() if name == "npy" else {"detectors", "sampling_rate"}
    return (
        np.array_equal(np.asarray(scan.data), DATA)
        and known <= set(scan.known)
        and (not known or np.array_equal(scan.known["detectors"], POSITIONS))
        and (not known or scan.known["sampling_rate"] == RATE)
    )


def test_the_formats_are_those_of_the_tests():
    assert len(FORMATS) == len(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_scan_comes_back_from_every_format(files, name):
    scan = load_scan(files[name][0])
    assert scan.kind == "pressure"
    assert is_whole(scan, name)
    assert np.array_equal(scan.data[1:], DATA[1:])
    assert np.array_equal(scan.frame(2), DATA[2])
    assert "format" in scan.about


@given(data=st.data())
@settings(deadline=None, max_examples=12)
def test_any_scan_comes_back_from_every_format(tmp_path_factory, data):
    shape = data.draw(arrays.array_shapes(min_dims=3, max_dims=3, max_side=5), "shape")
    counts = data.draw(arrays.arrays(np.uint16, shape), "data")
    finite = st.floats(-1e3, 1e3, allow_subnormal=False)
    positions = data.draw(arrays.arrays(float, (shape[1], 3), elements=finite), "positions")
    rate = float(data.draw(st.integers(1, 10**3), "megahertz")) * 1e6
    folder = tmp_path_factory.mktemp("any")
    if shape[1] == shape[2] or shape[1] in (2, 3):
        shape = None  # which axis is which cannot be told of all formats
    for name, path in write_everything(folder, counts, positions, rate).items():
        scan = load_scan(path)
        frames = np.asarray(scan.data).reshape(counts.shape)  # of one frame some drop the axis
        if shape is not None or name in ("ipasc", "patato", "msot"):
            assert np.array_equal(frames, counts), name
        if name != "npy" and positions.shape[0] not in (2, 3):
            assert np.array_equal(scan.known["detectors"], positions), name
            assert scan.known["sampling_rate"] == rate
    shutil.rmtree(folder)


@pytest.mark.parametrize("name", NAMES)
@given(kept=st.floats(0, 1, exclude_max=True))
@settings(deadline=None, max_examples=15)
def test_truncated_files_are_refused(files, name, kept):
    """What is read when asked for may be refused then, but not given.

    MATLAB 5 to 7 counts no matrices: a file that ends between two of them is one with fewer.
    """
    content = files[name][1]
    path = damaged(files, name, content[: int(kept * len(content))])
    try:
        scan = load_scan(path)
        frames = np.asarray(scan.data)
    except ValueError as error:
        assert re.search(rf"cannot read .*{path.name}", str(error))
    else:
        assert name == "matlab 5"
        assert np.array_equal(frames, DATA)
        assert not is_whole(scan, name)
    restore(files)


def flip(content, places):
    content = bytearray(content)
    for place, change in places:
        content[int(place * len(content))] ^= change
    return bytes(content)


flips = st.lists(
    st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1, max_size=3
)


@pytest.mark.parametrize("name", NAMES)
@given(places=flips)
@settings(deadline=None, max_examples=30)
def test_wrong_bytes_are_refused_or_give_a_scan_whose_parts_fit(files, name, places):
    """Where all is under a checksum, they change nothing; elsewhere a digit cannot be told."""
    path = damaged(files, name, flip(files[name][1], places))
    try:
        scan = load_scan(path, max_bytes=2**20)
        frames = np.asarray(scan.data)
    except ValueError as error:
        assert path.name in str(error)
    else:
        assert frames.dtype.kind in "fiu"
        assert frames.shape == scan.data.shape
        assert all(np.isfinite(value).all() for value in scan.known.values())
        if name in CHECKED:
            assert is_whole(scan, name)
    restore(files)


@given(place=st.floats(0, 1, exclude_max=True), change=st.integers(1, 255))
@settings(deadline=None, max_examples=20)
def test_a_wrong_digit_in_the_data_of_an_ipasc_file_of_ours_is_told(files, place, change):
    path, content = files["ipasc"]
    where = content.index(DATA[1].tobytes())
    digit = where + int(place * DATA[1].nbytes)
    damaged(
        files, "ipasc", content[:digit] + bytes([content[digit] ^ change]) + content[digit + 1 :]
    )
    scan = load_scan(path)
    assert np.array_equal(scan.frame(0), DATA[0])
    with pytest.raises(ValueError, match=r"cannot read .*a\.hdf5: "):
        scan.frame(1)
    restore(files)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_content_decides_and_not_the_name(files, tmp_path, name, suffix):
    path, content = files[name]
    (tmp_path / f"a{suffix}").write_bytes(content)
    if name == "msot":
        (tmp_path / "a.bin").write_bytes(path.with_suffix(".bin").read_bytes())
    assert is_whole(load_scan(tmp_path / f"a{suffix}"), name)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "content", [b"", b"time,pressure\n1,2\n", b"PK\3\4", b"\x89HDF\r\n\x1a\n", b"\x93NUMPY", b"<a"]
)
def test_other_files_are_refused(tmp_path, suffix, content):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"cannot read .*a{re.escape(suffix)}"):
        load_scan(path)


def test_missing_files_folders_and_pipes(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no file .*nowhere\.npz"):
        load_scan(tmp_path / "nowhere.npz")
    with pytest.raises(ValueError, match=f"{tmp_path.name} is a folder, expected a file"):
        load_scan(tmp_path)
    os.mkfifo(tmp_path / "a.npy")  # which would be waited for without end
    with pytest.raises(ValueError, match=r"a\.npy is a pipe or a device, expected a file"):
        load_scan(tmp_path / "a.npy")


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_left_behind(files, name):
    path, content = files[name]
    load_scan(path).frame(0)
    before = sorted(path.parent.iterdir()), len(os.listdir("/proc/self/fd"))
    load_scan(path).frame(0)
    for kept in (0.3, 0.6, 0.9):
        with pytest.raises(ValueError, match="cannot read"):
            load_scan(damaged(files, name, content[: int(kept * len(content))])).frame(0)
    assert (sorted(path.parent.iterdir()), len(os.listdir("/proc/self/fd"))) == before
    restore(files)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["npz", "matlab 5", "msot"])
def test_max_bytes_is_the_limit_of_what_is_read_at_once(files, name):
    path, _ = files[name]
    message = r"(takes|left).*of max_bytes = 100 .*allow more \(max_bytes=...\)"
    with pytest.raises(ValueError, match=message):
        load_scan(path, max_bytes=100)
    assert is_whole(load_scan(path, max_bytes=2**20), name)


def test_a_kind_that_is_not_there_is_refused(files):
    for name in NAMES:
        if name == "npy":
            assert load_scan(files[name][0], kind="circular_integrals").kind == "circular_integrals"
        else:
            with pytest.raises(ValueError, match=r"cannot read .*expected.* circular.integrals"):
                load_scan(files[name][0], kind="circular_integrals")


def test_a_file_that_may_not_be_read_is_not_called_damaged(files, monkeypatch):
    path, _ = files["npz"]

    def refused(*arguments, **options):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "open", refused)
    with pytest.raises(PermissionError, match="Permission denied"):
        load_scan(path)


def test_a_suffix_may_be_in_capitals(files, tmp_path):
    path = tmp_path / "A.NPZ"
    path.write_bytes(files["npz"][1])
    assert is_whole(load_scan(path), "npz")


@pytest.mark.parametrize("name", NAMES)
def test_little_more_than_the_scan_is_allocated(files, name):
    """Python's own and NumPy's memory, of a scan of 1.2 kB; buffers for reading are the rest."""
    path, _ = files[name]
    load_scan(path).frame(0)
    tracemalloc.start()
    load_scan(path).frame(0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6
