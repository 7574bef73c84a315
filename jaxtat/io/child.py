"""The process that opens files of others: whatever a file does to it, jaxtat itself goes on.

A file of a few changed bytes can crash HDF5, keep it busy for ever or fill the memory, and no check
beforehand finds all of them. So `reader.read_file` starts a process that runs `serve`. It imports
NumPy and h5py, not JAX, and forks one more process for each file (where there is no fork, it reads
one file itself). That one has limits of memory and time, and hands back plain text and numbers.
"""

import json
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from .limits import refusing

try:
    import resource
except ImportError:  # Windows
    resource = None

PIECE = 2**24  # [byte] of an array that are handed back at once, about
_LONGEST = 2**26  # [byte] of a message without its numbers
_WAITING = 20  # times longer than by the processor's clock a disk may take to answer

Box = list[tuple[int, int]]  # first and last + 1 along each axis


@dataclass
class Stored:
    """An array of a file, read in pieces while it is handed back.

    Attributes:
        shape, dtype: of all of it, in the order of C.
        pieces: boxes and their numbers; a box of one axis counts the numbers one after the other.
        transposed: whether the file has the axes in the reverse order.
    """

    shape: tuple[int, ...]
    dtype: np.dtype
    pieces: Iterator[tuple[Box, np.ndarray]]
    transposed: bool = False

    @classmethod
    def of(cls, array: Any) -> "Stored":
        """An array that is in memory."""
        array = np.asarray(array)
        return cls(array.shape, array.dtype, iter([([(0, array.size)], array.reshape(-1))]))


@dataclass
class Frames:
    """Frames of a recording that are read when they are wanted.

    Attributes:
        shape: (frames, detectors, samples).
        dtype: of the numbers.
        read: from the number of a frame to its numbers, (detectors, samples).
    """

    shape: tuple[int, int, int]
    dtype: np.dtype
    read: Callable[[int], np.ndarray]

    def of(self, numbers: list[int]) -> Stored:
        whole = [(0, size) for size in self.shape[1:]]
        pieces = (([(k, k + 1), *whole], self.read(n)) for k, n in enumerate(numbers))
        return Stored((len(numbers), *self.shape[1:]), self.dtype, pieces)


@dataclass
class Answer:
    """What a file holds.

    Attributes:
        about: text, numbers, and lists and dicts of them.
        arrays: by name.
        frames: that stay in the file until they are wanted.
    """

    about: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, Any] = field(default_factory=dict)
    frames: Frames | None = None


def serve() -> None:
    """Read one file after the other, as standard input says, until it ends."""
    from .formats import TASKS

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
    task: Callable[..., Answer], request: dict[str, Any], requests: BinaryIO, answers: BinaryIO
) -> None:
    """Hand back what one file holds, and then the frames that are wanted."""
    try:
        with refusing("", "it is damaged, or too large for the memory that files may take"):
            seconds = request.pop("seconds")
            _limit_time(seconds)
            answer = task(Path(request.pop("path")), **request)
            _hand_back(answers, answer, seconds)
            while answer.frames and (numbers := receive(requests)):
                _limit_time(seconds)
                frames = answer.frames.of(numbers["frames"])
                _hand_back(answers, Answer(arrays={"frames": frames}), seconds)
    except (ValueError, PermissionError) as error:
        send(answers, {"refused": str(error)})


def _hand_back(answers: BinaryIO, answer: Answer, seconds: float) -> None:
    """What the file says, then each array in pieces, each with its box."""
    arrays = {
        name: array if isinstance(array, Stored) else Stored.of(array)
        for name, array in answer.arrays.items()
    }
    sizes = {
        name: [array.dtype.str, array.shape, array.transposed] for name, array in arrays.items()
    }
    frames = answer.frames and [answer.frames.dtype.str, answer.frames.shape]
    send(answers, {"about": answer.about, "arrays": sizes, "frames": frames})
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
    """Of the address space, where the system says how large it is; and no image of a crash."""
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
