"""Scans in PATATO's HDF5: time series, and beside them whatever was made of them.

``/raw_data`` is (frames, wavelengths, detectors, samples) with the sampling rate [Hz] as its
attribute ``fs``, and ``speedofsound`` [m/s] if it was set. ``/GEOMETRY`` are positions [m],
``/wavelengths`` [nm], ``/irf`` the impulse response with its time 0 in the middle, and
``/OverallCorrectionFactor``, else ``/POWER``, (frames, wavelengths) the energies by which PATATO
divides. Frame number f W + w of a scan is frame f at the w-th of W wavelengths.

Source: PATATO 0.7, patato.io.attribute_tags and patato.io.hdf; T. R. Else, J. Groehl, L. Hacker and
S. E. Bohndiek, PATATO, J. Open Source Softw. 9 (2024) 5686.
"""

from functools import partial
from pathlib import Path

import h5py
import numpy as np

from .hdf5 import Hdf5File, is_hdf5, open_hdf5, read_part
from .limits import Allowance
from .scan import Kind, Scan

RAW, GEOMETRY, WAVELENGTHS, RESPONSE = "raw_data", "GEOMETRY", "wavelengths", "irf"
ENERGIES = ("OverallCorrectionFactor", "POWER")
RATE, SPEED = "fs", "speedofsound"


def is_patato(path: Path, start: bytes) -> bool:
    if not is_hdf5(path):
        return False
    try:
        with open_hdf5(path, Allowance()) as file:
            return {RAW, GEOMETRY} <= set(file.datasets())
    except (OSError, RuntimeError, LookupError):
        return False  # damaged: whoever reads it next says how


def load_patato(path: Path, kind: Kind | None, allowance: Allowance) -> Scan:
    """Pressure with positions, rate, wavelengths, energies and response; frames when asked for.

    Energies that are not all above zero count as unknown, as does a speed of sound that is no
    number. PATATO writes no checksums: wrong numbers are not detected.
    """
    if kind == "circular_integrals":
        raise ValueError("PATATO files hold pressure, expected circular integrals.")
    with open_hdf5(path, allowance) as file:
        shape = file.shape(RAW)
        if len(shape) != 4:
            raise ValueError(
                f"{RAW} has shape {shape}, expected (frames, wavelengths, detectors, samples)."
            )
        frames, colours, rows, columns = shape
        known = {"detectors": file.read(GEOMETRY), "sampling_rate": file.attribute(RAW, RATE)}
        speed = _number(file, SPEED)
        if speed is not None:
            known["sound_speed"] = speed
        if file.has_numbers(RESPONSE):
            known["impulse_response"] = file.read(RESPONSE).reshape(-1)
        known |= _of_frames(file, frames, colours)
        data = file.frames(RAW, (frames * colours, rows, columns), partial(_read_frames, colours))
    single = len(data) == 1
    return Scan("pressure", data[0] if single else data, known, {"format": "PATATO"})


def _number(file: Hdf5File, name: str) -> float | None:
    """An attribute of the data if it is a number above zero."""
    try:
        value = file.attribute(RAW, name)
    except ValueError:
        return None
    usable = isinstance(value, int | float) and np.isfinite(value) and value > 0
    return float(value) if usable else None


def _of_frames(file: Hdf5File, frames: int, colours: int) -> dict[str, np.ndarray]:
    """Wavelengths [nm] and energies of all frames, one after the other."""
    known = {}
    if file.has_numbers(WAVELENGTHS):
        wavelengths = file.read(WAVELENGTHS).reshape(-1)
        if len(wavelengths) != colours:
            raise ValueError(f"it has {len(wavelengths)} wavelengths, but data of {colours}.")
        if (wavelengths > 0).all():  # zero stands for one that is not known
            known["wavelengths"] = np.tile(wavelengths, frames)
    for name in ENERGIES:
        if file.has_numbers(name):
            energies = file.read(name)
            if energies.shape == (frames, colours) and (energies > 0).all():
                return known | {"laser_energy": energies.reshape(-1)}
    return known


def _read_frames(colours: int, dataset: h5py.Dataset, numbers: np.ndarray) -> np.ndarray:
    _, _, rows, columns = dataset.shape
    found = np.empty((len(numbers), rows, columns), dataset.dtype.newbyteorder("="))
    for place, number in enumerate(numbers.tolist()):
        frame, colour = divmod(number, colours)
        ends = (slice(frame, frame + 1), slice(colour, colour + 1))
        box = (*ends, slice(0, rows), slice(0, columns))
        found[place] = read_part(RAW, dataset, box)[0, 0]
    return found
