"""Scans in PATATO's HDF5: time series, and the images made from them.

``/raw_data`` is (frames, wavelengths, detectors, samples) with the sampling rate [Hz] as its
attribute ``fs``, and ``speedofsound`` [m/s] if it was set. ``/GEOMETRY`` are positions [m],
``/wavelengths`` [nm], ``/irf`` the impulse response with its time 0 in the middle, and
``/OverallCorrectionFactor``, else ``/POWER``, (frames, wavelengths) the energies by which PATATO
divides. Frame number f W + w of a scan is frame f at the w-th of W wavelengths.

Source: PATATO 0.7, patato.io.attribute_tags and patato.io.hdf; T. R. Else, J. Groehl, L. Hacker and
S. E. Bohndiek, PATATO, J. Open Source Softw. 9 (2024) 5686.
"""

import itertools
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5o  # pyright: ignore[reportAttributeAccessIssue]

from .file_contents import FileContents
from .hdf5 import Hdf5File, open_hdf5
from .scan import Kind

RAW, GEOMETRY, WAVELENGTHS, RESPONSE = "raw_data", "GEOMETRY", "wavelengths", "irf"
ENERGIES = ("OverallCorrectionFactor", "POWER")
RATE, SPEED = "fs", "speedofsound"
NAME = "jaxtat"  # of our groups of images
IMAGES, BESIDE = "images", "beside"  # in a file of images that are added


def is_patato(path: Path) -> bool:
    """Whether an HDF5 file has PATATO's datasets."""
    file = open_hdf5(path)
    return file.is_dataset(RAW) and file.is_dataset(GEOMETRY)


def read_patato(path: Path, kind: Kind | None) -> FileContents:
    """Pressure with positions, rate, wavelengths, energies and response; frames when wanted.

    Energies that are not all above zero count as unknown, as does a speed of sound that is no
    number. PATATO writes no checksums: wrong numbers are not detected.
    """
    if kind == "circular_integrals":
        raise ValueError("PATATO files hold pressure, expected circular integrals.")
    file = open_hdf5(path)
    shape = file.shape(RAW)
    if len(shape) != 4:
        raise ValueError(
            f"{RAW} has shape {shape}, expected (frames, wavelengths, detectors, samples)."
        )
    frames, colours, rows, columns = shape
    rate = file.attribute(RAW, RATE)
    if not isinstance(rate, int | float):
        raise ValueError(f"{RAW} has the sampling rate {rate!r:.40} ({RATE}), expected a number.")
    known: dict[str, Any] = {"detectors": file.read(GEOMETRY), "sampling_rate": rate}
    speed = file.attribute(RAW, SPEED)
    if isinstance(speed, int | float) and np.isfinite(speed) and speed > 0:
        known["sound_speed"] = speed
    if file.has_numbers(RESPONSE):
        known["impulse_response"] = file.read(RESPONSE).reshape(-1)
    known |= _of_frames(file, frames, colours)
    data = file.frames(RAW, (frames * colours, rows, columns), lambda n: divmod(n, colours))
    return FileContents({"format": "PATATO"}, known, data)


def add_images(path: Path, added: str | None) -> FileContents:
    """Copy images, and what belongs to them, into a file under the first number that is free.

    Args:
        path: a file of PATATO's.
        added: a file with `IMAGES` and `BESIDE`; None only to check that they can be added.

    Raises:
        ValueError: where a group that they go to is a link, has another name too, or is none:
            something else, even another file, would be written to.
    """
    places = f"recons/{NAME}", NAME
    with h5py.File(path, "r+" if added else "r", locking=False) as file:
        for place in ("recons", *places):
            _require_own_group(file, place)
        if added:
            groups = [file.require_group(place) for place in places]
            numbers = map(str, itertools.count())
            number = next(n for n in numbers if not any(n in group for group in groups))
            with h5py.File(added) as source:
                for part, group in zip((IMAGES, BESIDE), groups, strict=True):
                    source.copy(part, group, number)
    return FileContents()


def _require_own_group(file: h5py.File, place: str) -> None:
    link = file.get(place, getlink=True)
    if link is None:
        return
    if not isinstance(link, h5py.HardLink):
        raise ValueError(f"/{place} is a link to elsewhere.")
    item = file[place]
    if not isinstance(item, h5py.Group):
        raise ValueError(f"/{place} is no group.")
    if h5o.get_info(item.id).rc > 1:
        raise ValueError(f"/{place} is a second name of another group.")


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
