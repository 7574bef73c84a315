"""MATLAB's files: version 5 to 7 (a format of its own), and 7.3 (HDF5).

Matrices have MATLAB's axes: data are (detectors, samples) or (detectors, samples, frames), or with
the first two exchanged where positions, times or radii show it. Only matrices of real numbers are
read.
"""

import math
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from .hdf5 import is_hdf5, open_hdf5
from .limits import DEFLATE, Allowance, require_held
from .named_arrays import NAMES_OF_DATA, chosen_names, scan_of
from .plain_hdf5 import read_lazily
from .scan import Kind, Scan

_HEADER = 128  # [byte]
_MATRIX, _COMPRESSED = 14, 15
# what the numbers are in the file, and in MATLAB
_STORED = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_CLASSES = dict(
    zip(range(6, 16), ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"), strict=True)
)
_OTHERS = {1: "cell", 2: "struct", 3: "object", 4: "char", 5: "sparse matrix"}
_COMPLEX, _LOGICAL = 0x0800, 0x0200


def is_matlab5(path: Path, start: bytes) -> bool:
    return start[124:128] in (b"\0\1IM", b"\1\0MI")


def is_matlab73(path: Path, start: bytes) -> bool:
    return start.startswith(b"MATLAB 7.3 MAT-file") and is_hdf5(path)


def load_matlab73(path: Path, kind: Kind | None, allowance: Allowance) -> Scan:
    """Matrices by the names of `named_arrays.NAMES`, in HDF5 with their axes reversed.

    Of many frames those asked for are read. MATLAB packs by gzip, whose checksum detects damage.
    """
    arrays = {}
    with open_hdf5(path, allowance) as file:
        for thing, name in chosen_names(file.datasets(), kind).items():
            what = file.mark(name, "MATLAB_class")
            if what in ("char", "logical", "cell", "struct"):
                raise ValueError(f"{name} is a {what}, expected real numbers.")
            if thing in NAMES_OF_DATA:
                arrays[thing] = read_lazily(file, name).swapaxes(-2, -1)
            else:
                arrays[thing] = file.read(name).T
    return scan_of(arrays, {"format": "MATLAB 7.3"})


def load_matlab5(path: Path, kind: Kind | None, allowance: Allowance) -> Scan:
    """Matrices by the names of `named_arrays.NAMES`, read at once.

    Compressed ones (MATLAB's default) have a checksum, so that damage is found; in others a wrong
    number cannot be told.
    """
    with path.open("rb") as file:
        matrices = {matrix.name: matrix for matrix in _matrices(file)}
        names = chosen_names(matrices, kind)
        for name in set(matrices).difference(names.values()):
            # its name may be what is damaged
            matrices[name].content(file).require_whole(name, allowance)
        arrays = {thing: _numbers(file, matrices[name], allowance) for thing, name in names.items()}
    for name in NAMES_OF_DATA:
        if name in arrays and arrays[name].ndim == 3:
            arrays[name] = np.moveaxis(arrays[name], -1, 0)
    return scan_of(arrays, {"format": "MATLAB 5 to 7"})


class _Matrix(NamedTuple):
    """A matrix in a file: where its element is, and what its first parts say."""

    name: str
    shape: tuple[int, ...]
    kind: int
    flags: int
    start: int
    size: int
    compressed: bool
    order: str

    def content(self, file: BinaryIO) -> "_Stream":
        return _Stream(file, self.start, self.size, self.compressed)


class _Stream:
    """The content of one element, inflated if it is compressed, read as asked for."""

    def __init__(self, file: BinaryIO, start: int, size: int, compressed: bool):
        self._file, self._left = file, size
        self._inflate = zlib.decompressobj() if compressed else None
        file.seek(start)

    def read(self, n: int) -> bytes:
        """Exactly n bytes, which the caller knows to be no false claim."""
        found = bytearray()
        while len(found) < n:
            if self._inflate is None:
                part = self._take(n - len(found))
            else:
                packed = self._inflate.unconsumed_tail or self._take(2**16)
                part = self._inflate.decompress(packed, n - len(found))
                if not part and not packed:
                    break
            if not part and self._inflate is None:
                break
            found += part
        if len(found) < n:
            raise ValueError(f"an element ends after {len(found)} of {n} bytes.")
        return bytes(found)

    def require_end(self) -> None:
        """Raise ValueError unless a compressed element ends here; its checksum is compared."""
        if self._inflate is None:
            return
        packed = self._inflate.unconsumed_tail + self._take(2**16)
        rest = self._inflate.decompress(packed, 9)  # no more than what fills up to 8 bytes
        if len(rest) > 8 or not self._inflate.eof:
            raise ValueError("a compressed element does not end where it should.")

    def require_whole(self, name: str, allowance: Allowance) -> None:
        """Raise ValueError or zlib.error unless a compressed element is undamaged to its end."""
        inflated = 0
        while self._inflate is not None and not self._inflate.eof:
            packed = self._inflate.unconsumed_tail or self._take(2**16)
            part = self._inflate.decompress(packed, 2**18)
            if not part and not packed:
                raise ValueError("a compressed element is cut off.")
            inflated += len(part)
            allowance.require(name, inflated)  # time, not memory, is what it takes

    def _take(self, n: int) -> bytes:
        part = self._file.read(min(n, self._left))
        self._left -= len(part)
        return part


def _matrices(file: BinaryIO) -> Iterator[_Matrix]:
    """What a file holds, from the beginnings of its elements."""
    end = os.fstat(file.fileno()).st_size
    file.seek(_HEADER - 2)
    order = "<" if file.read(2) == b"IM" else ">"
    at = _HEADER
    while at < end:
        file.seek(at)
        kind, size = _tag(file.read(8), order)
        at += 8
        if kind not in (_MATRIX, _COMPRESSED):
            raise ValueError(f"it has an element of type {kind} at byte {at - 8}: it is damaged.")
        require_held("an element", at + size, end)
        yield _beginning(_Stream(file, at, size, kind == _COMPRESSED), at, size, kind, order)
        at += size


def _beginning(stream: _Stream, start: int, size: int, kind: int, order: str) -> _Matrix:
    """Flags, shape and name of a matrix."""
    if kind == _COMPRESSED:
        inner, claimed = _tag(stream.read(8), order)
        if inner != _MATRIX:
            raise ValueError(f"a compressed element holds type {inner}, expected a matrix.")
        require_held("a compressed element", claimed, size, DEFLATE)
    flags, _ = struct.unpack(f"{order}II", _part(stream, order, 8))
    sizes = _part(stream, order, 4 * 32)
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
    name = _part(stream, order, 256).decode(errors="replace")
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"{name} claims the shape {shape}: its header is damaged.")
    return _Matrix(name, shape, flags & 0xFF, flags, start, size, kind == _COMPRESSED, order)


def _numbers(file: BinaryIO, matrix: _Matrix, allowance: Allowance) -> np.ndarray:
    """The content of a matrix of real numbers, or ValueError."""
    name, order = matrix.name, matrix.order
    what = _OTHERS.get(matrix.kind, "matrix of an unknown kind")
    if matrix.flags & _LOGICAL:
        what = "logical"
    if matrix.kind not in _CLASSES or matrix.flags & (_COMPLEX | _LOGICAL):
        what = "complex matrix" if matrix.flags & _COMPLEX else what
        raise ValueError(f"{name} is a {what}, expected real numbers.")
    stream = matrix.content(file)
    if matrix.compressed:
        stream.read(8)
    for longest in (8, 4 * 32, 256):  # flags, shape and name
        _part(stream, order, longest)
    tag = stream.read(8)
    kind, size, inside = _small_tag(tag, order)
    stored = np.dtype(order + _STORED[kind]) if kind in _STORED else None
    if stored is None or size != math.prod(matrix.shape) * stored.itemsize:
        raise ValueError(
            f"{name} has {size} bytes of type {kind} for {matrix.shape}: it is damaged."
        )
    require_held(name, size, matrix.size, DEFLATE if matrix.compressed else 1)
    wanted = np.dtype(_CLASSES[matrix.kind])
    allowance.require(name, size)
    allowance.take(name, math.prod(matrix.shape) * wanted.itemsize)
    content = inside if inside is not None else stream.read(size)
    stream.require_end()
    array = np.frombuffer(content, stored).reshape(matrix.shape, order="F")
    return array.astype(wanted, copy=False)


def _part(stream: _Stream, order: str, longest: int) -> bytes:
    """One short part of a matrix, of at most ``longest`` bytes."""
    kind, size, inside = _small_tag(stream.read(8), order)
    if size > longest:
        raise ValueError(f"a part of type {kind} claims {size} bytes: its header is damaged.")
    if inside is not None:
        return inside
    return stream.read(size + -size % 8)[:size]


def _tag(content: bytes, order: str) -> tuple[int, int]:
    """Type and size of an element."""
    if len(content) < 8:
        raise ValueError("it is cut off.")
    kind, size = struct.unpack(f"{order}II", content)
    return kind, size


def _small_tag(content: bytes, order: str) -> tuple[int, int, bytes | None]:
    """Type, size, and the content itself where it is short enough to stand in the tag."""
    kind, size = _tag(content, order)
    if kind >> 16:
        kind, size = kind & 0xFFFF, kind >> 16
        if size > 4:
            raise ValueError(f"a short part claims {size} bytes: its header is damaged.")
        return kind, size, content[4 : 4 + size]
    return kind, size, None
