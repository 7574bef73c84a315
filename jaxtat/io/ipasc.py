"""The exchange format of the International Photoacoustic Standardisation Consortium, in HDF5.

``/binary_time_series_data`` is (detectors, samples, wavelengths, measurements), in older files
(detectors, samples, wavelengths or measurements). ``/meta_data`` and ``/meta_data_device`` hold a
dataset for each thing known, in SI units; "None" (text) stands for what is not. Detectors are
groups in ``/meta_data_device/detectors`` with a number each, in the order of the data's rows. A
frequency response there is magnitudes, without the phase that a model of the record needs.

Frame number m W + w of a scan is measurement m at the w-th of W wavelengths.

Source: J. Groehl, L. Hacker, B. T. Cox et al., The IPASC data format: A consensus data format for
photoacoustic imaging, Photoacoustics 26 (2022) 100339.
"""

import re
import uuid
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..base.atomic import replacing
from .file_contents import FileContents
from .hdf5 import Hdf5File, creating_hdf5, open_hdf5
from .scan import OF_ELEMENTS, Kind, Scan
from .series import period, rate_of

_DATA, _META, _DEVICE = "binary_time_series_data", "meta_data", "meta_data_device"
# texts that are kept, by their names in `Scan.about`
_ABOUT = {
    "device": f"{_DEVICE}/general/unique_identifier",
    "uuid": f"{_META}/uuid",
    "reference": f"{_META}/photoacoustic_imaging_device_reference",
    "coupling agent": f"{_META}/acoustic_coupling_agent",
    "scanning method": f"{_META}/scanning_method",
}
# things for which the format has no name of its own: further meta data, as it allows
_FURTHER = ("times", "radii", "impulse_response")
# what each detector has, by the names of `Scan.known`
_OF_DETECTORS = {
    "detectors": "detector_position",
    "normals": "detector_orientation",
    "frequency_response": "frequency_response",
}
_GEOMETRY, _TYPE = "detector_geometry", "detector_geometry_type"
_ROUND = "CIRCULAR", "CIRCLE"  # PACFISH writes the first and draws the second
_LONGEST = 1.5  # of a rectangle's sides over the other one, to count as a square
_UNIT = 1e-2  # by which the length of a direction may be off 1


def is_ipasc(path: Path) -> bool:
    """Whether an HDF5 file has IPASC's data."""
    return open_hdf5(path).is_dataset(_DATA)


def read_ipasc(path: Path, kind: Kind | None) -> FileContents:
    """Pressure with all that `Scan.known` has a name for; of many frames those that are wanted.

    Zero, NaN and "None" stand for an unknown sampling rate or speed of sound. Wavelengths, metres
    by the standard, are often nanometres: those below 1 mm are taken for metres, those from 100 up
    for nanometres, others are left out, as are those whose number is not the data's. Orientations
    of length 1 are normals; others may be angles and are left out. Elements of the types CIRCULAR,
    and CUBOID with its thickness along x3 and sides that differ by half at most, have the size that
    the file gives; `Scan.about` says what is left out.

    What `save_ipasc` writes has a checksum over the data; otherwise, unless it is compressed, a
    wrong number cannot be told.
    """
    if kind == "circular_integrals":
        raise ValueError("IPASC files hold pressure, expected circular integrals.")
    file, about = open_hdf5(path), {"format": "IPASC"}
    about |= {name: text for name, where in _ABOUT.items() if (text := file.text(where))}
    n, wavelengths = _wavelengths(file)
    shape = file.shape(_DATA)
    if not 2 <= len(shape) <= 4:
        raise ValueError(
            f"{_DATA} has shape {shape}, expected (detectors, samples, wavelengths, measurements)."
        )
    axes = len(shape)
    if axes == 3 and shape[2] != n:  # measurements
        shape = (*shape[:2], 1, shape[2])
    rows, columns, colours, measurements = (*shape, 1, 1)[:4]
    known, left_out = _detectors(file, rows)
    about |= left_out
    for name in (*_FURTHER, *OF_ELEMENTS):  # sizes as jaxtat wrote them until 0.3
        known |= _optional(name, file, f"{_META}/{name}")
    for name, tag in (("sampling_rate", "ad_sampling_rate"), ("sound_speed", "speed_of_sound")):
        value = _optional(name, file, f"{_META}/{tag}").get(name)
        if value is not None and np.isfinite(value).all() and value.any():
            known[name] = value.reshape(()) if value.size == 1 else value
    known |= _optional("field_of_view", file, f"{_DEVICE}/general/field_of_view")
    if wavelengths is not None and n == colours:
        known["wavelengths"] = np.tile(wavelengths, measurements)
    elif n:
        about["wavelengths"] = f"{n} left out: no wavelengths, or not of these data"
    known |= _energies(file, colours, measurements)

    def part(number: int) -> tuple[Any, ...]:
        """Of a frame, in the order of measurements, and of wavelengths within each."""
        measurement, colour = divmod(number, colours)
        last = (colour, measurement)
        if axes < 4:  # the axis that is not there has size 1
            last = last[:1] if measurements == 1 else last[1:]
        return (slice(None), slice(None), *last)[:axes]

    frames = file.frames(_DATA, (colours * measurements, rows, columns), part)
    return FileContents(about, known, frames)


def save_ipasc(path: str | Path, scan: Scan) -> None:
    """Write pressure as IPASC HDF5, one frame after the other, with a checksum over the data.

    All that `Scan.known` holds is kept; what the format has no name for (times, radii, impulse
    response) stands beside its meta data. Of wavelengths the shortest series that repeats becomes
    an axis. Detectors in the plane get a third coordinate 0, normals the length 1, and of
    ``scan.about`` the device, its identifiers, coupling agent and method are kept.

    Args:
        path: the file, whole or untouched.
        scan: pressure with a sampling rate, or with times at equal steps.

    Raises:
        ValueError: for circular integrals, for a scan without either, and for a folder that does
            not exist.

    >>> import tempfile
    >>> from jaxtat.io import load_scan
    >>> path = Path(tempfile.mkdtemp()) / "scan.hdf5"
    >>> data = np.arange(24.0).reshape(2, 3, 4)
    >>> save_ipasc(path, Scan("pressure", data, {"sampling_rate": 4e7, "wavelengths": [700, 800]}))
    >>> scan = load_scan(path)
    >>> bool((scan.data[:] == data).all()), scan.known["wavelengths"]
    (True, array([700., 800.]))
    """
    if scan.kind != "pressure":
        raise ValueError(f"IPASC files hold pressure, this scan has {scan.kind}.")
    rate = rate_of(scan, "IPASC")
    wavelengths = scan.known.get("wavelengths")
    colours = 1 if wavelengths is None else period(wavelengths)
    rows, columns = scan.data.shape[-2:]
    shape = (rows, columns, colours, scan.n_frames // colours)
    with replacing(path) as temporary, creating_hdf5(temporary) as file:
        data = file.create_dataset(
            _DATA, shape, scan.data.dtype, chunks=(rows, columns, 1, 1), fletcher32=True
        )
        for number in range(scan.n_frames):
            data[:, :, number % colours, number // colours] = scan.frame(number)
        meta = {
            "ad_sampling_rate": rate,
            "speed_of_sound": scan.known.get("sound_speed"),
            "acquisition_wavelengths": None if wavelengths is None else wavelengths[:colours] / 1e9,
            "data_type": str(scan.data.dtype),
            "dimensionality": "time",
            "sizes": np.array(shape),
            "encoding": "UTF-8",
            "compression": "raw",
        }
        meta |= {name: scan.known.get(name) for name in _FURTHER}
        if "laser_energy" in scan.known:
            meta["pulse_energy"] = scan.known["laser_energy"].reshape(-1, colours) / 1e3
        for name, value in meta.items():
            _write(file, f"{_META}/{name}", value)
        about = {"uuid": str(uuid.uuid4()), "device": "None", **scan.about}
        for name, where in _ABOUT.items():
            _write(file, where, about.get(name))
        _write_device(file, scan)


def _detectors(file: Hdf5File, rows: int) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """What all detectors have, in the order of their numbers, and what is left out of it, why."""
    folder = f"{_DEVICE}/detectors"
    names = sorted(file.names(folder), key=_number)
    if not names:
        return {}, {}
    if len({_number(name) for name in names}) < len(names) or len(names) != rows:
        raise ValueError(
            f"it has {len(names)} detectors, {names[0]} to {names[-1]}, but data of {rows}."
        )
    known = {}
    for thing, tag in _OF_DETECTORS.items():
        arrays = _of_each(file, [f"{folder}/{name}/{tag}" for name in names])
        there = [array is not None for array in arrays]
        if all(there):
            shapes = {array.shape for array in arrays}
            if len(shapes) == 1 and (thing == "detectors" or _fits(thing, arrays)):
                known[thing] = np.stack(arrays)
            elif thing == "detectors":
                raise ValueError(f"its detector positions have shapes {sorted(shapes)}.")
        elif any(there) and thing == "detectors":
            raise ValueError(f"it has no position of detector {names[there.index(False)]}.")
    sizes, why = _sizes(file, [f"{folder}/{name}" for name in names])
    left_out = {"elements": f"their sizes are left out: {why}"} if why else {}
    lengths = np.linalg.norm(known.get("normals", np.eye(3)), axis=1)
    if not np.allclose(lengths, 1, rtol=0, atol=_UNIT):
        del known["normals"]
        left_out["orientations"] = "left out: no directions of length 1"
    return known | sizes, left_out


def _of_each(file: Hdf5File, places: list[str]) -> list[Any]:
    """Numbers under each name, None where there are none."""
    return [file.read(place) if file.has_numbers(place) else None for place in places]


def _sizes(file: Hdf5File, places: list[str]) -> tuple[dict[str, np.ndarray], str]:
    """Radii of round elements or sides of square ones [m]; or why there are none, if there is more.

    A rectangle of the sides a and b has the mean second moment of a square of the side
    √((a² + b²)/2).
    """
    types = sorted({file.text(f"{place}/{_TYPE}") or "no type" for place in places})
    sizes = _of_each(file, [f"{place}/{_GEOMETRY}" for place in places])
    if types == ["no type"] and not any(size is not None for size in sizes):
        return {}, ""
    numbers = {0 if size is None else size.size for size in sizes}
    wanted = 1 if types[0] in _ROUND else 3
    if len(types) > 1 or types[0] not in (*_ROUND, "CUBOID") or numbers != {wanted}:
        counts = " and ".join(map(str, sorted(numbers)))
        said = f"of type {' and '.join(types)} with {counts} numbers each"
        return {}, f"{said}, expected CIRCULAR with 1, or CUBOID with 3"
    sizes = np.reshape(sizes, (len(places), wanted)).astype(float)
    if not (np.isfinite(sizes).all() and (sizes[:, :2] > 0).all()):
        return {}, "not all are above zero"
    if types[0] in _ROUND:
        return {"element_radius": _one_if_all_equal(sizes[:, 0])}, ""
    short, long = np.sort(sizes[:, :2], axis=1).T
    if not ((sizes[:, 2] <= short) & (long <= _LONGEST * short)).all():
        return {}, f"thicker along x3 than wide, or one side over {_LONGEST} of the other"
    return {"element_size": _one_if_all_equal(np.sqrt((short**2 + long**2) / 2))}, ""


def _one_if_all_equal(values: np.ndarray) -> np.ndarray:
    return values if np.ptp(values) else values[0]


def _fits(thing: str, arrays: list[np.ndarray]) -> bool:
    """Whether they are directions, or frequencies above responses."""
    if thing == "normals":
        return arrays[0].shape == (3,) and all(np.isfinite(a).all() and a.any() for a in arrays)
    return arrays[0].ndim == 2 and arrays[0].shape[0] == 2


def _number(name: str) -> int:
    """The number in a detector's name, by which they are in order: "detection_element_10" is 10."""
    numbers = re.findall(r"\d+", name)
    if not numbers:
        raise ValueError(f"its detector {name!r} has no number.")
    return int(numbers[-1])


def _wavelengths(file: Hdf5File) -> tuple[int, np.ndarray | None]:
    """How many wavelengths are named, and which [nm], or None."""
    values = _optional("wavelengths", file, f"{_META}/acquisition_wavelengths").get(
        "wavelengths", np.empty(0)
    )
    values = values.reshape(-1).astype(float)
    if (values > 0).all() and (values < 1e-3).all():
        return len(values), np.round(values * 1e9, 6)  # 700 was written as 7e-7: 700 again
    usable = (values >= 100).all() and np.isfinite(values).all()
    return len(values), values if usable else None


def _energies(file: Hdf5File, colours: int, measurements: int) -> dict[str, np.ndarray]:
    """Pulse energies [mJ], one for each frame or wavelength; empty if any is unknown."""
    energies = _optional("laser_energy", file, f"{_META}/pulse_energy").get(
        "laser_energy", np.empty(0)
    )
    n = colours * measurements
    if energies.size == colours < n:
        energies = np.tile(energies.reshape(-1), measurements)
    elif energies.shape == (colours, measurements) != (measurements, colours):
        energies = energies.T
    usable = energies.size == n and np.isfinite(energies).all() and (energies > 0).all()
    return {"laser_energy": 1e3 * energies.reshape(-1)} if usable else {}


def _optional(name: str, file: Hdf5File, where: str) -> dict[str, np.ndarray]:
    return {name: file.read(where)} if file.has_numbers(where) else {}


def _write_device(file: h5py.File, scan: Scan) -> None:
    """Detectors with their numbers in ten digits, so that they are in order as text too."""
    general = f"{_DEVICE}/general"
    _write(file, f"{general}/field_of_view", scan.known.get("field_of_view", "None"))
    _write(file, f"{general}/num_detectors", scan.n_detectors)
    _write(file, f"{general}/num_illuminators", 0)
    file.create_group(f"{_DEVICE}/illuminators")
    positions = scan.known.get("detectors")
    if positions is not None and positions.shape[1] == 2:
        positions = np.pad(positions, ((0, 0), (0, 1)))
    kept = {_OF_DETECTORS[t]: v for t, v in scan.known.items() if t in _OF_DETECTORS}
    kept["detector_position"] = ["None"] * scan.n_detectors if positions is None else positions
    if "normals" in scan.known:
        lengths = np.linalg.norm(scan.known["normals"], axis=1, keepdims=True)
        kept[_OF_DETECTORS["normals"]] = scan.known["normals"] / np.where(lengths, lengths, 1)
    kept |= _geometry(scan)
    for number in range(scan.n_detectors):
        for tag, values in kept.items():
            _write(file, f"{_DEVICE}/detectors/{number:010d}/{tag}", values[number])


def _geometry(scan: Scan) -> dict[str, Any]:
    """Type and size of each element, those of a square without thickness; empty if unknown."""
    size = next((name for name in OF_ELEMENTS if name in scan.known), None)
    if size is None:
        return {}
    values = np.broadcast_to(scan.known[size], scan.n_detectors).astype(float)
    if size == "element_radius":
        return {_TYPE: [_ROUND[0]] * len(values), _GEOMETRY: values}
    return {_TYPE: ["CUBOID"] * len(values), _GEOMETRY: values[:, None] * [1, 1, 0]}


def _write(file: h5py.File, where: str, value: Any) -> None:
    """What is known; "None" is only for what must be there."""
    if value is not None:
        file[where] = value
