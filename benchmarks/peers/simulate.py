"""Pressure records of the phantoms by k-Wave, for all arrays at once; in k-Wave's environment.

    python simulate.py FOLDER

writes FOLDER/PHANTOM.npz with `record` (detectors of all arrays, samples), `sampling_rate` and
`sound_speed`. The grid, of 0.15 mm, is none of those on which images are made.
"""

import sys
from pathlib import Path

import numpy as np
from arrays import ARRAYS
from kwave_without_downloads import solve
from phantoms import PHANTOMS, image

SPACING, HALF_WIDTH, SOUND_SPEED = 0.15e-3, 24.9e-3, 1500.0
STEP = 0.05e-3  # of the path of sound, from sample to sample [m]
LONGEST = 36.5e-3  # path from an image's corner to the farthest detector, and more [m]


def main(folder: Path) -> None:
    x = np.arange(-HALF_WIDTH, HALF_WIDTH + SPACING / 2, SPACING)
    times = np.arange(0, LONGEST, STEP) / SOUND_SPEED
    detectors = np.concatenate(list(ARRAYS.values()))
    for name in PHANTOMS:
        record = solve(x, times, SOUND_SPEED, detectors, p0=image(name, x, x))
        np.savez(
            folder / f"{name}.npz",
            record=record.astype(np.float32),
            sampling_rate=SOUND_SPEED / STEP,
            sound_speed=SOUND_SPEED,
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
