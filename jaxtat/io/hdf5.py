"""Reading numbers from HDF5 files of others with a claim checked before each.

HDF5 trusts what it reads. So a dataset is read only if it is one of plain numbers, in this very
file, whole, compressed (if at all) by gzip, and of a size that its bytes in the file can give; and
compressed pieces are inflated here first, within bounds. Strings of variable length, in which one
wrong bit makes the library loop, crash or fill the memory, are read without it.
"""

import itertools
import math
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import BinaryIO, cast

import h5py
import numpy as np

from .frames import LazyFrames
from .limits import DEFLATE, Allowance, require_held
from .scan import require_real

_GZIP, _SHUFFLE, _CHECKSUM = 1, 2, 3  # numbers of HDF5's own filters
_LONGEST_TEXT = 4096  # [byte]


class Hdf5File:
    """A file open for reading, and the memory its arrays may take."""

    def __init__(self, path: Path, file: h5py.File, allowance: Allowance):
        self.path, self.allowance = path, allowance
        self._file, self._size = file, path.stat().st_size
        self._found: dict[str, h5py.Group | h5py.Dataset | None] = {}

    def names(self, group: str = "/") -> list[str]:
        """What a group holds, if there is one: not what links lead to elsewhere."""
        if group != "/" and not isinstance(self._own(group), h5py.Group):
            return []
        found = cast(h5py.Group, self._file[group])
        links = {str(name): found.get(str(name), getlink=True) for name in found}
        return [name for name, link in links.items() if isinstance(link, h5py.HardLink)]

    def datasets(self) -> list[str]:
        """Names of the datasets at the root."""
        return [name for name in self.names() if self._dataset(name) is not None]

    def has_numbers(self, name: str) -> bool:
        """Whether there is a dataset of real numbers under that name; text stands for none."""
        dataset = self._dataset(name)
        return dataset is not None and dataset.dtype.kind in "fiu"

    def shape(self, name: str) -> tuple[int, ...]:
        """Of a dataset of numbers that can be read, else ValueError."""
        return self._checked(name).shape

    def read(self, name: str) -> np.ndarray:
        """All of a dataset of numbers, in native byte order."""
        dataset = self._checked(name)
        self.allowance.take(name, math.prod(dataset.shape) * dataset.dtype.itemsize)
        return read_part(name, dataset, tuple(slice(0, size) for size in dataset.shape))

    def frames(
        self,
        name: str,
        shape: tuple[int, ...],
        read: Callable[[h5py.Dataset, np.ndarray], np.ndarray],
    ) -> LazyFrames:
        """Frames of a dataset, for which the file is opened again whenever some are asked for.

        Args:
            name: of the dataset.
            shape: (frames, detectors, samples).
            read: from the dataset and numbers of frames to an array of those; by `read_part`.
        """
        dataset = self._checked(name)
        native = dataset.dtype.newbyteorder("=")
        self.allowance.require(f"a frame of {name}", math.prod(shape[1:]) * native.itemsize)
        path = self.path.absolute()  # the working folder may change
        return LazyFrames(shape, native, partial(_read_again, path, _stamp(path), name, read))

    def text(self, name: str) -> str | None:
        """A short text, or None if there is none, or one that cannot be read."""
        dataset = self._dataset(name)
        if dataset is None or dataset.shape != () or _is_elsewhere(dataset):
            return None
        kind = h5py.check_string_dtype(dataset.dtype)
        if kind is None or dataset.chunks is not None:
            return None
        if kind.length is None:
            offset = dataset.id.get_offset()
            found = None if offset is None else _text_of_heap(self.path, offset)
        else:
            found = dataset[()] if dataset.dtype.itemsize <= _LONGEST_TEXT else None
        text = None if found is None else bytes(found).split(b"\0")[0].decode(errors="replace")
        return None if text in (None, "", "None") else text

    def mark(self, name: str, attribute: str) -> str | None:
        """An attribute of a dataset or group if it is a text of fixed length, else None."""
        item = self._own(name)
        if item is None or attribute not in item.attrs:
            return None
        value = item.attrs.get_id(attribute)
        if value.dtype.kind != "S" or value.shape != () or value.dtype.itemsize > _LONGEST_TEXT:
            return None
        return cast(bytes, item.attrs[attribute]).decode(errors="replace")

    def _own(self, name: str) -> h5py.Group | h5py.Dataset | None:
        """What is under that path if every step of it leads to something in this file."""
        if name not in self._found:
            above, _, last = name.rpartition("/")
            group = self._own(above) if above else self._file
            here = isinstance(group, h5py.Group)
            if here and isinstance(group.get(last, getlink=True), h5py.HardLink):
                item = group[last]
                self._found[name] = item if isinstance(item, h5py.Group | h5py.Dataset) else None
            else:
                self._found[name] = None
        return self._found[name]

    def _dataset(self, name: str) -> h5py.Dataset | None:
        item = self._own(name)
        return item if isinstance(item, h5py.Dataset) else None

    def _checked(self, name: str) -> h5py.Dataset:
        """A dataset whose claims the file can meet, or ValueError."""
        dataset = self._dataset(name)
        if dataset is None:
            raise ValueError(f"it has no dataset {name}.")
        require_real(name, dataset.dtype)
        if dataset.shape is None or _is_elsewhere(dataset):
            raise ValueError(f"{name} has no numbers of its own in this file.")
        filters = _filters(dataset)
        if not {*filters} <= {_GZIP, _SHUFFLE, _CHECKSUM} or len({*filters}) < len(filters):
            raise ValueError(f"{name} has filters {filters}, expected gzip or none.")
        claimed = math.prod(dataset.shape) * dataset.dtype.itemsize
        held, offset = dataset.id.get_storage_size(), dataset.id.get_offset() or 0
        require_held(name, offset + held, self._size)
        require_held(name, claimed, held, DEFLATE if _GZIP in filters else 1)
        if dataset.chunks is not None:
            piece = math.prod(dataset.chunks) * dataset.dtype.itemsize
            self.allowance.require(f"a piece of {name}", piece)
        return dataset


@contextmanager
def open_hdf5(path: Path, allowance: Allowance) -> Iterator[Hdf5File]:
    """A file to read from, closed at the end."""
    with h5py.File(path, "r") as file:
        yield Hdf5File(path, file, allowance)


def is_hdf5(path: Path) -> bool:
    """Whether a file has HDF5's signature."""
    return bool(h5py.is_hdf5(path))


def read_part(name: str, dataset: h5py.Dataset, part: tuple[slice, ...]) -> np.ndarray:
    """A box of a checked dataset, in native byte order.

    Raises:
        ValueError: for a compressed piece that is not the size it should be, or missing.
    """
    _require_pieces(name, dataset, part)
    return np.asarray(dataset[part]).astype(dataset.dtype.newbyteorder("="), copy=False)


def _require_pieces(name: str, dataset: h5py.Dataset, part: tuple[slice, ...]) -> None:
    """Compressed pieces must give as many bytes as a piece has: HDF5 would inflate without end."""
    if dataset.chunks is None:
        return
    size, filters = math.prod(dataset.chunks) * dataset.dtype.itemsize, _filters(dataset)
    gzip = 1 << filters.index(_GZIP) if _GZIP in filters else 0
    edges = zip(part, dataset.chunks, strict=True)
    steps = [range(of.start // step * step, of.stop, step) for of, step in edges]
    for origin in itertools.product(*steps):
        held = dataset.id.get_chunk_info_by_coord(origin)
        if held.byte_offset is None:
            raise ValueError(f"{name}: the piece at {origin} is missing.")
        if held.size > size + size // 1000 + 64:  # what deflate may add to noise
            raise ValueError(f"{name}: the piece at {origin} claims {held.size} bytes for {size}.")
        if gzip & ~held.filter_mask:  # a piece that gzip does not make shorter may be as it is
            _, content = dataset.id.read_direct_chunk(origin)
            if len(zlib.decompressobj().decompress(content, size + 16)) > size + 8:
                raise ValueError(f"{name}: the piece at {origin} has more than its {size} bytes.")


def _filters(dataset: h5py.Dataset) -> list[int]:
    """Numbers of the filters that its pieces went through, in that order."""
    creation = dataset.id.get_create_plist()
    return [creation.get_filter(number)[0] for number in range(creation.get_nfilters())]


def _is_elsewhere(dataset: h5py.Dataset) -> bool:
    return dataset.is_virtual or dataset.external is not None


def _read_again(
    path: Path,
    stamp: tuple[int, int],
    name: str,
    read: Callable[[h5py.Dataset, np.ndarray], np.ndarray],
    numbers: np.ndarray,
) -> np.ndarray:
    """Frames of a file that has not changed since it had that stamp."""
    if _stamp(path) != stamp:
        raise ValueError(f"{path} has changed since it was loaded: load it again.")
    try:
        with h5py.File(path, "r") as file:
            return read(cast(h5py.Dataset, file[name]), numbers)
    except (OSError, RuntimeError, ValueError, zlib.error) as error:
        raise ValueError(f"cannot read {name} of {path}: {error}") from error


def _stamp(path: Path) -> tuple[int, int]:
    status = os.stat(path)
    return status.st_size, status.st_mtime_ns


def _text_of_heap(path: Path, offset: int) -> bytes | None:
    """A string of variable length, from HDF5's global heap, if all is as it should be.

    At ``offset`` are its length (4 bytes), the address of a collection (8) and its number there
    (4). A collection is "GCOL", a version, its size (8 bytes at 8), and from 16 on its members:
    number (2), count of users (2), reserved (4), size (8), content filled up to 8 bytes.
    """
    with path.open("rb") as file:
        length, address, number = (
            _whole(file, offset + at, n) for at, n in ((0, 4), (4, 8), (12, 4))
        )
        if length > _LONGEST_TEXT:
            return None
        file.seek(address)
        if file.read(5) != b"GCOL\1":
            return None
        end = min(address + _whole(file, address + 8, 8), os.fstat(file.fileno()).st_size)
        at = address + 16
        while at + 16 <= end:
            size = _whole(file, at + 8, 8)
            if _whole(file, at, 2) == number:
                file.seek(at + 16)
                return file.read(length) if length <= size <= end - at - 16 else None
            at += 16 + (size + 7) // 8 * 8
    return None


def _whole(file: BinaryIO, offset: int, size: int) -> int:
    file.seek(offset)
    return int.from_bytes(file.read(size), "little")
