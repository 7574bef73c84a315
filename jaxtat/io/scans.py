"""Scans in: measured or simulated data with whatever geometry the file holds."""

import os
import zipfile
from pathlib import Path
from typing import BinaryIO, Literal

import h5py
import numpy as np

Kind = Literal["pressure", "circular_integrals"]

# names under which a file may hold each thing; the first found counts
NAMES = {
    "circular_integrals": ("circular_integrals", "g"),
    "pressure": ("pressure", "raw"),
    "detectors": ("detectors", "detector_positions", "positions", "geometry"),
    "times": ("times", "t"),
    "sampling_rate": ("sampling_rate", "fs"),
    "radii": ("radii", "r"),
    "sound_speed": ("sound_speed", "speed_of_sound"),
}
NAMES_OF_DATA = ("circular_integrals", "pressure")


class Scan:
    """The content of a scan file: ``data`` of a ``kind``, and a dict of what else it knows.

    Attributes:
        kind: "pressure" or "circular_integrals".
        data: the array under that name, as stored.
        known: "detectors", "times", "sampling_rate", "radii", "sound_speed", those that are there.
    """

    def __init__(self, kind: Kind, data: np.ndarray, known: dict[str, np.ndarray]):
        self.kind, self.data, self.known = kind, data, known


def load_scan(path: str | Path) -> Scan:
    """Read data and geometry from .npz (NumPy) or .h5/.hdf5 (datasets at the root).

    Data are named ``circular_integrals`` (detectors, radii) or ``pressure`` (detectors, times);
    beside them may be ``detectors`` (positions), ``times`` or ``sampling_rate``, ``radii`` and
    ``sound_speed``; `NAMES` lists other names that are understood.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file that is damaged, of another kind, or without data.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}.")
    if path.suffix not in (".npz", ".h5", ".hdf5"):
        raise ValueError(f"cannot read {path}: expected a name ending in .npz, .h5 or .hdf5.")
    try:
        names, arrays = _read_npz(path) if path.suffix == ".npz" else _read_hdf5(path)
    except PermissionError:
        raise
    except Exception as error:  # zipfile, zlib, struct and h5py each raise their own for damage
        raise ValueError(
            f"cannot read {path}: damaged, or no {path.suffix} file of plain numbers ({error})."
        ) from error
    found = {
        thing: arrays[next(name for name in names if name in arrays)]
        for thing, names in NAMES.items()
        if any(name in arrays for name in names)
    }
    for kind in NAMES_OF_DATA:
        if kind in found:
            known = {name: value for name, value in found.items() if name not in NAMES_OF_DATA}
            return Scan(kind, found[kind], known)
    wanted = ", ".join(name for kind in NAMES_OF_DATA for name in NAMES[kind])
    raise ValueError(
        f"{path} holds {sorted(map(str, names))}, expected data under one of {wanted}."
    )


def _read_npz(path: Path) -> tuple[list[str], dict[str, np.ndarray]]:
    """All names in the file, and the arrays under those that are understood."""
    with path.open("rb") as handle:
        _require_directory(handle)
        with np.load(handle, allow_pickle=False) as file:
            return file.files, {name: _plain(name, file[name]) for name in _wanted(file.files)}


def _require_directory(handle: BinaryIO) -> None:
    """Damage in a zip file's directory can hide a member, whose own checksum then tells nothing."""
    with zipfile.ZipFile(handle) as archive:
        for member in archive.infolist():
            archive.open(member).close()  # compares the two places where its name is written
        n = len(archive.infolist())
    handle.seek(-22, os.SEEK_END)
    end = handle.read()
    if end[:4] == b"PK\5\6" and n != int.from_bytes(end[10:12], "little") != 0xFFFF:
        raise ValueError("members are missing from its directory")
    handle.seek(0)


def _read_hdf5(path: Path) -> tuple[list[str], dict[str, np.ndarray]]:
    """All names at the root, and the arrays under those that are understood."""
    with h5py.File(path, "r") as file:
        names = [name for name, item in file.items() if isinstance(item, h5py.Dataset)]
        return names, {name: _plain(name, np.asarray(file[name])) for name in _wanted(names)}


def _wanted(names: list[str]) -> list[str]:
    understood = {name for alternatives in NAMES.values() for name in alternatives}
    return [name for name in names if name in understood]


def _plain(name: str, array: np.ndarray) -> np.ndarray:
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} has dtype {array.dtype}, expected real numbers")
    return array.astype(array.dtype.newbyteorder("="))  # JAX takes no foreign byte order
