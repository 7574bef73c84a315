"""Images of a series that is being made, kept beside their file until all of them are there."""

import math
import os
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..base.messages import name_of

_HEAD = 128  # [byte] of the file, before the images


class UnfinishedImages:
    """Images that are appended to a file, where a later process finds them.

    The file ``.NAME.unfinished`` beside NAME holds what the images are made from in its first 128
    bytes, then one image after the other as float64. An image that is written in part does not
    count: a process may be killed at any time.

    Args:
        path: where the finished images will be.
        made_from: of input and options, at most 100 letters; images of another input are replaced.
        shape: (images, *pixels).

    Attributes:
        shape: as given.
        done: number of images that are there.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "series.h5"
    >>> UnfinishedImages(path, "a1", (3, 2, 2))[0:2] = np.ones((2, 2, 2))
    >>> again = UnfinishedImages(path, "a1", (3, 2, 2))
    >>> again.done, UnfinishedImages(path, "b2", (3, 2, 2)).done
    (2, 0)
    """

    def __init__(self, path: str | Path, made_from: str, shape: tuple[int, ...]):
        target = Path(path)
        self.shape = tuple(int(size) for size in shape)
        self._place = target.with_name(f".{target.name}.unfinished")
        self._size = 8 * math.prod(self.shape[1:])  # [byte] of an image
        head = f"{made_from} {' '.join(map(str, self.shape))}".ljust(_HEAD).encode()
        self.done = self._found(head)
        if not self.done:
            self._place.write_bytes(head)

    def _found(self, head: bytes) -> int:
        """The number of whole images of an earlier process that made the same."""
        if not self._place.is_file():
            return 0
        with self._place.open("rb") as file:
            if file.read(_HEAD) != head:
                return 0
        return min((self._place.stat().st_size - _HEAD) // self._size, self.shape[0])

    def __setitem__(self, part: slice, images: Float[np.ndarray, "n *pixels"]) -> None:
        """Write images from ``part.start`` on, which are the next ones or there already."""
        start = int(part.start)
        if not 0 <= start <= self.done:
            raise ValueError(
                f"image {start} cannot be next: images 0 to {self.done - 1} are there."
            )
        try:
            with self._place.open("rb+") as file:
                file.seek(_HEAD + start * self._size)
                file.write(np.ascontiguousarray(images, float).tobytes())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            reason = f"cannot write {name_of(self._place)}: {error.strerror}"
            raise OSError(error.errno, reason) from error
        self.done = max(self.done, start + len(images))

    def images(self) -> Float[np.ndarray, "images *pixels"]:
        """All images, once they are there, as a memory map."""
        return np.memmap(self._place, float, "r", _HEAD, self.shape)

    def remove(self) -> None:
        """Remove the file: the images are elsewhere, or not wanted."""
        self._place.unlink(missing_ok=True)
