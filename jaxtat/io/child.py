"""The process that opens files of others: whatever a file does to it, jaxtat itself goes on.

A file of a few changed bytes can crash HDF5, keep it busy for ever or fill the memory, and no check
beforehand finds all of them. So `reader.read_file` starts a process that runs `serve`. It imports
NumPy and h5py, not JAX, and forks one more process for each file (where there is no fork, it reads
one file itself). That one has limits of memory and time, and hands back plain text and numbers.
"""

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from .file_contents import FileContents, StoredArray
from .formats import TASKS
from .limits import refusing

try:
    import resource
except ImportError:  # Windows
    resource = None

_LONGEST = 2**26  # [byte] of a message without its numbers
_WAITING = 20  # times longer than by the processor's clock a disk may take to answer


def serve() -> None:
    """Read one file after the other, as standard input says, until it ends."""
    requests, answers = os.fdopen(os.dup(0), "rb", 0), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDWR), 1)  # whatever a library prints there
    while (request := receive(requests)) is not None:
        process = os.fork() if hasattr(os, "fork") else 0
        if process == 0:
            try:
                _limit_memory(request.pop("memory"))
                _read(TASKS[request.pop("task")], request, requests, answers)
            except BaseException:
                os._exit(1)
            os._exit(0)
        code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        if code:
            os._exit(128 - code if code < 0 else code)


def _read(
    task: Callable[..., FileContents],
    request: dict[str, Any],
    requests: BinaryIO,
    answers: BinaryIO,
) -> None:
    """Hand back what one file holds, and then the frames that are wanted."""
    try:
        with refusing("", "it is damaged, or too large for the memory that files may take"):
            seconds = request.pop("seconds")
            _limit_time(seconds)
            contents = task(Path(request.pop("path")), **request)
            _hand_back(answers, contents, seconds)
            while contents.frames is not None and (numbers := receive(requests)):
                _limit_time(seconds)
                frames = StoredArray.of_frames(contents.frames, numbers["frames"])
                _hand_back(answers, FileContents(arrays={"frames": frames}), seconds)
    except (ValueError, PermissionError) as error:
        send(answers, {"refused": str(error)})


def _hand_back(answers: BinaryIO, contents: FileContents, seconds: float) -> None:
    """Send the texts and sizes, then each array in pieces, each with its place."""
    arrays = {
        name: array if isinstance(array, StoredArray) else StoredArray.of(array)
        for name, array in contents.arrays.items()
    }
    sizes = {
        name: [array.dtype.str, array.shape, array.transposed] for name, array in arrays.items()
    }
    frames = contents.frames
    of_frames = None if frames is None else [frames.dtype.str, frames.shape]
    send(answers, {"about": contents.about, "arrays": sizes, "frames": of_frames})
    for array in arrays.values():
        for box, numbers in array.pieces:
            content = np.ascontiguousarray(numbers, array.dtype).tobytes()
            send(answers, {"box": box})
            answers.write(content)
            answers.flush()
            _limit_time(seconds)
        send(answers, {"box": None})
    _limit_time(0)  # none while it waits


def _limit_memory(most: int) -> None:
    """Limit the address space where the system reports its size, and write no core dumps."""
    if resource is None:
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    size = Path("/proc/self/statm")
    if size.exists():
        most += int(size.read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _limit_time(seconds: float) -> None:
    """Set the clocks whose signals end the process, even within a library; 0 stops them."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, seconds)
        signal.setitimer(signal.ITIMER_REAL, _WAITING * seconds)


def send(file: BinaryIO, message: Any) -> None:
    """A message, which JSON can hold, behind its length."""
    text = json.dumps(message, default=_plain).encode()
    file.write(len(text).to_bytes(8, "little") + text)
    file.flush()


def receive(file: BinaryIO) -> Any:
    """The next message, or None at the end."""
    start = bytearray(8)
    if not fill(file, start):
        return None
    if (length := int.from_bytes(start, "little")) > _LONGEST:
        raise ValueError(f"a message of {length} bytes.")
    text = bytearray(length)
    return json.loads(text) if fill(file, text) else None


def fill(file: Any, content: Any) -> bool:
    """Fill a buffer with the next bytes; whether there were enough."""
    rest = memoryview(content)
    while len(rest) and (more := file.readinto(rest)):
        rest = rest[more:]
    return len(rest) == 0


def _plain(value: Any) -> Any:
    """NumPy's numbers for JSON."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be handed back.")
