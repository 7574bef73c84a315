"""The formats that are read, which of them a file has, and what is read of it.

All of this runs in the process that opens files of others (`child`).
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from .file_contents import FileContents
from .hdf5 import is_hdf5, open_hdf5
from .ipasc import is_ipasc, read_ipasc
from .matlab import is_matlab5, read_matlab5
from .msot import read_msot
from .numpy_files import is_archive, is_array, read_npy, read_npz, read_response
from .patato import add_images, is_patato, read_patato
from .plain_hdf5 import is_of_matlab, read_matlab73, read_plain_hdf5
from .scan import Kind

_START = 512  # [byte] from the beginning of a file


class Format(NamedTuple):
    """A format of scans: how it is recognised, by path and first bytes, and read."""

    name: str
    has_it: Callable[[Path, bytes], bool]
    read: Callable[[Path, Kind | None], FileContents]


def _is_hdf5_of(layout: Callable[[Path], bool]) -> Callable[[Path, bytes], bool]:
    return lambda path, start: is_hdf5(path) and layout(path)


# what asks more of a file comes first
FORMATS = (
    Format("NumPy archive", lambda _, start: is_archive(start), read_npz),
    Format("NumPy array", lambda _, start: is_array(start), read_npy),
    Format("MATLAB 5 to 7", is_matlab5, read_matlab5),
    Format("MATLAB 7.3", _is_hdf5_of(is_of_matlab), read_matlab73),
    Format("IPASC", _is_hdf5_of(is_ipasc), read_ipasc),
    Format("PATATO", _is_hdf5_of(is_patato), read_patato),
    Format("HDF5", lambda path, _: is_hdf5(path), read_plain_hdf5),
    Format(
        "iThera MSOT",
        lambda _, start: start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<"),
        read_msot,
    ),
)


def read_scan(path: Path, kind: Kind | None) -> FileContents:
    """A scan of the format that the file's content has, whatever its name."""
    with path.open("rb") as file:
        start = file.read(_START)
    for format in FORMATS:
        if format.has_it(path, start):
            return format.read(path, kind)
    if not start:
        raise ValueError("it is empty.")
    names = ", ".join(dict.fromkeys(format.name for format in FORMATS))
    raise ValueError(f"it begins as none of the formats that are read ({names}), or is damaged.")


def read_arrays(
    path: Path, texts: Sequence[str], names: Sequence[str], attributes: Sequence[str]
) -> FileContents:
    """Parts of an HDF5 file that jaxtat wrote.

    Args:
        path: of the file.
        texts: datasets that hold a text.
        names: datasets of numbers at the root, or all in a group, whose name ends with "/"; those
            that are not there are left out.
        attributes: of the root.
    """
    if not is_hdf5(path):
        raise ValueError(
            "it is no HDF5 file, or its beginning is damaged: expected one that jaxtat wrote."
        )
    file = open_hdf5(path)
    each = [
        name
        for place in names
        for name in ([f"{place}{n}" for n in file.names(place)] if place[-1] == "/" else [place])
    ]
    about = {name: file.text(name) for name in texts}
    about |= {name: file.attribute("/", name) for name in attributes}
    arrays = {name: file.stored(name, "fiubc") for name in each if file.is_dataset(name)}
    return FileContents(about, arrays)


TASKS: dict[str, Callable[..., FileContents]] = {
    "scan": read_scan,
    "response": read_response,
    "arrays": read_arrays,
    "add_images": add_images,
}
