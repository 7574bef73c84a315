"""HDF5 files with plain datasets at their root."""

from pathlib import Path

import h5py
import numpy as np

from .frames import LazyFrames
from .hdf5 import Hdf5File, is_hdf5, open_hdf5, read_part
from .limits import Allowance
from .named_arrays import NAMES_OF_DATA, chosen_names, scan_of
from .scan import Kind, Scan


def is_plain_hdf5(path: Path, start: bytes) -> bool:
    return is_hdf5(path) and not start.startswith(b"MATLAB")  # whose axes are others


def load_plain_hdf5(path: Path, kind: Kind | None, allowance: Allowance) -> Scan:
    """Datasets by the names of `named_arrays.NAMES`; data of many frames are read when asked for.

    Of the data, HDF5 checks what was written with its Fletcher checksum, and gzip what it packed;
    otherwise wrong numbers are not detected.
    """
    with open_hdf5(path, allowance) as file:
        names = chosen_names(file.datasets(), kind)
        arrays = {
            thing: read_lazily(file, name) if thing in NAMES_OF_DATA else file.read(name)
            for thing, name in names.items()
        }
    return scan_of(arrays, {"format": "HDF5"})


def read_lazily(file: Hdf5File, name: str) -> np.ndarray | LazyFrames:
    """A dataset (frames, any, any) as frames, any other at once."""
    shape = file.shape(name)
    return file.frames(name, shape, _read_frames) if len(shape) == 3 else file.read(name)


def _read_frames(dataset: h5py.Dataset, numbers: np.ndarray) -> np.ndarray:
    _, rows, columns = dataset.shape
    found = np.empty((len(numbers), rows, columns), dataset.dtype.newbyteorder("="))
    for place, number in enumerate(numbers.tolist()):
        box = (slice(number, number + 1), slice(0, rows), slice(0, columns))
        found[place] = read_part(str(dataset.name), dataset, box)[0]
    return found
