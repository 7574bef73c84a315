"""Reading HDF5 in the process that opens files of others, and writing it.

No other file is read than the one that was named: links to elsewhere and datasets that lie in other
files count as not there. What else a damaged file may do to the library, `child` has limits for.
"""

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from .file_contents import PIECE, Box, StoredArray
from .frames import LazyFrames
from .limits import DEFLATE, require_held
from .scan import REAL, require_numbers

_BESIDES = 8192  # bytes that HDF5 may add to an array, for names, groups and marks
_LONGEST_TEXT = 4096  # [byte]
_CACHE = 2**26  # [byte] of unpacked pieces
_SHOWN = 12  # names, in a message
_SIGNATURE = b"\x89HDF\r\n\x1a\n"


class Hdf5File:
    """A file open for reading, until the process ends; see `open_hdf5`."""

    def __init__(self, path: Path):
        self._file = h5py.File(path, "r", rdcc_nbytes=_CACHE, locking=False)

    def names(self, group: str) -> list[str]:
        """Names in a group, if there is one."""
        item = self.item(group)
        return list(item) if isinstance(item, h5py.Group) else []

    def item(self, name: str) -> h5py.Group | h5py.Dataset | None:
        """The group or dataset under a path, if all of the path lies in this file."""
        item: Any = self._file
        for part in filter(None, name.split("/")):
            here = isinstance(item, h5py.Group) and item.get(part, getlink=True)
            item = item[part] if isinstance(here, h5py.HardLink) else None
        return item if isinstance(item, h5py.Group | h5py.Dataset) else None

    def is_dataset(self, name: str) -> bool:
        return isinstance(self.item(name), h5py.Dataset)

    def has_numbers(self, name: str) -> bool:
        """Whether there is a dataset of real numbers under that name; text stands for none."""
        item = self.item(name)
        return isinstance(item, h5py.Dataset) and item.dtype.kind in REAL

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a dataset of numbers that can be read, else ValueError."""
        return self._checked(name).shape

    def read(self, name: str) -> np.ndarray:
        """All of a small dataset of real numbers, in native byte order."""
        dataset = self._checked(name)
        return np.asarray(dataset[()], dataset.dtype.newbyteorder("="))

    def stored(self, name: str, kinds: str = REAL) -> StoredArray:
        """A dataset of numbers of some kinds (as NumPy calls them), of any size."""
        dataset = self._checked(name, kinds)
        return StoredArray(dataset.shape, dataset.dtype, _pieces(dataset))

    def frames(
        self, name: str, shape: tuple[int, int, int], part: Callable[[int], tuple[Any, ...]]
    ) -> LazyFrames:
        """Frames of a dataset, each of which is a part of it.

        Args:
            name: of the dataset.
            shape: (frames, detectors, samples).
            part: from the number of a frame to an index of the dataset.
        """
        dataset = self._checked(name)

        def read(numbers: np.ndarray) -> np.ndarray:
            return np.stack([dataset[part(int(n))].reshape(shape[1:]) for n in numbers])

        return LazyFrames(shape, dataset.dtype, read)

    def text(self, name: str) -> str | None:
        """A text, or None if there is none."""
        item = self.item(name)
        if not isinstance(item, h5py.Dataset) or item.shape != () or _is_elsewhere(item):
            return None
        text = _text_of(item.dtype, item[()] if h5py.check_string_dtype(item.dtype) else None)
        return None if text in (None, "", "None") else text

    def attribute(self, name: str, attribute: str) -> Any:
        """A text, a number or a list of numbers; None if it is missing or of another type."""
        item = self.item(name)
        if item is None or attribute not in item.attrs:
            return None
        value = item.attrs.get_id(attribute)
        if value.dtype.kind in "biuf" and value.get_storage_size() <= _LONGEST_TEXT:
            return np.asarray(item.attrs[attribute]).tolist() if value.shape is not None else None
        return _text_of(value.dtype, item.attrs[attribute] if value.shape == () else None)

    def contents(self) -> list[str]:
        """What there is at the root, for people: of a group what is in it, too."""
        return [self._named(name) for name in itertools.islice(self._file, _SHOWN)]

    def _named(self, name: str) -> str:
        item = self.item(name)
        if item is None:
            return f"{name} (a link)"
        if isinstance(item, h5py.Group):
            what = "struct" if self.attribute(name, "MATLAB_class") == "struct" else "group"
            return f"{name} (a {what} of {', '.join(itertools.islice(item, _SHOWN)) or 'nothing'})"
        if h5py.check_string_dtype(item.dtype) or self.attribute(name, "MATLAB_class") == "char":
            return f"{name} (text)"
        return name

    def _checked(self, name: str, kinds: str = REAL) -> h5py.Dataset:
        """A dataset whose stated size the file can hold, or ValueError."""
        dataset = self.item(name)
        if not isinstance(dataset, h5py.Dataset):
            raise ValueError(f"it has no dataset {name}.")
        require_numbers(name, dataset.dtype, kinds)
        if dataset.shape is None or _is_elsewhere(dataset):
            raise ValueError(f"{name} has no numbers of its own in this file.")
        # otherwise HDF5 gives zeros for what was never written
        claimed = math.prod(dataset.shape) * dataset.dtype.itemsize
        packed = dataset.id.get_create_plist().get_nfilters() > 0
        require_held(name, claimed, dataset.id.get_storage_size(), DEFLATE if packed else 1)
        if dataset.chunks is not None:
            edges = zip(dataset.shape, dataset.chunks, strict=True)
            wanted = math.prod(-(-size // step) for size, step in edges)
            if (there := dataset.id.get_num_chunks()) < wanted:
                raise ValueError(f"{name} has only {there} of its {wanted} pieces in this file.")
        return dataset


open_hdf5 = cache(Hdf5File)


@contextmanager
def creating_hdf5(path: Path, arrays: Iterable[Any] = (), **options: Any) -> Iterator[h5py.File]:
    """A file to write to; where there is no more room, HDF5's RuntimeError is an OSError too.

    Args:
        path: the file, which is made anew.
        arrays: that it will hold. Room for them is asked for beforehand: where many groups are left
            unfinished, HDF5 has been seen to end the process.
        options: of `h5py.File`.
    """
    room = sum(array.nbytes + _BESIDES for array in arrays)
    if room and hasattr(os, "posix_fallocate"):
        with path.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, room)
    try:
        with h5py.File(path, "w", **options) as file:
            yield file
    except RuntimeError as error:
        raise OSError(str(error)) from error


def is_hdf5(path: Path) -> bool:
    """Whether a file has HDF5's signature, at its beginning or behind a block of its writer's."""
    with path.open("rb") as file:
        at, size = 0, path.stat().st_size
        while at + len(_SIGNATURE) <= size:
            file.seek(at)
            if file.read(len(_SIGNATURE)) == _SIGNATURE:
                return True
            at = 2 * at or 512
    return False


def _pieces(dataset: h5py.Dataset) -> Iterator[tuple[Box, np.ndarray]]:
    """All of a dataset in boxes that cut none of its pieces, each about `child.PIECE`."""
    if not dataset.shape:
        yield [(0, 1)], np.reshape(dataset[()], 1)
        return
    shape, steps = dataset.shape, list(dataset.chunks or [1] * dataset.ndim)
    for axis in reversed(range(dataset.ndim)):
        more = PIECE // max(1, math.prod(steps) * dataset.dtype.itemsize)
        steps[axis] = max(1, min(steps[axis] * max(1, more), shape[axis]))
    for start in itertools.product(
        *(range(0, size, step) for size, step in zip(shape, steps, strict=True))
    ):
        stop = [min(a + step, size) for a, step, size in zip(start, steps, shape, strict=True)]
        box = list(zip(start, stop, strict=True))
        yield box, dataset[tuple(slice(*edge) for edge in box)]


def _is_elsewhere(dataset: h5py.Dataset) -> bool:
    return dataset.is_virtual or dataset.external is not None


def _text_of(dtype: np.dtype, value: Any) -> str | None:
    """A text of fixed or variable length, up to the first zero; None for what is none."""
    if isinstance(value, str):
        value = value.encode(errors="replace")
    if not (isinstance(value, bytes) and (dtype.kind == "S" or h5py.check_string_dtype(dtype))):
        return None
    return value.split(b"\0")[0].decode(errors="replace")
