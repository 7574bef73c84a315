"""MATLAB's files of versions 5 to 7, a format of its own (7.3 is HDF5, see `plain_hdf5`).

Only matrices of real numbers are read. SciPy reads these files too, but takes longer to import than
all else that the process which opens files needs, and all of a matrix twice in memory.
"""

import math
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from .file_contents import PIECE, Box, FileContents, StoredArray
from .named_arrays import chosen_names
from .scan import Kind

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


def read_matlab5(path: Path, kind: Kind | None) -> FileContents:
    """Matrices by the names of `named_arrays.NAMES`.

    Compressed ones (MATLAB's default) have a checksum, so that damage is found; in others a wrong
    number cannot be told.
    """
    file = path.open("rb")
    matrices = {matrix.name: matrix for matrix in _matrices(file)}
    names = chosen_names(matrices, kind, [_named(file, matrix) for matrix in matrices.values()])
    for name in set(matrices).difference(names.values()):
        matrices[name].content(file).require_whole()  # its name may be what is damaged
    arrays = {name: _stored(file, matrices[name]) for name in names.values()}
    return FileContents({"format": "MATLAB 5 to 7", "names": names, "reversed": True}, arrays)


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

    @property
    def what(self) -> str:
        """What it is where it is no matrix of real numbers, else an empty text."""
        if self.flags & _COMPLEX:
            return "complex matrix"
        if self.flags & _LOGICAL:
            return "logical"
        known = "" if self.kind in _CLASSES else "matrix of an unknown kind"
        return _OTHERS.get(self.kind, known)

    def content(self, file: BinaryIO) -> "_Stream":
        return _Stream(file, self.start, self.size, self.compressed)


class _Stream:
    """The content of one element, inflated if it is compressed, read from its beginning on."""

    def __init__(self, file: BinaryIO, start: int, size: int, compressed: bool):
        self._file, self._at, self._left = file, start, size
        self._inflate = zlib.decompressobj() if compressed else None

    def read(self, n: int) -> bytes:
        """Exactly n bytes."""
        content = bytearray()
        while len(content) < n:
            if self._inflate is None:
                part = packed = self._take(n - len(content))
            else:
                packed = self._inflate.unconsumed_tail or self._take(2**16)
                part = self._inflate.decompress(packed, n - len(content))
            if not part and not packed:
                raise ValueError(f"an element ends after {len(content)} of {n} bytes.")
            content += part
        return bytes(content)

    def require_end(self) -> None:
        """Raise ValueError unless a compressed element ends here; its checksum is compared."""
        if self._inflate is None:
            return
        packed = self._inflate.unconsumed_tail + self._take(2**16)
        rest = self._inflate.decompress(packed, 9)  # no more than what fills up to 8 bytes
        if len(rest) > 8 or not self._inflate.eof:
            raise ValueError("a compressed element does not end where it should.")

    def require_whole(self) -> None:
        """Raise ValueError or zlib.error unless a compressed element is undamaged to its end."""
        while self._inflate is not None and not self._inflate.eof:
            packed = self._inflate.unconsumed_tail or self._take(2**16)
            if not self._inflate.decompress(packed, PIECE) and not packed:
                raise ValueError("a compressed element is cut off.")

    def _take(self, n: int) -> bytes:
        self._file.seek(self._at)
        part = self._file.read(min(n, self._left))
        self._at, self._left = self._at + len(part), self._left - len(part)
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
        if at + size > end:
            raise ValueError(f"an element claims {size} bytes, {end - at} are left: it is cut off.")
        yield _beginning(_Stream(file, at, size, kind == _COMPRESSED), at, size, kind, order)
        at += size


def _beginning(stream: _Stream, start: int, size: int, kind: int, order: str) -> _Matrix:
    """Flags, shape and name of a matrix."""
    if kind == _COMPRESSED:
        inner, _ = _tag(stream.read(8), order)
        if inner != _MATRIX:
            raise ValueError(f"a compressed element holds type {inner}, expected a matrix.")
    flags, _ = struct.unpack(f"{order}II", _part(stream, order, 8))
    sizes = _part(stream, order, 4 * 32)
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
    name = _part(stream, order, 256).decode(errors="replace")
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"{name} claims the shape {shape}: its header is damaged.")
    return _Matrix(name, shape, flags & 0xFF, flags, start, size, kind == _COMPRESSED, order)


def _inside(file: BinaryIO, matrix: _Matrix) -> _Stream:
    """The content of a matrix behind its flags, shape and name."""
    stream = matrix.content(file)
    if matrix.compressed:
        stream.read(8)
    for _ in range(3):
        _part(stream, matrix.order, 256)
    return stream


def _named(file: BinaryIO, matrix: _Matrix) -> str:
    """A matrix for people; of a struct, the names of its fields."""
    if matrix.what != "struct":
        return f"{matrix.name} (a {matrix.what})" if matrix.what else matrix.name
    stream = _inside(file, matrix)
    (longest,) = struct.unpack(f"{matrix.order}i", _part(stream, matrix.order, 4))
    names = _part(stream, matrix.order, 2**16)
    fields = [names[at : at + longest].split(b"\0")[0] for at in range(0, len(names), longest)]
    return f"{matrix.name} (a struct of {', '.join(each.decode('ascii') for each in fields)})"


def _stored(file: BinaryIO, matrix: _Matrix) -> StoredArray:
    """The content of a matrix of real numbers, or ValueError."""
    name, order = matrix.name, matrix.order
    if matrix.what:
        raise ValueError(f"{name} is a {matrix.what}, expected real numbers.")
    stream = _inside(file, matrix)
    kind, size, inside = _small_tag(stream.read(8), order)
    stored = np.dtype(order + _STORED.get(kind, "V1"))
    if kind not in _STORED or size != math.prod(matrix.shape) * stored.itemsize:
        raise ValueError(
            f"{name} has {size} bytes of type {kind} for {matrix.shape}: it is damaged."
        )
    pieces = _pieces(stream, inside, math.prod(matrix.shape), stored)
    return StoredArray(matrix.shape[::-1], np.dtype(_CLASSES[matrix.kind]), pieces, transposed=True)


def _pieces(
    stream: _Stream, inside: bytes | None, size: int, stored: np.dtype
) -> Iterator[tuple[Box, np.ndarray]]:
    """Numbers one after the other, which end with the element."""
    start = 0
    while start < size:
        stop = min(size, start + PIECE // 8)
        content = inside or stream.read((stop - start) * stored.itemsize)
        yield [(start, stop)], np.frombuffer(content, stored)
        start = stop
    stream.require_end()


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
