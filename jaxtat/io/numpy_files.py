"""NumPy's files: .npz archives of named arrays, and .npy, one array."""

import io
import math
import os
import re
import zipfile
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from .frames import in_native_order
from .limits import DEFLATE, Allowance, require_held
from .named_arrays import chosen_names, scan_of
from .scan import Kind, Scan, require_real

_STORED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # what NumPy writes
_LONGEST_HEADER = 1024  # [byte]; NumPy writes 118 of any array of numbers
# a dictionary as Python writes it, read by its pattern: not every literal is harmless
_SIZES = r"\((?:-?\d{1,20}L?\s*,\s*)*(?:-?\d{1,20}L?)?\s*\)"
_VALUE = rf"""("[^"'\s]{{1,20}}"|'[^"'\s]{{1,20}}'|True|False|{_SIZES})"""
_FIELD = re.compile(rf"""["'](descr|fortran_order|shape)["']\s*:\s*{_VALUE}""")
_HEADER = re.compile(rf"\{{\s*(?:{_FIELD.pattern}\s*,?\s*){{3}}\}}\s*")


def is_npz(path: Path, start: bytes) -> bool:
    return start[:4] == b"PK\3\4"


def is_npy(path: Path, start: bytes) -> bool:
    return start[:6] == npy.MAGIC_PREFIX


def load_npz(path: Path, kind: Kind | None, allowance: Allowance) -> Scan:
    """Arrays by the names of `named_arrays.NAMES`. Each has a checksum, so that damage is found."""
    with path.open("rb") as handle, zipfile.ZipFile(handle) as archive:
        members = _members(handle, archive)
        arrays = {
            thing: _read_member(archive, members[name], name, allowance)
            for thing, name in chosen_names(members, kind).items()
        }
    return scan_of(arrays, {"format": "NumPy archive"})


def load_npy(path: Path, kind: Kind | None, allowance: Allowance) -> Scan:
    """One array as a memory map: data of the given kind (pressure), of which nothing is known.

    The format has no checksum: wrong numbers in the data are not detected.
    """
    with path.open("rb") as file:
        shape, fortran, dtype = _header(file, "the array")
        offset, held = file.tell(), os.fstat(file.fileno()).st_size - file.tell()
    claimed = math.prod(shape) * dtype.itemsize
    require_held("the array", claimed, held)
    if held > claimed:
        raise ValueError(f"{held - claimed} bytes follow the array: it is no file of one array.")
    if claimed == 0:
        raise ValueError(f"the array has shape {shape}, expected (detectors, samples).")
    if dtype.newbyteorder("=") != dtype and len(shape) != 3:
        allowance.take("the array", claimed)
    order = "F" if fortran else "C"
    data = np.memmap(path, dtype, "r", offset, shape, order)
    return scan_of({kind or "pressure": in_native_order(data)}, {"format": "NumPy array"})


def _members(handle: io.BufferedIOBase, archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Members of an archive by name; what its directory says is compared with what follows it.

    Damage in the directory can hide a member, whose own checksum then does not help.
    """
    size = os.fstat(handle.fileno()).st_size
    members = archive.infolist()
    for member in members:
        name = member.filename.removesuffix(".npy")
        archive.open(member).close()  # compares the two places where its name is written
        if member.compress_type not in _STORED or member.flag_bits & 1:
            raise ValueError(f"{name} is compressed or encrypted as NumPy does not.")
        require_held(name, member.compress_size, size)
        ratio = 1 if member.compress_type == zipfile.ZIP_STORED else DEFLATE
        require_held(name, member.file_size, member.compress_size, ratio)
    handle.seek(-22, os.SEEK_END)
    end = handle.read()
    if end[:4] == b"PK\5\6" and len(members) != int.from_bytes(end[10:12], "little") != 0xFFFF:
        raise ValueError("members are missing from its directory.")
    return {member.filename.removesuffix(".npy"): member for member in members}


def _read_member(
    archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str, allowance: Allowance
) -> np.ndarray:
    with archive.open(member) as file:
        shape, fortran, dtype = _header(file, name)
        claimed = math.prod(shape) * dtype.itemsize
        if claimed != member.file_size - file.tell():
            raise ValueError(
                f"{name} claims {claimed} bytes, its place in the archive has "
                f"{member.file_size - file.tell()}: its header is damaged."
            )
        allowance.take(name, claimed)
        array = np.empty(claimed, np.uint8)
        filled = 0
        while filled < claimed:
            part = file.read(min(2**18, claimed - filled))
            if not part:
                raise ValueError(f"{name} ends after {filled} of {claimed} bytes.")
            array[filled : filled + len(part)] = np.frombuffer(part, np.uint8)
            filled += len(part)
        file.read(1)  # at the end the checksum is compared
    array = array.view(dtype).reshape(shape, order="F" if fortran else "C")
    return array.astype(dtype.newbyteorder("="), copy=False)  # JAX takes no foreign byte order


def _header(
    file: io.BufferedIOBase | IO[bytes], name: str
) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether the first axis runs fastest, and type; of real numbers, else ValueError."""
    version = npy.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"{name} has version {version} of its format, expected (1, 0) or (2, 0).")
    claimed = int.from_bytes(file.read(2 * version[0]), "little")
    if claimed > _LONGEST_HEADER:
        raise ValueError(f"{name} claims a header of {claimed} bytes: it is damaged.")
    text = file.read(claimed).decode("latin1")
    found = dict(_FIELD.findall(text))
    if not _HEADER.fullmatch(text) or set(found) != {"descr", "fortran_order", "shape"}:
        raise ValueError(f"{name} has the header {text!r:.100}, expected that of an array.")
    dtype = np.dtype(found["descr"].strip("\"'"))
    require_real(name, dtype)
    shape = tuple(int(size) for size in re.findall(r"-?\d+", found["shape"]))
    if any(size < 0 for size in shape):
        raise ValueError(f"{name} claims the shape {shape}: its header is damaged.")
    return shape, found["fortran_order"] == "True", dtype
