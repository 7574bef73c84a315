"""From arrays with names, as NumPy, MATLAB and plain HDF5 files hold them, to a scan."""

from collections.abc import Container, Mapping, Sequence
from typing import Any, get_args

import numpy as np

from .frames import LazyFrames
from .scan import OF_ELEMENTS, Kind, Scan

# names under which a file may hold each thing; the first found counts
NAMES = {
    "circular_integrals": ("circular_integrals", "spherical_integrals", "g"),
    "pressure": ("pressure", "raw"),
    "detectors": ("detectors", "detector_positions", "positions", "geometry"),
    "times": ("times", "t"),
    "sampling_rate": ("sampling_rate", "fs"),
    "radii": ("radii", "r"),
    "sound_speed": ("sound_speed", "speed_of_sound"),
    "wavelengths": ("wavelengths", "wavelength"),
    "laser_energy": ("laser_energy", "pulse_energy"),
    "field_of_view": ("field_of_view", "fov"),
    "impulse_response": ("impulse_response", "irf", "element_responses"),
    "frequency_response": ("frequency_response",),
    "element_radius": ("element_radius",),
    "element_size": ("element_size",),
    "normals": ("normals", "element_normals"),
}
_LISTS = ("times", "radii", "wavelengths", "laser_energy", "field_of_view", "impulse_response")
_LISTS += OF_ELEMENTS
NAMES_OF_DATA = ("circular_integrals", "pressure")


def chosen_names(
    names: Container[str], kind: Kind | None, contents: Sequence[str]
) -> dict[str, str]:
    """Names in the file of data of one kind and of what belongs to them, by names of `Scan`.

    Args:
        names: of all arrays that the file holds.
        kind: the data wanted; by default circular integrals, else pressure.
        contents: what the file holds, for people.

    Raises:
        ValueError: if the file has no such data.

    >>> chosen_names(["fs", "raw", "comment"], None, [])
    {'pressure': 'raw', 'sampling_rate': 'fs'}
    """
    chosen = {
        thing: name
        for thing, alternatives in NAMES.items()
        if (name := next((name for name in alternatives if name in names), None))
    }
    kinds = [name for name in NAMES_OF_DATA if name in chosen and kind in (None, name)]
    if not kinds:
        wanted = [name for data in ([kind] if kind else NAMES_OF_DATA) for name in NAMES[data]]
        raise ValueError(
            f"it holds {', '.join(contents) or 'nothing'}, expected data under one of "
            f"{', '.join(wanted)}."
        )
    return {kinds[0]: chosen[kinds[0]]} | {
        thing: name for thing, name in chosen.items() if thing not in NAMES_OF_DATA
    }


def scan_of(arrays: Mapping[str, Any], about: Mapping[str, str]) -> Scan:
    """A scan of arrays by the names of `Scan`, in whatever order the writer kept their axes.

    Data may be (samples, detectors) where positions, times or radii show it; positions may be
    (2 or 3, detectors); lists may be rows or columns of a matrix, and numbers matrices of one.

    >>> scan = scan_of({"pressure": np.zeros((20, 8)), "times": np.arange(20.0)[:, None]}, {})
    >>> scan.data.shape, scan.known["times"].shape
    ((8, 20), (20,))
    """
    (kind,) = (kind for kind in get_args(Kind) if kind in arrays)
    known = {name: _plain(name, value) for name, value in arrays.items() if name != kind}
    return Scan(kind, _detectors_first(arrays[kind], kind, known), known, about)


def _plain(name: str, array: np.ndarray) -> np.ndarray:
    """An array without the axes that its writer had to add."""
    if name in ("sampling_rate", "sound_speed", *OF_ELEMENTS) and array.size == 1:
        return array.reshape(())
    if name in ("wavelengths", "laser_energy") and array.size == 1:
        return array.reshape(1)
    if name in _LISTS:
        return array.reshape(-1) if array.ndim == 2 and 1 in array.shape else array
    if name in ("detectors", "normals") and array.ndim == 2:
        return array.T if array.shape[1] not in (2, 3) and array.shape[0] in (2, 3) else array
    return array


def _detectors_first(
    data: np.ndarray | LazyFrames, kind: Kind, known: Mapping[str, np.ndarray]
) -> np.ndarray | LazyFrames:
    """Data with detectors before samples, if the known facts show which axis is which."""
    if data.ndim < 2:
        return data
    rows, columns = data.shape[-2:]
    along = known.get("times" if kind == "pressure" else "radii")
    if "detectors" in known:
        turned = len(known["detectors"]) == columns != rows
    else:
        turned = along is not None and len(along) == rows != columns
    return data.swapaxes(-2, -1) if turned else data
