"""Records of blood at several wavelengths and energies: exact but for what is asked for."""

from functools import cache
from pathlib import Path

import h5py
import numpy as np

from jaxtat import detector_curve, phantoms
from jaxtat.io import Scan

RADIUS, SPEED, RATE, N = 0.04, 1500.0, 4e6, 90
N_TIMES = 230
WAVELENGTHS = np.array([700.0, 760.0, 800.0, 850.0])
HB, HBO2 = np.array([1794.3, 1548.5, 761.7, 691.3]), np.array([290.0, 586.0, 816.0, 1058.0])
ENERGIES = np.array([[70.0, 140.0, 60.0, 90.0], [75.0, 30.0, 66.0, 120.0]])
SATURATIONS = np.array([0.9, 0.5, 0.3])  # of the bells
BELLS = {"centers": [[2e-3, 3e-3], [-4e-3, -1e-3], [1e-3, -5e-3]], "radii": [4e-3, 3e-3, 2.5e-3]}
# one size for all tests, and none of it chosen by the record
CENTER = (5e-4, -1e-3)
GIVEN = {
    "region_center": CENTER,
    "region_radius": 0.011,
    "pixels": 45,
    "max_frequency": 3500.0,
    "alpha": 1e-3,
    "inversion": "fourier",
}
OPTIONS = " ".join(
    f"--{name.replace('_', '-')} {' '.join(map(str, np.ravel(value)))}"
    for name, value in GIVEN.items()
)


def positions(plane=(0, 1)):
    """An arc of 270 degrees in a coordinate plane, (90, 3) [m]."""
    theta = np.radians(90.0 + np.linspace(-135, 135, N))
    places = np.zeros((N, 3))
    places[:, plane] = RADIUS * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    return places


def record(amplitudes, times, places=None):
    """p with g = r ∫_0^r p dr': p = d(g/r)/dr, by differences of exact integrals."""
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"], amplitudes)
    radii, h = np.maximum(SPEED * times, 1e-3), 1e-6
    both = np.concatenate([radii - h / 2, radii + h / 2])
    curve = detector_curve(positions()[:, :2] if places is None else places)
    means = np.asarray(bells.circular_integrals(curve, both)) / both
    return (means[:, len(radii) :] - means[:, : len(radii)]) / h


@cache
def light(noise=1e-3):
    """Records of two rounds (2, 4, detectors, samples), with the same noise whatever the energy."""
    times = np.arange(N_TIMES) / RATE
    parts = np.stack([record(SATURATIONS, times), record(1 - SATURATIONS, times)])
    pressure = np.tensordot(np.stack([HBO2, HB], axis=1), parts, 1)
    size = noise * np.abs(pressure).max()
    clean = ENERGIES[..., None, None] * pressure
    found = clean + size * np.random.default_rng(0).standard_normal(clean.shape)
    found.flags.writeable = False
    return found


def spectral_scan(data, plane=(0, 1), **known):
    """The scan of frames that follow each other."""
    rate = RATE * data.shape[-1] // N_TIMES
    facts = {"detectors": positions(plane), "sampling_rate": rate, "sound_speed": SPEED}
    facts |= {"wavelengths": np.tile(WAVELENGTHS, 2), "laser_energy": ENERGIES.ravel()}
    return Scan("pressure", data.reshape(-1, *data.shape[2:]), facts | known, {"name": "blood"})


def write_named(path: Path, scan: Scan):
    np.savez(path, pressure=scan.data, **scan.known)
    return path


def write_patato(path: Path, data, energies=ENERGIES, speed=SPEED, plane=(0, 1)):
    """As PATATO's own importer does, with a region of interest that a person drew."""
    with h5py.File(path, "w") as file:
        file["raw_data"] = data
        rate = RATE * data.shape[-1] // N_TIMES
        file["raw_data"].attrs.update({"fs": rate, "name": "blood"})
        if speed is not None:
            file["raw_data"].attrs["speedofsound"] = speed
        for name, value in {
            "GEOMETRY": positions(plane),
            "OverallCorrectionFactor": energies,
            "TEMPERATURE": np.full(data.shape[:2], 36.0),
            "irf": np.eye(1, data.shape[-1], data.shape[-1] // 2)[0],
        }.items():
            file.create_dataset(name, data=value, compression="gzip")
        for name in ("Z-POS", "RUN", "REPETITION", "timestamp"):
            file[name] = np.repeat(np.arange(len(data))[:, None], data.shape[1], axis=1)
        file["wavelengths"] = WAVELENGTHS
        file["water-absorption-coefficients"] = np.zeros(len(WAVELENGTHS))
        file["water-absorption-coefficients"].attrs["pathlength"] = 0.0
        file.attrs["comment"] = "as it came"
        vessel = file.create_dataset("rois/vessel_left/0", data=1e-3 * square((2, 3), 1.5))
        vessel.attrs.update({"class": "vessel", "position": "left", "z": 0.0, "run": 0})
        vessel.attrs.update({"repetition": 0, "generated": False})
    return path


def square(center, half):
    return np.array(center) + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
