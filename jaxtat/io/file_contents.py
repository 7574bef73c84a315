"""What a file holds, as the process that has opened it hands it back."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

PIECE = 2**24  # [byte] of an array that are handed back at once, about

Box = list[tuple[int, int]]  # first and last + 1 along each axis


@dataclass
class StoredArray:
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
    def of(cls, array: Any) -> "StoredArray":
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

    def of(self, numbers: list[int]) -> StoredArray:
        whole = [(0, size) for size in self.shape[1:]]
        pieces = (([(k, k + 1), *whole], self.read(n)) for k, n in enumerate(numbers))
        return StoredArray((len(numbers), *self.shape[1:]), self.dtype, pieces)


@dataclass
class FileContents:
    """What a file holds.

    Attributes:
        about: text, numbers, and lists and dicts of them.
        arrays: by name.
        frames: that stay in the file until they are wanted.
    """

    about: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, Any] = field(default_factory=dict)
    frames: Frames | None = None
