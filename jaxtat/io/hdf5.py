"""Reading numbers from untrusted HDF5 files: every stated size is checked first.

HDF5 trusts what it reads. So a dataset is read only if it is one of plain numbers, in this very
file, whole, compressed (if at all) by gzip, and of a size that its bytes in the file can give.
Pieces ("chunks") are fetched as they are stored and decoded here, within bounds: the library's own
filters crash on a piece shorter than its checksum, and inflate without end. Strings of variable
length, in which one wrong bit makes it loop, crash or fill the memory, are read without it too.

A process for each file, with limits, would stand even more. But its start takes 0.7 s of a
processor (Python, NumPy and h5py), and frames are asked for one by one. So it is done here, and
`benchmarks/robustness/fuzz_files.py` tells whether that is enough.
"""

import itertools
import math
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
from h5py import h5o  # pyright: ignore[reportAttributeAccessIssue]

from ..base.messages import name_of
from .frames import LazyFrames
from .limits import DEFLATE, Allowance, refusing, require_held
from .scan import REAL, require_numbers

_GZIP, _SHUFFLE, _CHECKSUM = 1, 2, 3  # numbers of HDF5's own filters
_BESIDES = 8192  # bytes that HDF5 may add to an array, for names, groups and marks
LONGEST_TEXT = 4096  # [byte]
_LONGEST_HEAP = 2**20  # [byte], of strings; the library writes 4096
_Filter = tuple[int, tuple[int, ...]]  # its number, and its parameters


class Hdf5File:
    """A file open for reading, and the memory its arrays may take."""

    def __init__(self, path: Path, file: h5py.File, allowance: Allowance):
        self.path, self.allowance = path, allowance
        self._file, self._size = file, path.stat().st_size
        self._found: dict[str, h5py.Group | h5py.Dataset | None] = {}

    def names(self, group: str = "/") -> list[str]:
        """Names in a group, if it exists, without links to elsewhere."""
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
        """Shape of a dataset of numbers that can be read, else ValueError."""
        return self._checked(name).shape

    def read(self, name: str, kinds: str = REAL) -> np.ndarray:
        """All of a dataset of numbers of some kinds (as NumPy calls them), in native byte order."""
        dataset = self._checked(name, kinds)
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

    def text(self, name: str, longest: int = LONGEST_TEXT) -> str | None:
        """A text, or None if there is none, or one that cannot be read."""
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
            held = min(longest, dataset.id.get_storage_size(), self._size)
            found = dataset[()] if dataset.dtype.itemsize <= held else None
        text = None if found is None else bytes(found).split(b"\0")[0].decode(errors="replace")
        return None if text in (None, "", "None") else text

    def mark(self, name: str, attribute: str) -> str | None:
        """An attribute of a dataset or group if it is a text of fixed length, else None."""
        try:
            found = self.attribute(name, attribute)
        except ValueError:
            return None
        return found if isinstance(found, str) else None

    def attribute(self, name: str, attribute: str) -> Any:
        """A text of fixed length, a number, a tuple of numbers, or None where that is stored.

        Raises:
            ValueError: if there is none, or one of another kind.
        """
        item = self._own(name)
        if item is None or attribute not in item.attrs:
            raise ValueError(f"{name} has no {attribute}.")
        value = item.attrs.get_id(attribute)
        if value.get_space().get_simple_extent_type() == h5py.h5s.NULL:
            return None
        text = value.dtype.kind == "S" and value.shape == ()
        size = math.prod(value.shape) * value.dtype.itemsize
        if not (text or value.dtype.kind in "biuf") or size > LONGEST_TEXT:
            raise ValueError(f"{attribute} of {name} is no text of fixed length and no number.")
        found: Any = np.asarray(item.attrs[attribute]).tolist()
        if text:
            return found.decode(errors="replace")
        return tuple(found) if isinstance(found, list) else found

    def has(self, name: str) -> bool:
        """Whether there is a group or dataset under that path, in this very file."""
        return self._own(name) is not None

    def identity(self, name: str) -> int:
        """A number that two names share if they stand for one and the same thing in the file."""
        return h5o.get_info(self._file[name].id).addr

    def is_group(self, name: str) -> bool:
        return isinstance(self._own(name), h5py.Group)

    def _own(self, name: str) -> h5py.Group | h5py.Dataset | None:
        """The object under a path, if all of the path lies in this file."""
        if name == "/":
            return self._file
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

    def _checked(self, name: str, kinds: str = REAL) -> h5py.Dataset:
        """A dataset whose stated size the file can hold, or ValueError."""
        dataset = self._dataset(name)
        if dataset is None:
            raise ValueError(f"it has no dataset {name}.")
        require_numbers(name, dataset.dtype, kinds)
        if dataset.shape is None or _is_elsewhere(dataset):
            raise ValueError(f"{name} has no numbers of its own in this file.")
        if dataset.id.get_type() != h5py.h5t.py_create(dataset.dtype, logical=True):
            raise ValueError(f"{name} has numbers of an unusual kind, expected {dataset.dtype}.")
        filters = _filters(dataset)
        numbers = [number for number, _ in filters]
        if not {*numbers} <= {_GZIP, _SHUFFLE, _CHECKSUM} or len({*numbers}) < len(numbers):
            raise ValueError(f"{name} has filters {numbers}, expected gzip or none.")
        if any(n == _SHUFFLE and p[:1] != (dataset.dtype.itemsize,) for n, p in filters):
            raise ValueError(f"{name} is shuffled in numbers of another size than its own.")
        claimed = math.prod(dataset.shape) * dataset.dtype.itemsize
        held, offset = dataset.id.get_storage_size(), dataset.id.get_offset() or 0
        require_held(name, offset + held, self._size)
        require_held(name, claimed, held, DEFLATE if _GZIP in numbers else 1)
        if dataset.chunks is not None:
            piece = math.prod(dataset.chunks) * dataset.dtype.itemsize
            self.allowance.require(f"a piece of {name}", piece)
        return dataset


@contextmanager
def open_hdf5(path: Path, allowance: Allowance) -> Iterator[Hdf5File]:
    """A file to read from, closed at the end."""
    with h5py.File(path, "r") as file:
        yield Hdf5File(path, file, allowance)


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
    """Whether a file has HDF5's signature."""
    return bool(h5py.is_hdf5(path))


def read_part(name: str, dataset: h5py.Dataset, part: tuple[slice, ...]) -> np.ndarray:
    """A box of a checked dataset, in native byte order.

    Raises:
        ValueError: for a piece that is not the size it should be, damaged, or missing.
    """
    native = dataset.dtype.newbyteorder("=")
    if dataset.chunks is None:
        return np.asarray(dataset[part]).astype(native, copy=False)
    found = np.empty([of.stop - of.start for of in part], native)
    edges, filters = list(zip(part, dataset.chunks, strict=True)), _filters(dataset)
    for origin in itertools.product(
        *(range(of.start // step * step, of.stop, step) for of, step in edges)
    ):
        try:
            piece = _piece(dataset, filters, origin)
        except (ValueError, OSError, RuntimeError, zlib.error) as error:
            raise ValueError(
                f"{name}: the piece at {origin} is missing or damaged: {error}"
            ) from error
        common = [
            (max(of.start, at), min(of.stop, at + step))
            for (of, step), at in zip(edges, origin, strict=True)
        ]
        into = [slice(a - of.start, b - of.start) for (a, b), of in zip(common, part, strict=True)]
        of_it = [slice(a - at, b - at) for (a, b), at in zip(common, origin, strict=True)]
        found[tuple(into)] = piece[tuple(of_it)]
    return found


def _piece(dataset: h5py.Dataset, filters: list[_Filter], origin: tuple[int, ...]) -> np.ndarray:
    """One piece, its filters undone from the last to the first."""
    n, itemsize = math.prod(cast(tuple, dataset.chunks)), dataset.dtype.itemsize
    # what deflate may add to noise; h5py refuses what does not fit
    room = bytearray(n * itemsize + n * itemsize // 1000 + 64)
    mask, content = dataset.id.read_direct_chunk(origin, out=room)
    content = bytes(content)
    for place, (number, _) in reversed(list(enumerate(filters))):
        if mask >> place & 1:  # a piece that a filter did not make shorter may be as it is
            continue
        if number == _CHECKSUM:
            content, stored = content[:-4], int.from_bytes(content[-4:], "little")
            if len(content) == 0 or stored not in _checksums(content):
                raise ValueError("its checksum is another.")
        elif number == _GZIP:
            stream = zlib.decompressobj()
            content = stream.decompress(content, n * itemsize + 8)  # and a checksum
            if not stream.eof and len(content) <= n * itemsize + 4:
                raise ValueError("it is cut off.")
        elif number == _SHUFFLE:
            end = len(content) // itemsize * itemsize
            planes = np.frombuffer(content[:end], np.uint8).reshape(itemsize, -1)
            content = planes.T.tobytes() + content[end:]
    if len(content) != n * itemsize:
        more = "more" if len(content) > n * itemsize else "less"
        raise ValueError(f"it has {more} than its {n * itemsize} bytes.")
    return np.frombuffer(content, dataset.dtype).reshape(dataset.chunks)


def _checksums(content: bytes) -> tuple[int, int]:
    """Fletcher's checksum of 32 bits as HDF5 has it, and as its first versions wrote it.

    Of words w_1 ... w_n of 16 bits, the higher byte first, it is the sum of w_k, and above it that
    of (n + 1 - k) w_k, both modulo 2^16 - 1, where only a sum of zeros is 0, not 2^16 - 1.

    >>> [hex(value) for value in _checksums(b"abcde")]
    ['0x4ff029c7', '0xf04fc729']
    """
    words = np.frombuffer(content + b"\0" * (len(content) % 2), ">u2")
    low, high, any_word = 0, 0, False
    for start in range(0, len(words), 2**16):  # sums of 2^16 products of 2^32 fit in 64 bits
        block = words[start : start + 2**16].astype(np.uint64)
        total = int(block.sum())
        high += len(block) * low + int(block @ np.arange(len(block), 0, -1, dtype=np.uint64))
        low, any_word = low + total, any_word or total > 0
    low, high = ((value % 0xFFFF or 0xFFFF) if any_word else 0 for value in (low, high))
    swapped = [(value & 0xFF) << 8 | value >> 8 for value in (low, high)]
    return high << 16 | low, swapped[1] << 16 | swapped[0]


def _filters(dataset: h5py.Dataset) -> list[_Filter]:
    """Numbers and parameters of the filters that its pieces went through, in that order."""
    creation = dataset.id.get_create_plist()
    found = (creation.get_filter(place) for place in range(creation.get_nfilters()))
    return [(number, parameters) for number, _, parameters, _ in found]


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
        raise ValueError(f"{name_of(path)} has changed since it was loaded: load it again.")
    with refusing(f"cannot read {name} of {name_of(path)}: "), h5py.File(path, "r") as file:
        return read(cast(h5py.Dataset, file[name]), numbers)


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
        file.seek(offset)
        length, address, number = struct.unpack("<IQI", file.read(16).ljust(16, b"\0"))
        if length > LONGEST_TEXT or address > os.fstat(file.fileno()).st_size:
            return None
        file.seek(address)
        heap = file.read(16)
        if heap[:5] != b"GCOL\1":
            return None
        size = min(int.from_bytes(heap[8:16], "little"), _LONGEST_HEAP)
        heap += file.read(max(size - 16, 0))
    at = 16
    while at + 16 <= len(heap):
        member, size = struct.unpack_from("<H6xQ", heap, at)
        at += 16
        if member == number:
            return heap[at : at + length] if length <= size <= len(heap) - at else None
        at += (size + 7) // 8 * 8
    return None
