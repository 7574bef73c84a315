"""NumPy's files: .npz archives of named arrays, and .npy, one array."""

import math
import os
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from .file_contents import PIECE, Box, FileContents, StoredArray
from .named_arrays import NAMES, chosen_names
from .scan import Kind, require_real

_STORED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # what NumPy writes
# those of each element come before that of all
RESPONSES = (*NAMES["impulse_response"], "EIR_indiv_mat", "EIR")
_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def is_archive(start: bytes) -> bool:
    """Whether a file begins as NumPy's archives do."""
    return start[:4] == b"PK\3\4"


def is_array(start: bytes) -> bool:
    """Whether a file begins as NumPy's arrays do."""
    return start[:6] == b"\x93NUMPY"


def read_npz(path: Path, kind: Kind | None) -> FileContents:
    """Arrays by the names of `named_arrays.NAMES`. Each has a checksum, so that damage is found."""
    archive = zipfile.ZipFile(path)
    members = _members(path, archive)
    names = chosen_names(members, kind, sorted(members))
    arrays = {name: _stored(archive.open(members[name]), name) for name in names.values()}
    return FileContents({"format": "NumPy archive", "names": names}, arrays)


def read_npy(path: Path, kind: Kind | None) -> FileContents:
    """Where the numbers of one array are: data of that kind (pressure), of which nothing is known.

    The format has no checksum: wrong numbers in the data are not detected.
    """
    with path.open("rb") as file:
        shape, fortran, dtype = _header(file, "the array")
        start, size = file.tell(), os.fstat(file.fileno()).st_size
    claimed = math.prod(shape) * dtype.itemsize
    if claimed != size - start or claimed == 0:
        raise ValueError(
            f"the array claims {claimed} bytes (shape {shape}), but the file holds {size - start} "
            "for it: it is cut off, or no file of one array."
        )
    about: dict[str, Any] = {"format": "NumPy array", "names": {kind or "pressure": "the array"}}
    about["map"] = {"dtype": dtype.str, "shape": shape, "offset": start, "fortran": fortran}
    return FileContents(about)


def read_response(path: Path) -> FileContents:
    """The impulse response in NumPy's archive, or array, under one of its names or alone there."""
    with path.open("rb") as file:
        start = file.read(6)
    if is_array(start):
        return FileContents({}, {"impulse_response": _stored(path.open("rb"), "the array")})
    if not is_archive(start):
        raise ValueError("it is neither .npy nor .npz: write the response with numpy.save.")
    archive = zipfile.ZipFile(path)
    members = _members(path, archive)
    named = [name for name in RESPONSES if name in members] or [*members]
    if len(named) > 1 and named[0] not in RESPONSES:
        raise ValueError(
            f"it holds {', '.join(sorted(members))}, expected one array, or one of the name "
            f"{', '.join(RESPONSES)}."
        )
    return FileContents(
        {}, {"impulse_response": _stored(archive.open(members[named[0]]), named[0])}
    )


def _members(path: Path, archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Members of an archive by name; what its directory says is compared with what follows it.

    Damage in the directory can hide a member, whose own checksum then does not help.
    """
    for member in archive.infolist():
        archive.open(member).close()  # compares the two places where its name is written
        if member.compress_type not in _STORED or member.flag_bits & 1:
            raise ValueError(f"{member.filename} is compressed or encrypted as NumPy does not.")
    with path.open("rb") as file:
        file.seek(-22, os.SEEK_END)
        end = file.read()
    count = int.from_bytes(end[10:12], "little")
    if end[:4] == b"PK\5\6" and len(archive.infolist()) != count != 0xFFFF:
        raise ValueError("members are missing from its directory.")
    return {member.filename.removesuffix(".npy"): member for member in archive.infolist()}


def _stored(file: IO[bytes], name: str) -> StoredArray:
    """An array of an archive, in pieces as it is unpacked."""
    shape, fortran, dtype = _header(file, name)
    return StoredArray(
        shape[::-1] if fortran else shape, dtype, _pieces(file, shape, dtype), fortran
    )


def _pieces(
    file: IO[bytes], shape: tuple[int, ...], dtype: np.dtype
) -> Iterator[tuple[Box, np.ndarray]]:
    size, start = math.prod(shape), 0
    while start < size:
        stop = min(size, start + PIECE // dtype.itemsize)
        content = file.read((stop - start) * dtype.itemsize)
        if len(content) < (stop - start) * dtype.itemsize:
            raise ValueError("an array is shorter than it claims: the file is cut off.")
        yield [(start, stop)], np.frombuffer(content, dtype, stop - start)
        start = stop
    if file.read(1):  # at the end the checksum is compared
        raise ValueError("there is more in a member than its array: its header is damaged.")


def _header(file: IO[bytes], name: str) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether the first axis runs fastest, and type; of real numbers, else ValueError."""
    version = npy.read_magic(file)
    if version not in _READERS:
        raise ValueError(f"{name} has version {version} of its format, expected (1, 0) or (2, 0).")
    shape, fortran, dtype = _READERS[version](file)
    require_real(name, dtype)
    if min(shape, default=0) < 0:
        raise ValueError(f"{name} claims the shape {shape}: its header is damaged.")
    return shape, fortran, dtype
