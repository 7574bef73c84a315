"""The scan that is looked at: six frames of two wavelengths, in sizes that other tests use."""

import h5py
import numpy as np
from made_scans import RATE, SPEED, N, positions, raw_counts, record

GIVEN = {"region_radius": 0.011, "pixels": 45, "max_frequency": 3500.0, "band": (2e4, 1.5e6)}
GIVEN |= {"alpha": 1e-2, "dead_time": 4e-6}
OPTIONS = (
    "--region-radius 0.011 --pixels 45 --max-frequency 3500 --band 2e4 1.5e6 --alpha 1e-2 "
    "--dead-time 4e-6"
)


def write_scan(path):
    """With a dead detector."""
    with h5py.File(path, "w") as file:
        frames = np.stack([raw_counts(record(), 0.01, seed) for seed in range(6)])
        frames[:, N // 3] = 32768
        file["pressure"] = frames
        file["detectors"] = positions()
        file["sampling_rate"], file["sound_speed"] = RATE, SPEED
        file["wavelengths"] = np.tile([700.0, 850.0], 3)
        file["laser_energy"] = np.array([40.0, 70.0, 41.0, 72.0, 39.0, 71.0])
    return path


def relative(one, other):
    return float(np.abs(np.asarray(one) - other).max() / np.abs(other).max())
