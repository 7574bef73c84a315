"""Scans in: the formats that are read, and which of them a file has."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ..base.checks import whole_number
from ..base.messages import name_of, require_file
from .ipasc import is_ipasc, load_ipasc
from .limits import MAX_BYTES, Allowance, refusing
from .matlab import is_matlab5, is_matlab73, load_matlab5, load_matlab73
from .msot import is_msot, load_msot
from .numpy_files import is_npy, is_npz, load_npy, load_npz
from .patato import is_patato, load_patato
from .plain_hdf5 import is_plain_hdf5, load_plain_hdf5
from .registered_formats import registered_reader
from .scan import Kind, Scan, require_kind

_START = 512  # [byte] from the beginning of a file, by which its format is recognised


class Format(NamedTuple):
    """A format of scans: how it is recognised, by path and first bytes, and read."""

    name: str
    suffixes: tuple[str, ...]
    has_it: Callable[[Path, bytes], bool]
    load: Callable[[Path, Kind | None, Allowance], Scan]


# where two share a suffix, the one that asks more of a file comes first
FORMATS = (
    Format("NumPy archive", (".npz",), is_npz, load_npz),
    Format("NumPy array", (".npy",), is_npy, load_npy),
    Format("MATLAB 7.3", (".mat",), is_matlab73, load_matlab73),
    Format("MATLAB 5 to 7", (".mat",), is_matlab5, load_matlab5),
    Format("IPASC", (".h5", ".hdf5"), is_ipasc, load_ipasc),
    Format("PATATO", (".h5", ".hdf5"), is_patato, load_patato),
    Format("HDF5", (".h5", ".hdf5"), is_plain_hdf5, load_plain_hdf5),
    Format("iThera MSOT", (".msot",), is_msot, load_msot),
)
SUFFIXES = tuple(dict.fromkeys(suffix for format in FORMATS for suffix in format.suffixes))


def load_scan(path: str | Path, *, kind: Kind | None = None, max_bytes: int = MAX_BYTES) -> Scan:
    """Read data, and what is known of them, from a file of one of `FORMATS`, or a registered one.

    - .h5, .hdf5 of IPASC or PATATO, and iThera's .msot with its .bin and .irf: all that they say;
    - .npz, MATLAB's .mat, and .h5, .hdf5 with datasets at the root: data named
      ``circular_integrals`` (detectors, radii), in space ``spherical_integrals``, or ``pressure``
      (detectors, times), of more frames
      (frames, detectors, any), in MATLAB (detectors, any, frames); beside them what `Scan.known`
      has a name for; `named_arrays.NAMES` lists other names that are understood;
    - .npy: data alone;
    - what other packages read that have registered a format (`registered_formats`): they are asked
      first, and neither bounded nor checked, except for what a `Scan` checks.

    Nothing in a file is run, no other file is read than those named here, and no array is made
    before its size was compared with what the file can hold. Damage is found where the format has
    a checksum; each format's own function says where it has none. What is read when asked for must
    stay as it is until then.

    Args:
        path: of the file.
        kind: "pressure" or "circular_integrals", of a file that holds both (the latter by default)
            or does not say which (.npy, by default pressure).
        max_bytes: the most that its arrays may take in memory [byte]; those that are read when
            asked for do not count. Reading may take three times as much for a while.

    Returns:
        Scan.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file that is damaged, of another format than its suffix says, without
            data, or that would take more memory; the reason is named.
    """
    path = Path(path)
    allowance = Allowance(whole_number("max_bytes", max_bytes, 1))
    if kind is not None:
        require_kind(kind)
    require_file(path)
    with refusing(f"cannot read {name_of(path)}: "):
        read = registered_reader(path)
        return read(kind) if read else _format_of(path).load(path, kind, allowance)


def _format_of(path: Path) -> Format:
    """The format that suffix and content agree on, or ValueError."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"expected a name ending in {', '.join(SUFFIXES)}.")
    with path.open("rb") as file:
        start = file.read(_START)
    found = [format for format in FORMATS if format.has_it(path, start)]
    for format in found:
        if suffix in format.suffixes:
            return format
    if found:
        raise ValueError(
            f"its content is {found[0].name}: give it a name ending in {found[0].suffixes[0]}."
        )
    raise ValueError(f"it is no {suffix} file, or its beginning is damaged.")
