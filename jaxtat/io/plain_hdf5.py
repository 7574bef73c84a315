"""HDF5 files with plain datasets at their root, of any program or of MATLAB (version 7.3)."""

from pathlib import Path

from .file_contents import FileContents
from .hdf5 import Hdf5File, open_hdf5
from .named_arrays import NAMES_OF_DATA, chosen_names
from .scan import Kind


def read_plain_hdf5(path: Path, kind: Kind | None) -> FileContents:
    """Datasets by the names of `named_arrays.NAMES`; data of many frames are read when wanted.

    Of the data, HDF5 checks what was written with its Fletcher checksum, and gzip what it packed;
    otherwise wrong numbers are not detected.
    """
    return _read(path, kind, "HDF5")


def read_matlab73(path: Path, kind: Kind | None) -> FileContents:
    """The same of MATLAB, whose axes are reversed. MATLAB packs by gzip, which detects damage."""
    return _read(path, kind, "MATLAB 7.3")


def is_of_matlab(path: Path) -> bool:
    """Whether MATLAB wrote an HDF5 file: it marks each dataset, and begins the file by its name.

    Other programs, too, name HDF5 files .mat.
    """
    with path.open("rb") as handle:
        if handle.read(6) == b"MATLAB":
            return True
    file = open_hdf5(path)
    return any(file.attribute(name, "MATLAB_class") for name in file.names("/")[:100])


def _read(path: Path, kind: Kind | None, format: str) -> FileContents:
    file, reverse = open_hdf5(path), format != "HDF5"
    names = chosen_names(_Datasets(file), kind, file.contents())
    arrays, frames = {}, None
    for thing, name in names.items():
        what = file.attribute(name, "MATLAB_class")
        if what in ("char", "logical", "cell", "struct"):
            raise ValueError(f"{name} is a {what}, expected real numbers.")
        shape = file.shape(name)
        if thing in NAMES_OF_DATA and len(shape) == 3:
            frames = file.frames(name, shape, lambda n: (n,))
        else:
            arrays[name] = file.stored(name)
            arrays[name].transposed = reverse
    about = {"format": format, "names": names, "reversed": reverse}
    return FileContents(about, arrays, frames)


class _Datasets:
    """Names of a file's datasets, of which there may be many."""

    def __init__(self, file: Hdf5File):
        self._file = file

    def __contains__(self, name: object) -> bool:
        return self._file.is_dataset(str(name))
