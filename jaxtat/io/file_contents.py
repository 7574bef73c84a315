"""What a file holds, and its arrays as the process that has opened it hands them back."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .frames import LazyFrames

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

    @classmethod
    def of_frames(cls, frames: LazyFrames, numbers: Sequence[int]) -> "StoredArray":
        """Frames of these numbers, read one at a time."""
        whole = [(0, size) for size in frames.shape[1:]]
        pieces = (([(k, k + 1), *whole], frames[n]) for k, n in enumerate(numbers))
        return cls((len(numbers), *frames.shape[1:]), frames.dtype, pieces)


@dataclass
class FileContents:
    """What a file holds.

    Attributes:
        about: text, numbers, and lists and dicts of them.
        arrays: by name, each a `StoredArray` or in memory.
        frames: that stay in the file until they are wanted.
    """

    about: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, Any] = field(default_factory=dict)
    frames: LazyFrames | None = None
