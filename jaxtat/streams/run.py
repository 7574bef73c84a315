"""From arriving frames to images, one after the other."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from ..base.messages import one_line, reason_of
from .images import Live
from .sinks import Sink
from .sources import FrameQueue

BATCH = 8  # frames of an image each: together they take half the time
ENDING = [signal.SIGINT, signal.SIGTERM]  # Ctrl-C, `kill`
if hasattr(signal, "SIGHUP"):  # a terminal that is closed, of which Windows knows nothing
    ENDING.append(signal.SIGHUP)


class Streamed(NamedTuple):
    """Counts of the frames read, written and left out.

    Attributes:
        images: written.
        dropped: frames for which there was no time.
        refused: frames of another shape or type, or with NaN.
        ended: why, if not at the end of a frame.
    """

    images: int
    dropped: int
    refused: int
    ended: str

    def __str__(self) -> str:
        ended = f"; {self.ended}" if self.ended else ""
        return f"{self.images} images, {self.dropped} frames dropped, {self.refused} refused{ended}"


def stream(
    to_images: Live,
    frames: Iterator[Any],
    sink: Sink,
    *,
    dtype: Any = np.uint16,
    room: int = 64,
    drop: bool = False,
    note: Callable[[str], Any] = print,
) -> Streamed:
    """Make an image of every frame until they end, or Ctrl-C.

    Frames are read in a thread of their own. After Ctrl-C, or where the system ends the program,
    none is read any more, and those that were read are finished; a second time ends at once, with
    all written images whole.

    Args:
        to_images: of `live`.
        frames: (detectors, samples), as they come.
        sink: where images go; it is closed in any case.
        dtype: of the frames, for which the function is compiled beforehand.
        room: for so many frames that wait.
        drop: leave out the oldest waiting frame where there is no room; else reading waits.
        note: what to do with lines about frames that are refused.

    Returns:
        Streamed.
    """
    waiting = FrameQueue(frames, room, drop)
    written = refused = 0
    ended = ""
    with _interrupting(waiting.stop) as interrupted:
        try:
            blank = np.zeros((BATCH, *to_images.frame_shape), dtype)
            for size in (1, BATCH):  # compiled before the first image is wanted
                np.asarray(to_images(blank[:size]))
            while taken := waiting.take(BATCH):
                for number, image in _images(to_images, taken):
                    if isinstance(image, ValueError):
                        refused += 1
                        note(one_line(f"frame {number} is left out: ", str(image)))
                    else:
                        sink.write(number, image)
                        written += 1
        except (ValueError, OSError) as error:
            ended = reason_of(error)
        finally:
            waiting.stop()
            sink.close()
    ended = "interrupted" if interrupted else ended
    return Streamed(written, waiting.dropped, refused, ended)


@contextmanager
def _interrupting(stop: Callable[[], None]) -> Iterator[list[int]]:
    """Call ``stop`` at the first Ctrl-C or signal to end, and add it to the list."""
    interrupted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield interrupted  # signals are the main thread's
        return

    def heard(number: int, _: Any) -> None:
        if interrupted:
            raise KeyboardInterrupt
        interrupted.append(number)
        stop()

    before = {number: signal.getsignal(number) for number in ENDING}
    for number, action in before.items():
        if action is not signal.SIG_IGN:  # as a program that goes on when its terminal is closed
            signal.signal(number, heard)
    try:
        yield interrupted
    finally:
        for number, action in before.items():
            signal.signal(number, action)


def _images(to_images: Live, taken: list[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    """Images of several frames at once, or one by one if a frame is invalid."""
    if len(taken) > 1:
        try:
            images = np.asarray(to_images(np.stack([frame for _, frame in taken])))
            yield from zip((number for number, _ in taken), images, strict=True)
            return
        except (ValueError, TypeError):
            pass  # by one of them
    for number, frame in taken:
        yield number, _image(to_images, frame)


def _image(to_images: Live, frame: Any) -> Any:
    """The image of one frame, or the error by which it has none."""
    if isinstance(frame, ValueError):
        return frame
    try:
        return np.asarray(to_images(frame))
    except (ValueError, TypeError) as error:
        return error if isinstance(error, ValueError) else ValueError(str(error))
