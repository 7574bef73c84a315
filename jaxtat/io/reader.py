"""Reading files of others in a process of its own, with limits of memory and time.

jaxtat's side of `child`: what comes from there is text and numbers, never an object, and no more of
it than the caller allows. A process that has read a file is kept for the next one; while frames of
a recording may still be wanted, it has that file open, so that single frames cost no start.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
import weakref
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any, ClassVar

import numpy as np

from ..base.messages import name_of
from .child import fill, receive, send
from .file_contents import FileContents
from .frames import LazyFrames
from .limits import Allowance, refusing

_PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from jaxtat.io.child import serve; serve()"
)
MEMORY = 3 * 2**28  # [byte], which reading may take beside the array, and the process itself
SECONDS = 10  # of the processor, until the next part of an array is there
_TYPES = "fiubcS"  # NumPy's kinds of what is handed back
_SLOW = ("SIGPROF", "SIGALRM")  # by which the process ends itself


def read_file(task: str, path: Path, allowance: Allowance, **arguments: Any) -> FileContents:
    """What a function of `formats.TASKS` hands back about a file.

    Args:
        task: name of the function.
        path: of the file.
        allowance: the memory that the arrays may take.
        arguments: of the function, which JSON can hold.

    Raises:
        ValueError: with the reason, if the file is refused, or if it ends the process that reads
            it, takes too much of its memory or too long.
    """
    limits = {"memory": MEMORY, "seconds": SECONDS}
    request = {"task": task, "path": str(path.absolute()), **limits, **arguments}
    process = _Process.idle()
    header, arrays = process.ask(request, allowance)
    if header["frames"] is None:
        process.release()
        return FileContents(header["about"], arrays)
    dtype, shape = _checked(*header["frames"])
    allowance.require("a frame", int(np.prod(shape[1:], dtype=float)) * dtype.itemsize)
    frames = LazyFrames(shape, dtype.newbyteorder("="), _Recording(process, request, path))
    return FileContents(header["about"], arrays, frames)


class _Recording:
    """Frames of an open file, which is opened again if the process that reads it has ended."""

    def __init__(self, process: "_Process", request: dict[str, Any], path: Path):
        self._request, self._path, self._stamp = request, path.absolute(), _stamp(path)
        self._lock = Lock()
        self._keep(process)

    def _keep(self, process: "_Process") -> None:
        self._process, self._end = process, weakref.finalize(self, process.close_file)

    def __call__(self, numbers: np.ndarray) -> np.ndarray:
        if _stamp(self._path) != self._stamp:
            name = name_of(self._path)
            raise ValueError(f"{name} has changed since it was loaded: load it again.")
        with self._lock, refusing(f"cannot read {name_of(self._path)}: "):
            if not (self._end.alive and self._process.is_alive):
                process = _Process.idle()
                process.ask(self._request, Allowance(sys.maxsize))
                self._keep(process)
            try:
                wanted = {"frames": numbers.tolist()}
                return self._process.ask(wanted, Allowance(sys.maxsize))[1]["frames"]
            except BaseException:
                self._end.detach()  # an error closes the file
                raise


def _stamp(path: Path) -> tuple[int, int]:
    status = os.stat(path)
    return status.st_size, status.st_mtime_ns


class _Refused(ValueError):
    """The process has refused a file with a reason, and is ready for another."""


class _Process:
    """A process that runs `child.serve`."""

    _idle: ClassVar[list["_Process"]] = []

    def __init__(self) -> None:
        root = str(Path(__file__).resolve().parents[2])
        places = json.dumps([root, *(place for place in sys.path if place)])
        # without the user's settings of Python, and out of reach of Ctrl-C
        self._popen = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _PROGRAM, places],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,
        )
        self._owner = os.getpid()

    @classmethod
    def idle(cls) -> "_Process":
        """A process that waits for a file; of a fork its own, not one of its parent."""
        while cls._idle:
            process = cls._idle.pop()
            if process.is_alive:
                return process
        return cls()

    @property
    def is_alive(self) -> bool:
        return self._owner == os.getpid() and self._popen.poll() is None

    def ask(
        self, request: dict[str, Any], allowance: Allowance
    ) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Send a request; what the file says, and its arrays."""
        try:
            send(self._pipe("stdin"), request)
            header = self._next()
            arrays = {
                str(name): self._array(str(name), allowance, *sizes)
                for name, sizes in header["arrays"].items()
            }
        except _Refused:
            self.release()
            raise
        except BaseException:
            self.end()  # which of its answers would come next is not known
            raise
        return header, arrays

    def close_file(self) -> None:
        """Close the open file: no more of its frames are needed."""
        if self.is_alive:
            send(self._pipe("stdin"), None)
            self.release()

    def release(self) -> None:
        """The process may read another file."""
        if hasattr(os, "fork"):
            self._idle.append(self)
        else:
            self.end()

    def _array(
        self, name: str, allowance: Allowance, kind: str, sizes: list[int], transposed: bool
    ) -> np.ndarray:
        dtype, shape = _checked(kind, sizes)
        allowance.take(name, int(np.prod(shape, dtype=float)) * dtype.itemsize)
        array = np.empty(shape, dtype)
        while (box := self._next()["box"]) is not None:
            part = tuple(slice(int(start), int(stop)) for start, stop in box)
            into = array.reshape(-1)[part] if len(part) == 1 else array[part]
            piece = into if into.flags.c_contiguous else np.empty(into.shape, dtype)
            if not fill(self._pipe("stdout"), piece.reshape(-1).view(np.uint8)):
                raise ValueError(self._reason())
            into[...] = piece
        array = array.astype(dtype.newbyteorder("="), copy=False)  # JAX takes no foreign byte order
        return array.T if transposed else array

    def _next(self) -> dict[str, Any]:
        answer = receive(self._pipe("stdout"))
        if answer is None:
            raise ValueError(self._reason())
        if "refused" in answer:
            raise _Refused(answer["refused"])
        return answer

    def _reason(self) -> str:
        """Why a process ended without an answer."""
        code = self._popen.wait()
        try:
            name = signal.Signals(code - 128).name
        except ValueError:
            return f"it is damaged: reading it ended with code {code}"
        if name in _SLOW:
            return "it is damaged: reading it took too long"
        return f"it is damaged: reading it ended with signal {code - 128} ({name})"

    def end(self) -> None:
        if self.is_alive and hasattr(os, "killpg"):
            os.killpg(self._popen.pid, signal.SIGKILL)
        elif self.is_alive:
            self._popen.kill()
        with suppress(OSError), self._popen:  # closes its pipes and waits
            pass

    def _pipe(self, name: str) -> Any:
        return getattr(self._popen, name)


@atexit.register
def _end_all() -> None:
    while _Process._idle:
        _Process._idle.pop().end()


def _checked(kind: str, sizes: list[int]) -> tuple[np.dtype, tuple[int, ...]]:
    """Type and shape as the process says, or ValueError: a file may have made it say anything."""
    dtype, shape = np.dtype(kind[:8]), tuple(int(size) for size in sizes)
    if dtype.kind not in _TYPES or min(shape, default=0) < 0:
        raise ValueError(f"it is damaged: an array of type {kind!r:.20} and shape {sizes!r:.60}")
    return dtype, shape
