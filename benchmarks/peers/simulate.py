"""Pressure records of the phantoms by k-Wave, for all arrays at once; in k-Wave's environment.

    python simulate.py FOLDER

writes FOLDER/PHANTOM.npz with `record` (detectors of all arrays, samples), `sampling_rate` and
`sound_speed`, and FOLDER/BODY.npz for the vessels in a body of another speed, of one array. The
grid, of 0.15 mm, is none of those on which images are made.
"""

import sys
from pathlib import Path

import numpy as np
from arrays import ARRAYS
from kwave_without_downloads import solve
from phantoms import BODIES, IN_BODY, MM, PHANTOMS, image

SPACING, HALF_WIDTH, SOUND_SPEED = 0.15e-3, 24.9e-3, 1500.0
STEP = 0.05e-3  # of the path of sound, from sample to sample [m]
RIM = 0.8 * SPACING  # of a body, over which the speed changes [m]
LONGEST = 36.5e-3  # path from an image's corner to the farthest detector, and more [m]


def main(folder: Path) -> None:
    x = np.arange(-HALF_WIDTH, HALF_WIDTH + SPACING / 2, SPACING)
    times = np.arange(0, LONGEST, STEP) / SOUND_SPEED
    everywhere = np.concatenate(list(ARRAYS.values()))
    cases = {name: (name, SOUND_SPEED, everywhere) for name in PHANTOMS}
    for name, (*middle, a, b) in BODIES.items():
        u, v = ((x - MM * at) / (MM * half) for at, half in zip(middle, (a, b), strict=True))
        depth = (1 - np.hypot(u[:, None], v)) * MM * min(a, b) / RIM
        speed = SOUND_SPEED + (IN_BODY - SOUND_SPEED) / (1 + np.exp(-depth.clip(-60, 60)))
        cases[name] = "vessels", speed, ARRAYS["arc270"]
    for name, (phantom, speed, detectors) in cases.items():
        record = solve(x, times, speed, detectors, p0=image(phantom, x, x))
        np.savez(
            folder / f"{name}.npz",
            record=record.astype(np.float32),
            sampling_rate=SOUND_SPEED / STEP,
            sound_speed=SOUND_SPEED,
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
