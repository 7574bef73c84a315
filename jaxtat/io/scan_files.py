"""From what a file holds to a scan."""

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..base.checks import named, whole_number
from ..base.messages import name_of, require_file
from .file_contents import FileContents
from .frames import LazyFrames, in_native_order
from .limits import MAX_BYTES, Allowance, refusing
from .named_arrays import NAMES_OF_DATA, scan_of
from .reader import read_file
from .registered_formats import registered_reader
from .scan import Kind, Scan, require_kind


def load_scan(path: str | Path, *, kind: Kind | None = None, max_bytes: int = MAX_BYTES) -> Scan:
    """Read data, and what is known of them, from a file of any of `formats`, or a registered one.

    - .h5, .hdf5 of IPASC or PATATO, and iThera's .msot with its .bin and .irf: all that they say;
    - .npz, MATLAB's .mat, and .h5, .hdf5 with datasets at the root: data named
      ``circular_integrals`` (detectors, radii), in space ``spherical_integrals``, or ``pressure``
      (detectors, times), of more frames
      (frames, detectors, any), in MATLAB (detectors, any, frames); beside them what `Scan.known`
      has a name for; `named_arrays.NAMES` lists other names that are understood;
    - .npy: data alone;
    - what other packages read that have registered a format (`registered_formats`): they are asked
      first, and neither bounded nor checked, except for what a `Scan` checks.

    The format is that of the content, whatever the file's name. The file is opened in a process of
    its own with limits of memory and time (`reader`), nothing in it is run, and no other file is
    read than those named here. Damage is found where the format has a checksum; each format's own
    function says where it has none. What is read when asked for must stay as it is until then.

    Args:
        path: of the file.
        kind: "pressure" or "circular_integrals", of a file that holds both (the latter by default)
            or does not say which (.npy, by default pressure).
        max_bytes: the most that its arrays may take in memory [byte]; those that are read when
            asked for do not count.

    Returns:
        Scan.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file that is damaged, of another format, without data, or that would take
            more memory; the reason is named.
    """
    if not isinstance(path, str | PathLike):
        raise ValueError(f"path is {named(path)}, expected the name of a file.")
    path = Path(path)
    allowance = Allowance(whole_number("max_bytes", max_bytes, 1))
    if kind is not None:
        require_kind(kind)
    require_file(path)
    with refusing(f"cannot read {name_of(path)}: "):
        read = registered_reader(path)
        if read:
            return read(kind)
        content = read_file("scan", path, allowance, kind=kind)
        return _scan_of(content, path, allowance)


def load_response(path: str | Path) -> np.ndarray:
    """The impulse response of elements in a file of NumPy.

    Args:
        path: of .npy, or of .npz with one array or with one named as in a scan; of several those of
            each element, rather than the one of all.

    Returns:
        (taps,), or (detectors, taps), time 0 in the middle.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file that is damaged or of another format.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "response.npz"
    >>> np.savez(path, irf=np.array([0.1, 1.0, -0.4]))
    >>> load_response(path).tolist()
    [0.1, 1.0, -0.4]
    """
    path = Path(path)
    require_file(path)
    with refusing(f"cannot read {name_of(path)}: "):
        found = read_file("response", path, Allowance(MAX_BYTES)).arrays["impulse_response"]
    return np.asarray(found, float)


def _scan_of(content: FileContents, path: Path, allowance: Allowance) -> Scan:
    """A scan of named arrays, or of a format that says what is what."""
    about, data = dict(content.about), content.frames
    names, reverse = about.pop("names", None), about.pop("reversed", False)
    if "map" in about:
        data = _mapped(path, allowance, **about.pop("map"))
    if names is None:
        assert data is not None
        # a single frame is an image's data, which no format distinguishes from a series of one
        return Scan("pressure", data[0] if len(data) == 1 else data, content.arrays, about)
    arrays: dict[str, Any] = {
        thing: content.arrays[name] for thing, name in names.items() if name in content.arrays
    }
    (kind,) = set(names) & {*NAMES_OF_DATA}
    if kind not in arrays:
        assert data is not None
        arrays[kind] = data.swapaxes(-2, -1) if reverse and isinstance(data, LazyFrames) else data
    elif reverse and arrays[kind].ndim == 3:
        arrays[kind] = np.moveaxis(arrays[kind], -1, 0)
    return scan_of(arrays, about)


def _mapped(
    path: Path,
    allowance: Allowance,
    dtype: str,
    shape: list[int],
    offset: int = 0,
    fortran: bool = False,
    suffix: str | None = None,
    places: list[int] | None = None,
) -> np.ndarray | LazyFrames:
    """A memory map of the numbers in a file, or in that beside it with another suffix.

    Args:
        path: of the file.
        allowance: memory, of which a single frame counts.
        dtype, shape, offset, fortran: of the numbers.
        suffix: of the file beside it.
        places: of the frames, if they are not all of them in their order.
    """
    part = shape[1:] if len(shape) == 3 else shape
    allowance.take("the array", int(np.prod(part, dtype=float)) * np.dtype(dtype).itemsize)
    where = path if suffix is None else path.with_suffix(suffix)
    data = np.memmap(where, dtype, "r", offset, tuple(shape), "F" if fortran else "C")
    if places is None or places == list(range(len(places))):
        return in_native_order(data if places is None else data[: len(places)])
    rows, native = np.array(places), data.dtype.newbyteorder("=")
    return LazyFrames(
        (len(places), *data.shape[1:]),
        native,
        lambda chosen: data[rows[chosen]].astype(native, copy=False),
    )
