"""Frames that come, wait, are dropped or cannot be, and what is written of them."""

import io
import os
import signal
import subprocess
import sys
import threading
import time

import h5py
import numpy as np
import pytest

from jaxtat.cli import main
from jaxtat.streams import (
    Folder,
    GrowingFile,
    frames_of_bytes,
    frames_of_folder,
    live,
    stream,
)
from jaxtat.streams.sources import FrameQueue

SHAPE, TYPE = (3, 4), np.dtype(np.uint16)
FRAMES = np.arange(36, dtype=TYPE).reshape(3, *SHAPE)


class KeptImages:
    """A sink that keeps what it was given."""

    def __init__(self):
        self.images, self.closed = {}, False

    def write(self, number, image):
        self.images[number] = np.array(image)

    def close(self):
        self.closed = True


def read(data, more=lambda: False):
    return frames_of_bytes(io.BytesIO(data), SHAPE, TYPE, more)


def test_bytes_are_frames_in_a_row():
    assert np.array_equal(list(read(FRAMES.tobytes())), FRAMES)
    assert list(read(b"")) == []


def test_an_input_that_stops_within_a_frame_says_so_behind_the_others():
    frames = read(FRAMES.tobytes()[:-5])
    assert np.array_equal([next(frames), next(frames)], FRAMES[:2])
    with pytest.raises(ValueError, match="in the middle of a frame: 19 of 24 bytes"):
        next(frames)


def test_a_file_that_grows_is_followed(tmp_path):
    path, chances = tmp_path / "frames", iter([True] * 50)
    path.write_bytes(FRAMES[0].tobytes() + b"12345")

    def more():
        if next(chances, False):
            with path.open("ab") as grown:
                grown.write(FRAMES[1].tobytes() if path.stat().st_size < 40 else b"")
            return True
        return False

    with path.open("rb", buffering=0) as file:
        frames = frames_of_bytes(file, SHAPE, TYPE, more)
        assert np.array_equal(next(frames), FRAMES[0])
        assert next(frames).tobytes() == b"12345" + FRAMES[1].tobytes()[:-5]


def test_a_folder_gives_frames_and_stacks_by_name(tmp_path):
    np.save(tmp_path / "b.npy", FRAMES[1:])
    np.save(tmp_path / "a.npy", FRAMES[0])
    (tmp_path / "c.npy").write_bytes(b"no array")
    *frames, error = frames_of_folder(tmp_path, SHAPE, lambda: False)
    assert np.array_equal(frames, FRAMES)
    assert isinstance(error, ValueError) and "c.npy" in str(error)


def with_header(path, text):
    """A .npy file of this header."""
    text = text.ljust(117) + "\n"
    path.write_bytes(b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text.encode() + bytes(96))


def test_files_that_cannot_be_frames_are_left_out_with_a_line_each(tmp_path):
    np.save(tmp_path / "a.npy", FRAMES[0])
    with_header(tmp_path / "b.npy", "{'descr': '<u2', 'fortran_order': False, 'shape': (3, 4")
    with_header(tmp_path / "c.npy", "{'descr': '<u2', 'fortran_order': False, 'shape': (3, 4), }$")
    os.mkfifo(tmp_path / "d.npy")
    with_header(
        tmp_path / "e.npy", "{'descr': '<f8', 'fortran_order': False, 'shape': (600000, 625000), }"
    )
    os.truncate(tmp_path / "e.npy", 128 + 600000 * 625000 * 8)  # 3 TB that take no room
    np.save(tmp_path / "f.npy", FRAMES[1, :2])
    np.save(tmp_path / "g.npy", np.array([{}]), allow_pickle=True)
    (tmp_path / "h.npy").mkdir()
    (tmp_path / "i.npy").symlink_to(tmp_path / "nothing")
    np.save(tmp_path / "j.npy", FRAMES[2])
    first, *errors, last = frames_of_folder(tmp_path, SHAPE, lambda: False)
    assert np.array_equal([first, last], FRAMES[[0, 2]])
    assert all(isinstance(error, ValueError) and "\n" not in str(error) for error in errors)
    named = [name for error in errors for name in "abcdefghij" if f"{name}.npy" in str(error)]
    assert named == list("bcdefghi")


def test_a_file_that_is_not_whole_yet_is_waited_for(tmp_path):
    whole, chances = io.BytesIO(), iter([True, True, False])
    np.save(whole, FRAMES[0])
    path = tmp_path / "a.npy"
    path.write_bytes(whole.getvalue()[:-3])

    def more():
        going_on = next(chances)
        if not going_on:
            path.write_bytes(whole.getvalue())
        return going_on

    (frame,) = frames_of_folder(tmp_path, SHAPE, more)
    assert np.array_equal(frame, FRAMES[0])


def test_the_oldest_are_dropped_where_there_is_no_room():
    waiting = FrameQueue(iter(range(10)), room=3, drop=True)
    while not waiting._ended:
        time.sleep(0.01)
    assert waiting.take(8) == [(7, 7)] and waiting.dropped == 7
    assert waiting.take(2) == [(8, 8), (9, 9)] and waiting.take(2) == []


def test_or_the_reader_waits():
    read = []
    waiting = FrameQueue((read.append(k) or k for k in range(10)), room=3, drop=False)
    taken = []
    while part := waiting.take(1):
        taken += part
        assert len(read) <= len(taken) + 5
    assert [number for number, _ in taken] == list(range(10)) and waiting.dropped == 0


@pytest.fixture(scope="module")
def small(arc):
    return live(arc, rule=1e-4)


def frames_for(to_images, n):
    return np.random.default_rng(0).random((n, *to_images.frame_shape))


def test_every_frame_becomes_its_image(small):
    frames, sink = frames_for(small, 19), KeptImages()
    found = stream(small, iter(frames), sink, dtype=float)
    assert str(found) == "19 images, 0 frames dropped, 0 refused"
    assert sink.closed and list(sink.images) == list(range(19))
    wanted = np.asarray(small(frames))
    for number, image in sink.images.items():
        assert np.abs(image - wanted[number]).max() < 1e-5 * np.abs(wanted).max()


def test_frames_that_cannot_be_are_left_out_and_the_stream_goes_on(small):
    frames, sink, said = list(frames_for(small, 4)), KeptImages(), []
    frames[1] = frames[1] * np.nan
    frames[2] = np.zeros((2, 2))
    found = stream(small, iter(frames), sink, dtype=float, note=said.append)
    assert found.images == 2 and found.refused == 2 and list(sink.images) == [0, 3]
    assert said[0].startswith("frame 1 is left out: frames hold") and "NaN" in said[0]
    assert said[1].startswith("frame 2 is left out: frames have shape (2, 2) and type float64")


def test_a_damaged_file_is_a_line_that_names_it(small, tmp_path):
    for k, frame in enumerate(frames_for(small, 2)):
        np.save(tmp_path / f"{k}.npy", frame)
    damaged = tmp_path / "0.npy"
    damaged.write_bytes(damaged.read_bytes()[:500])
    sink, said = KeptImages(), []
    frames = frames_of_folder(tmp_path, small.frame_shape, lambda: False)
    counts = stream(small, frames, sink, dtype=float, note=said.append)
    assert counts.refused == 1 and list(sink.images) == [1]
    (line,) = said
    assert line.startswith("frame 0 is left out: cannot read ") and "\n" not in line
    assert f"{tmp_path.name}/0.npy: " in line


READER = """
import h5py
with h5py.File("images.h5") as file:
    print(file["image"][:, 3, 4].tolist(), file["frames"][:].tolist())
"""


def test_another_program_reads_the_file_while_it_is_written(small, tmp_path, arc):
    frames, path, seen = frames_for(small, 3), tmp_path / "images.h5", []
    sink = GrowingFile(path, arc.grid, {"alpha": 1e-4})

    def slowly():
        yield frames[0]
        while len(seen) < 5 or "[0]" not in seen[-1]:  # in the moment of writing it is refused
            reader = [sys.executable, "-c", READER]
            program = subprocess.run(reader, cwd=tmp_path, capture_output=True, text=True)
            seen.append(program.stdout)
        yield from frames[1:]

    stream(small, slowly(), sink, dtype=float)
    with h5py.File(path) as file:
        images, wanted = file["image"][:], np.asarray(small(frames))
        assert np.abs(images - wanted).max() < 1e-5 * np.abs(wanted).max()
        assert seen[-1] == f"{images[:1, 3, 4].tolist()} [0]\n"
        assert file["frames"][:].tolist() == [0, 1, 2]
        assert np.array_equal(file["x1"], arc.grid.x1)
    with pytest.raises(ValueError, match="needs a new file"):
        GrowingFile(path, arc.grid, {})


def test_a_folder_has_a_file_for_each(tmp_path):
    sink = Folder(tmp_path / "out", np.save, ".npy")
    sink.write(7, FRAMES[0])
    assert np.array_equal(np.load(tmp_path / "out" / "00000007.npy"), FRAMES[0])


@pytest.fixture
def scan_file(arc, tmp_path, monkeypatch):
    """Circular integrals of a ring, as a file, and raw frames of the same."""
    monkeypatch.chdir(tmp_path)
    from jaxtat import circular_arc, data_radii, disk, phantoms

    ring = circular_arc(1.3, 1.3, 32)
    radii = data_radii(ring, disk(0.8), 0.16)
    g = np.asarray(phantoms.Bells([[0.1, -0.15]], [0.6]).circular_integrals(ring, radii))
    np.savez("scan.npz", circular_integrals=g, radii=radii, detectors=ring.points)
    frames = np.stack([g, 2 * g, 3 * g])
    (tmp_path / "frames").write_bytes(frames.tobytes())
    return frames


LINE = "stream scan.npz --region-radius 0.8 --pixels 17"


def test_the_command_makes_an_image_of_every_frame(scan_file, capsys):
    assert main(f"{LINE} --from frames --out images.h5".split()) == 0
    assert "3 images, 0 frames dropped, 0 refused" in capsys.readouterr().out
    assert main(f"{LINE} --from frames --out folder --format png --quiet".split()) == 0
    assert sorted(os.listdir("folder")) == [f"{k:08d}.png" for k in range(3)]
    with h5py.File("images.h5") as file:
        images = file["image"][:]
        assert np.abs(images[2] - 3 * images[0]).max() < 1e-4 * np.abs(images).max()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--from nowhere --out a.h5", "no file or folder nowhere"),
        ("--from frames --type complex64 --out a.h5", "expected a type of real numbers"),
        ("--from frames --type much --out a.h5", "expected a type of real numbers"),
        ("--from frames --out scan.npz", "expected a folder, or a name ending in .h5"),
        ("--from frames --out no/where", "there is no folder"),
        ("--from frames --out x.tif", "a name ending in .h5 or .hdf5. The name of a new folder"),
        ("--from frames --format png --out a.h5", "--format png is of files in a folder"),
        ("--from frames --type uint8 --out a.h5", "in the middle of a frame"),
    ],
)
def test_what_cannot_be_is_one_line(scan_file, capsys, options, said):
    if "uint8" in options:
        with open("frames", "ab") as file:
            file.write(b"123")
    assert main(f"{LINE} {options} --quiet".split()) == 2
    (line,) = [x for x in capsys.readouterr().err.splitlines() if "note" not in x]
    assert said in line


@pytest.fixture
def started(scan_file, unoptimised):
    """The command on a pipe that goes on: three images, then silence."""
    program = subprocess.Popen(
        [sys.executable, "-m", "jaxtat", *LINE.split(), "--out", "images.h5"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert program.stdin is not None and program.stdout is not None
    program.stdin.write(scan_file.tobytes())
    program.stdin.flush()
    while written("images.h5") < 3 and program.poll() is None:
        time.sleep(0.1)
    yield program
    program.kill()
    program.communicate()


def written(path):
    """Images in a file that may not be there yet."""
    try:
        with h5py.File(path) as file:
            return len(file["frames"])
    except (OSError, KeyError):
        return 0


@pytest.fixture
def heeded(request):
    """A signal that is not ignored, as by nohup, under which `stream` goes on by design."""
    number = getattr(signal, request.param)
    before = signal.signal(number, signal.default_int_handler)
    yield number
    signal.signal(number, before)


@pytest.mark.parametrize("heeded", ["SIGINT", "SIGTERM", "SIGHUP"], indirect=True)
def test_each_signal_ends_with_everything_written(small, heeded):
    """Frames that were read become images, though no more come and the input goes on."""
    silent, sink = threading.Event(), KeptImages()

    def frames():
        yield from frames_for(small, 3)
        while not sink.images:  # what listens for signals is ready by then
            time.sleep(0.01)
        # to the main thread, as signals from outside: one to the process may come to any thread
        signal.pthread_kill(threading.main_thread().ident, heeded)
        silent.wait()

    before = signal.getsignal(heeded)
    found = stream(small, frames(), sink, dtype=float)
    silent.set()
    assert str(found) == "3 images, 0 frames dropped, 0 refused; interrupted"
    assert sink.closed and list(sink.images) == [0, 1, 2]
    assert signal.getsignal(heeded) is before


@pytest.mark.slow
def test_the_command_that_is_interrupted_ends_with_everything_written(started):
    started.send_signal(signal.SIGTERM)
    said, _ = started.communicate()
    assert started.returncode == 0, said
    assert b"3 images, 0 frames dropped, 0 refused; interrupted" in said
    assert written("images.h5") == 3


@pytest.mark.slow
def test_a_killed_stream_leaves_what_was_written(started):
    started.kill()
    started.wait()
    with h5py.File("images.h5") as file:
        images = file["image"][:]
        assert np.abs(images[2] - 3 * images[0]).max() < 1e-4 * np.abs(images).max()
        assert file["frames"][:].tolist() == [0, 1, 2]


FULL = """
import resource, sys
from jaxtat.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, (2**18, 2**18))
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_what_fits_is_written(scan_file, unoptimised):
    """A limit of the system on sizes of files stands for it."""
    np.concatenate([scan_file] * 100).tofile("many")
    words = f"{LINE} --from many --out images.h5 --no-cache --quiet".split()
    program = subprocess.run([sys.executable, "-c", FULL, *words], capture_output=True, text=True)
    assert program.returncode == 2
    (line,) = [x for x in program.stderr.splitlines() if "note" not in x]
    assert line == "jaxtat: error: cannot write images.h5: File too large"
    n = written("images.h5")
    assert 50 < n < 300
    with h5py.File("images.h5") as file:
        images = file["image"][: n - n % 3]
        assert np.abs(images[3:] - images[:-3]).max() < 1e-5 * np.abs(images).max()


@pytest.mark.parametrize("options", ["--from frames --out there.h5", "--from nowhere --out a.h5"])
def test_what_cannot_be_is_refused_before_the_scan_is_opened(scan_file, capsys, options):
    with open("there.h5", "wb") as file:
        file.write(b"of someone")
    with open("scan.npz", "wb") as file:
        file.write(b"no scan")
    assert main(f"{LINE} {options} --quiet".split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "there.h5: it is there already" in line or "no file or folder nowhere" in line
    with open("there.h5", "rb") as file:
        assert file.read() == b"of someone"
