"""Frames that stay in their file until they are asked for."""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np


class LazyFrames:
    """An array (frames, detectors, samples) of which only the frames asked for are read.

    It is indexed as the array would be, frames by numbers, slices or lists of numbers; what comes
    back is an ordinary array. `numpy.asarray` reads all.

    Args:
        shape: (frames, detectors, samples).
        dtype: of the numbers, in native byte order.
        read: from numbers of frames, (n,), to an array (n, detectors, samples).

    >>> ramp = np.arange(24).reshape(4, 2, 3)
    >>> frames = LazyFrames(ramp.shape, ramp.dtype, lambda numbers: ramp[numbers])
    >>> frames[2], frames[-2:, 0, 1]
    (array([[12, 13, 14],
           [15, 16, 17]]), array([13, 19]))
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: np.dtype,
        read: Callable[[np.ndarray], np.ndarray],
    ):
        self.shape, self.dtype, self._read = tuple(int(size) for size in shape), dtype, read

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def nbytes(self) -> int:
        """What all frames would take in memory [byte]."""
        return len(self) * self.shape[1] * self.shape[2] * self.dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> Any:
        key = (key if isinstance(key, tuple) else (key,)) or (slice(None),)
        dots = [number for number, part in enumerate(key) if part is Ellipsis]
        if dots:  # as many whole axes as are missing
            whole = (slice(None),) * (self.ndim - len(key) + 1)
            key = (*key[: dots[0]], *whole, *key[dots[0] + 1 :])
        first, rest = key[0], key[1:]
        numbers = range(len(self))  # not an array: a file may claim any number of frames
        if isinstance(first, slice):
            chosen = numbers[first]
        elif np.ndim(first) == 0:
            return self._read(np.array([numbers[operator.index(first)]]))[0][rest]
        else:
            chosen = [numbers[operator.index(number)] for number in first]
        return self._read(np.array(chosen, int))[(slice(None), *rest)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self[:].astype(self.dtype if dtype is None else dtype, copy=False)

    def swapaxes(self, one: int, other: int) -> "LazyFrames":
        """The same frames as (frames, samples, detectors): the last two axes are exchanged."""
        if {one % 3, other % 3} != {1, 2}:
            raise ValueError(f"axes {one} and {other}: only the last two can be exchanged.")
        frames, rows, columns = self.shape
        return LazyFrames(
            (frames, columns, rows), self.dtype, lambda chosen: self._read(chosen).swapaxes(1, 2)
        )


def in_native_order(data: np.ndarray) -> np.ndarray | LazyFrames:
    """A memory map, converted if its byte order is foreign, of many frames those asked for."""
    native = data.dtype.newbyteorder("=")
    if native == data.dtype:
        return data
    if data.ndim == 3:
        return LazyFrames(data.shape, native, lambda chosen: data[chosen].astype(native))
    return data.astype(native)
