"""Write images into PATATO's HDF5, for its unmixing, sO2 and regions of interest.

``/recons/jaxtat/N`` is (frames, wavelengths, z, y, x), x last, of the N-th reconstruction; its
attributes say where it is: number of pixels, and first and last coordinate [m], along each axis.
Beside it, where PATATO does not look for images to unmix, ``/jaxtat/N`` has the standard deviations
of the pixels and all settings. The layout of the scan itself is described in `io.patato`.
"""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np

from ..base.atomic import replacing
from ..base.messages import name_of
from ..base.units import MICROSECONDS, Units, millimetres
from ..geometry.measured_curves import flat_axis
from ..io import Scan, load_scan
from ..io.hdf5 import creating_hdf5
from ..io.limits import Allowance, refusing
from ..io.patato import (
    BESIDE,
    ENERGIES,
    GEOMETRY,
    IMAGES,
    NAME,
    RATE,
    RAW,
    RESPONSE,
    SPEED,
    WAVELENGTHS,
)
from ..io.provenance import as_json, provenance_of
from ..io.reader import read_file
from ..io.series import period, rate_of
from ..scans import ScanImages


def save_patato(
    path: str | Path,
    scan: Scan,
    result: ScanImages,
    *,
    deviation: np.ndarray | None = None,
    settings: Mapping[str, Any] | None = None,
    inputs: Sequence[str | Path] = (),
) -> None:
    """Write images into a file of PATATO 0.7; a file of the same scan is extended.

    A file that is there, or else the first of ``inputs`` if that is PATATO's, is copied, the images
    are added to the copy, and the copy replaces the file: nothing in it is lost, and it is
    never half written. A new file holds the time series too, so that PATATO's own reconstructions
    run on it: with the speed of sound that was chosen, a unit impulse for a response that is not
    known, and 1 for energies that are not.

    Args:
        path: the file, ending in .hdf5 or .h5.
        scan: pressure of all frames that were requested.
        result: by `scans.reconstruct`; frames that it left out become NaN.
        deviation: of its pixels, by `scans.standard_deviations`.
        settings: what else was chosen; those of ``result.choices`` are stored anyway.
        inputs: files from which the images were made; names and SHA-256 are stored.

    Raises:
        ValueError: for circular integrals, frames that are no whole number of rounds through the
            wavelengths, and a file that is there and not PATATO's, or of another scan.

    Source: PATATO 0.7, patato.io.hdf.hdf5_interface.
    """
    base, wavelengths = require_patato(path, scan, inputs)
    images = _all_frames(scan, result, result.image)
    spread = None if deviation is None else _all_frames(scan, result, deviation)
    about = {
        "settings": as_json("settings", {**(settings or {}), **result.choices.settings()}),
        "provenance": as_json("provenance", provenance_of(inputs, result.unit)),
    }
    units = result.choices.units._replace(length=result.unit)
    axes, flat = _axes(scan, result, units)
    marks = _marks(result, axes, units, wavelengths)
    with TemporaryDirectory() as folder, replacing(path) as temporary:
        if base is None:
            _write_scan(temporary, scan, result, wavelengths, units)
        else:
            shutil.copyfile(base, temporary)
        added = Path(folder) / "added.h5"
        with creating_hdf5(added) as file:
            _add(file, IMAGES, _rows_of_x(images, flat), marks)
            beside = file.create_group(BESIDE)
            if spread is not None:
                _add(beside, "standard_deviation", _rows_of_x(spread, flat), marks)
            for name, text in about.items():
                beside.create_dataset(name, data=np.bytes_(text.encode()))
        _extend(temporary, added)


def require_patato(
    path: str | Path, scan: Scan, inputs: Sequence[str | Path] = ()
) -> tuple[Path | None, np.ndarray]:
    """The file that will be extended, if any, and the wavelengths of a round; or ValueError.

    Asked before hours of work; arguments and errors as `save_patato`.
    """
    if scan.kind != "pressure":
        raise ValueError(f"PATATO files hold pressure, this scan has {scan.kind}.")
    wavelengths, base = _rounds(scan), _base(path, inputs)
    if base is not None:
        _require_same(base, scan)
        _extend(base, None)
    else:
        _rate(scan)
    return base, wavelengths


def _add(group: h5py.Group, name: str, stack: np.ndarray, marks: Mapping[str, Any]) -> None:
    """Images (frames, z, y, x) as (rounds, wavelengths, z, y, x), with a checksum over each."""
    data = stack.reshape(-1, len(marks[WAVELENGTHS]), *stack.shape[1:])
    chunks = (1, 1, *data.shape[2:])
    made = group.create_dataset(name, data=data, chunks=chunks, fletcher32=True)
    made.attrs.update(marks)


def _rounds(scan: Scan) -> np.ndarray:
    """The wavelengths of a round, through which all frames go; zero for one that is not known."""
    every = scan.known.get("wavelengths")
    if every is None:
        return np.zeros(1)
    n = period(every)
    if len(np.unique(every[:n])) < n:
        raise ValueError(
            f"the {len(every)} frames have wavelengths {np.unique(every)}, but do not go through "
            "them in whole rounds, as PATATO's do: choose frames that do (--frames)."
        )
    return every[:n]


def _all_frames(scan: Scan, result: ScanImages, stack: Any) -> np.ndarray:
    """One image for each frame of the scan; zero outside the region, NaN for frames left out."""
    shape = result.grid.shape
    inside = np.asarray(result.region.contains(result.grid.points))
    requested = scan.known.get("frame_numbers", np.arange(scan.n_frames))
    images = np.full((scan.n_frames, *shape), np.nan)
    kept = np.isin(requested, result.numbers)
    images[kept] = np.where(inside, np.reshape(stack, (-1, *shape)), 0.0)
    return images


def _base(path: str | Path, inputs: Sequence[str | Path]) -> Path | None:
    """The file to extend: an existing one, else the scan's own file if it is PATATO's."""
    there = Path(path)
    if there.exists():
        with refusing(f"cannot add to {name_of(there)}: "):
            if load_scan(there).about["format"] != "PATATO":
                raise ValueError("there is a file of another format: choose another name.")
        return there
    for source in map(Path, inputs[:1]):
        if load_scan(source).about["format"] == "PATATO":
            return source
    return None


def _require_same(base: Path, scan: Scan) -> None:
    """Raise ValueError for images of another scan than the file holds."""
    there = load_scan(base)
    detectors = np.asarray(scan.known["detectors"], float)
    held = np.asarray(there.known["detectors"], float)[:, : detectors.shape[1]]
    number = int(np.ravel(scan.known.get("frame_numbers", 0))[0])
    same = (
        there.data.shape[-2:] == scan.data.shape[-2:]
        and number < there.n_frames
        and np.allclose(held, detectors, rtol=0, atol=1e-6 * np.abs(detectors).max())
        and np.array_equal(there.frame(number), scan.frame(0), equal_nan=True)
    )
    if not same:
        raise ValueError(
            f"cannot add to {name_of(base)}: it holds another scan, of {there.n_frames} frames, "
            f"{there.n_detectors} detectors and {there.n_samples} samples: choose another name."
        )


def _metres(units: Units) -> float:
    """The unit of length; lengths without one are taken as they are."""
    return 1.0 if units.length is None else 1e-3 * millimetres(units.length)


def _axes(scan: Scan, result: ScanImages, units: Units) -> tuple[list[np.ndarray], int | None]:
    """Nodes along x, y and z [m], and which of them a plane of detectors lies across, or None."""
    detectors, grid = np.asarray(scan.known["detectors"], float), result.grid
    nodes = [np.asarray(grid.axis(k), float) for k in range(len(grid.shape))]
    flat = flat_axis(detectors)
    if flat is not None:
        at = detectors[:, flat].mean() if detectors.shape[1] == 3 else 0.0
        nodes.insert(flat, np.array([at]))
    return [_metres(units) * along for along in nodes], flat


def _rows_of_x(stack: np.ndarray, flat: int | None) -> np.ndarray:
    """(frames, x1, x2) or (frames, x1, x2, x3) to (frames, z, y, x)."""
    whole = stack if flat is None else np.expand_dims(stack, 1 + flat)
    return whole.transpose(0, 3, 2, 1)


def _marks(
    result: ScanImages, axes: list[np.ndarray], units: Units, wavelengths: np.ndarray
) -> dict[str, Any]:
    """PATATO's attributes of an image; positions of the nodes are in metres."""
    marks: dict[str, Any] = {
        "RECONSTRUCTION_ALGORITHM": np.bytes_(NAME),
        "CorrectionFactorApplied": result.choices.laser_energy,
        WAVELENGTHS: wavelengths,
        SPEED: _speed(result, units),
    }
    for name, nodes in zip("XYZ", axes, strict=True):
        marks[f"RECONSTRUCTION_N{name}"] = len(nodes)
        marks[f"RECONSTRUCTION_FIELD_OF_VIEW_{name}"] = nodes[[0, -1]]
    return marks


def _speed(result: ScanImages, units: Units) -> float:
    """Speed of sound [m/s], or in the units of the scan if they are not known."""
    seconds = 1e-6 * MICROSECONDS[units.time] if units.time else 1.0
    return result.choices.sound_speed * _metres(units) / seconds


def _write_scan(
    path: Path, scan: Scan, result: ScanImages, wavelengths: np.ndarray, units: Units
) -> None:
    """Write everything that PATATO reads of a scan."""
    colours = len(wavelengths)
    shape = scan.n_frames // colours, colours
    rounds = np.repeat(np.arange(shape[0])[:, None], colours, axis=1)
    seconds = 1e-6 * MICROSECONDS[units.time] if units.time else 1.0
    detectors = _metres(units) * np.asarray(scan.known["detectors"], float)
    energies = scan.known.get("laser_energy", np.ones(scan.n_frames))
    others = {
        GEOMETRY: np.pad(detectors, ((0, 0), (0, 3 - detectors.shape[1]))),
        WAVELENGTHS: wavelengths,
        RESPONSE: _response(scan),
        ENERGIES[0]: np.asarray(energies, float).reshape(shape),
        "TEMPERATURE": np.full(shape, np.nan),
        "timestamp": np.zeros(shape),
        "RUN": rounds,
        "REPETITION": rounds,
        "Z-POS": np.zeros(shape),
        "water-absorption-coefficients": np.zeros(colours),
    }
    with creating_hdf5(path) as file:
        whole = (*shape, *scan.data.shape[-2:])
        raw = file.create_dataset(RAW, whole, scan.data.dtype, chunks=(1, 1, *whole[2:]))
        for number in range(scan.n_frames):
            raw[divmod(number, colours)] = scan.frame(number)
        for name, array in others.items():
            file[name] = array
        file["water-absorption-coefficients"].attrs["pathlength"] = 0.0
        name = scan.about.get("name", NAME)
        marks = {RATE: _rate(scan) / seconds, SPEED: _speed(result, units), "name": name}
        raw.attrs.update(marks)
        file.attrs.update(marks | {"comment": scan.about.get("comment", "")})
        if "date" in scan.about:
            file.attrs["date"] = scan.about["date"]


def _rate(scan: Scan) -> float:
    """Sampling rate of a record that begins at time 0, as PATATO's do, in the scan's unit."""
    rate = rate_of(scan, "PATATO")
    first = float(np.ravel(scan.known.get("times", 0.0))[0])
    if "sampling_rate" not in scan.known and abs(first) * rate > 0.5:
        raise ValueError(f"PATATO's records begin at time 0, this one at {first:g}: write .h5.")
    return rate


def _response(scan: Scan) -> np.ndarray:
    """Impulse response as long as the record, time 0 in the middle; an impulse if it is unknown."""
    n = scan.n_samples
    own = scan.known.get("impulse_response", np.ones(1))
    if own.ndim > 1:
        raise ValueError("PATATO has one impulse response of all elements: write .h5.")
    response, first = np.zeros(n), n // 2 - len(own) // 2
    kept = slice(max(-first, 0), max(-first, 0) + min(len(own), n - max(first, 0)))
    at = max(first, 0)
    response[at : at + len(own[kept])] = own[kept]
    return response


def _extend(path: Path, added: Path | None) -> None:
    """Add images to a file, which another process opens; with None, check that they can be."""
    with refusing(f"cannot add to {name_of(path)}: "):
        read_file("add_images", path, Allowance(), added=added and str(added))
