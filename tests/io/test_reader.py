"""The process that opens files of others: what it may do, and that jaxtat goes on."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest

import jaxtat
from jaxtat.io import load_scan, reader
from jaxtat.io.child import fill

DATA = np.random.default_rng(3).standard_normal((40, 6, 9))


@pytest.fixture
def starts(monkeypatch):
    """The processes that were started."""
    started, start = [], subprocess.Popen

    def counted(*arguments, **options):
        started.append(arguments)
        return start(*arguments, **options)

    monkeypatch.setattr(reader.subprocess, "Popen", counted)
    return started


def recording(path, **options):
    with h5py.File(path, "w") as file:
        file.create_dataset("raw", data=DATA, **options)
    return path


def test_it_imports_neither_jax_nor_scipy():
    program = "import sys; from jaxtat.io import child, formats; print(*sys.modules)"
    root = Path(jaxtat.__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=root, capture_output=True, check=True, text=True
    )
    names = {name.partition(".")[0] for name in done.stdout.split()}
    assert {"numpy", "h5py"} <= names
    assert not {"jax", "jaxlib", "scipy", "equinox", "matplotlib"} & names


def test_single_frames_and_further_files_start_no_process(tmp_path, starts):
    load_scan(recording(tmp_path / "a.h5")).frame(0)
    del starts[:]
    scan = load_scan(tmp_path / "a.h5")
    assert all(np.array_equal(scan.frame(k), DATA[k]) for k in range(40))
    assert np.array_equal(scan.data[[5, -1, 3]], DATA[[5, -1, 3]])
    del scan
    for _ in range(3):
        load_scan(tmp_path / "a.h5").frame(7)
    assert starts == []


def test_frames_are_read_on_after_the_process_has_ended(tmp_path, starts):
    scan = load_scan(recording(tmp_path / "a.h5", chunks=(1, 6, 9), compression="gzip"))
    scan.frame(0)
    process = scan.data._read._process
    process.end()
    assert np.array_equal(scan.frame(1), DATA[1])
    second = scan.data._read._process
    second._owner = -1  # as after a fork, with the pipes of another process
    assert np.array_equal(scan.frame(2), DATA[2])
    assert scan.data._read._process not in (process, second)
    second._owner = os.getpid()
    second.end()


def test_threads_read_frames_of_one_recording_at_once(tmp_path):
    scan = load_scan(recording(tmp_path / "a.h5"))
    with ThreadPoolExecutor(4) as pool:
        frames = list(pool.map(scan.frame, range(40)))
    assert np.array_equal(frames, DATA)


def test_a_file_that_is_open_for_frames_may_be_written(tmp_path):
    scan = load_scan(recording(tmp_path / "a.h5"))
    scan.frame(0)
    recording(tmp_path / "a.h5")  # HDF5 would lock it
    assert np.array_equal(load_scan(tmp_path / "a.h5").frame(1), DATA[1])


@pytest.mark.parametrize("options", [{}, {"chunks": (40, 6, 9)}, {"chunks": (7, 5, 2)}])
def test_large_arrays_come_in_pieces(tmp_path, monkeypatch, options):
    """Boxes of whole pieces of the file, whatever their shape, give the array."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("raw", data=DATA.reshape(240, 9))
        file.create_dataset("r", data=np.arange(9.0))
        for name, shape in (("sound_speed", DATA.shape),):
            file.create_dataset(name, shape, data=1 + np.abs(DATA), **options)
    scan = load_scan(tmp_path / "a.h5")
    assert np.array_equal(scan.data, DATA.reshape(240, 9))
    assert np.array_equal(scan.known["sound_speed"], 1 + np.abs(DATA))


def test_files_that_crash_the_library_are_read_or_refused(data_folder):
    paths = sorted((data_folder / "hostile").glob("patato_*.hdf5"))
    if not paths:
        pytest.skip("the files are not here")
    for path in paths:
        try:
            load_scan(path).frame(0)
        except ValueError as error:
            assert len(str(error)) <= 300
            assert str(error).isprintable()


def test_what_the_process_says_is_not_trusted():
    for kind, sizes in (("|O", [2]), ("<f8", [-2]), ("<f8", [2, -1]), ("|V8", [1])):
        with pytest.raises(ValueError, match="it is damaged: an array of type"):
            reader._checked(kind, sizes)


def test_a_buffer_is_filled_from_short_reads(tmp_path):
    read, write = os.pipe()
    with os.fdopen(read, "rb", 0) as source, os.fdopen(write, "wb", 0) as sink:
        buffer = bytearray(6)
        sink.write(b"abc")
        sink.write(b"def")
        assert fill(source, buffer)
        assert bytes(buffer) == b"abcdef"
        sink.write(b"gh")
        sink.close()
        assert not fill(source, buffer)
