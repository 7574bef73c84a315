"""Raw frames as they come: from a pipe, from a file that grows, from a folder that fills.

Framing: one frame after the other, each detectors x samples numbers of one type, the samples of a
detector side by side, in the byte order of this machine, with nothing between frames. A folder
holds `.npy` files, each a frame or a stack, taken in the order of their names.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..base.messages import name_of
from ..io import load_scan

PAUSE = 0.02  # [s] between two looks at a file or folder that may have grown


def frames_of_bytes(
    file: Any, shape: tuple[int, int], dtype: np.dtype, more: Callable[[], bool]
) -> Iterator[np.ndarray]:
    """Frames of a pipe or file.

    Args:
        file: open in binary mode; nothing to read is its end, or not yet more.
        shape: (detectors, samples).
        dtype: of the numbers.
        more: whether to wait for more at the end.

    Raises:
        ValueError: at the end, if it is in the middle of a frame.
    """
    size, held = int(np.prod(shape)) * dtype.itemsize, b""
    while True:
        part = file.read(size - len(held))
        held += part or b""
        if len(held) == size:
            yield np.frombuffer(held, dtype).reshape(shape)
            held = b""
        elif not part:
            if not more():
                break
            time.sleep(PAUSE)
    if held:
        raise ValueError(
            f"the input ends in the middle of a frame: {len(held)} of {size} bytes "
            f"({shape[0]} x {shape[1]} of {dtype}); all frames before it are there."
        )


def frames_of_folder(
    folder: Path, shape: tuple[int, int], more: Callable[[], bool]
) -> Iterator[Any]:
    """Frames of the `.npy` files in a folder, each read when it is completely written.

    A file that cannot be read, or holds no frames, comes as the error: once there is a later one or
    an end.

    Args:
        folder: of the files.
        shape: (detectors, samples).
        more: whether to wait for more at the end.
    """
    done: set[str] = set()
    while True:
        last = not more()
        new = sorted(path for path in folder.glob("*.npy") if path.name not in done)
        for path in new:
            try:
                stack = _stack_of_file(path, shape)
            except (ValueError, OSError) as error:
                if path == new[-1] and not last:
                    break  # it may not be whole yet
                yield ValueError(str(error))
            else:
                yield from _each(stack)
            done.add(path.name)
        if last:
            return
        if not new:
            time.sleep(PAUSE)


def _stack_of_file(path: Path, shape: tuple[int, int]) -> Any:
    """The frames of a file, read one by one; its size was compared with what its header says."""
    values = load_scan(path, kind="pressure").data
    if values.shape[-2:] != shape:
        raise ValueError(
            f"{name_of(path)} holds an array of shape {values.shape}, expected a frame {shape} or "
            "a stack of frames."
        )
    return values if values.ndim == 3 else values[None]


def _each(stack: Any) -> Iterator[Any]:
    """Copies of the frames, independent of the file, up to an error at the first invalid one."""
    for number in range(len(stack)):
        try:
            frame = np.array(stack[number])
        except (ValueError, OSError) as error:
            yield ValueError(str(error))
            return
        yield frame


class FrameQueue:
    """A queue of frames, which a thread of its own reads.

    Args:
        frames: read to its end; an error of it comes out of `take` behind all frames.
        room: for so many frames.
        drop: if there is no room, leave out the oldest frame, and count it; else the reader waits.
    """

    def __init__(self, frames: Iterator[Any], room: int, drop: bool):
        self.dropped = 0
        self._frames, self._room, self._drop = frames, room, drop
        self._held: deque[tuple[int, Any]] = deque()
        self._change, self._ended, self._stopped = threading.Condition(), False, False
        self._error: Exception | None = None
        threading.Thread(target=self._read, daemon=True).start()

    def take(self, most: int) -> list[tuple[int, Any]]:
        """Take the oldest frames with their numbers: ``most`` if there are so many, else one."""
        with self._change:
            while not self._held and not self._ended:
                self._change.wait(0.1)  # Ctrl-C is heard in between
            count = most if len(self._held) >= most else min(1, len(self._held))
            taken = [self._held.popleft() for _ in range(count)]
            self._change.notify_all()
        if not taken and self._error is not None:
            error, self._error = self._error, None
            raise error
        return taken

    def stop(self) -> None:
        """Stop reading; frames already read can still be taken."""
        with self._change:
            self._stopped = self._ended = True
            self._change.notify_all()

    def _read(self) -> None:
        try:
            for number, frame in enumerate(self._frames):
                with self._change:
                    while len(self._held) >= self._room and not (self._drop or self._stopped):
                        self._change.wait()
                    if self._stopped:
                        return
                    if len(self._held) >= self._room:
                        self._held.popleft()
                        self.dropped += 1
                    self._held.append((number, frame))
                    self._change.notify_all()
        except Exception as error:
            self._error = error
        finally:
            with self._change:
                self._ended = True
                self._change.notify_all()
