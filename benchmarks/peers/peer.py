"""What the script of every peer does alike: a problem in, an image with its cost out.

    python PEER.py PROBLEM.npz OUT.npz

A problem is a pressure record, from time 0:
    record (detectors, samples), detectors (detectors, 2 or 3) [m], sampling_rate [Hz],
    sound_speed [m/s], half_width [m] and pixels: the image is wanted at the nodes of
    linspace(-half_width, half_width, pixels) along x and y, as image[x, y], or z too,
    and of a body of another speed water_speed, around it, and body, x, y, radius and speed, of
    which few are told.
NumPy is all that this file needs: it runs in the environment of every peer.
"""

import importlib.metadata
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

AGAIN = 60.0  # what took longer once is not run again [s]
# of the peak of memory that the system tells: bytes in macOS, else 1024 bytes
UNITS_PER_MIB = 2**20 if sys.platform == "darwin" else 2**10


@dataclass(frozen=True)
class Problem:
    """What a peer is given."""

    record: np.ndarray
    detectors: np.ndarray
    sampling_rate: float
    sound_speed: float
    half_width: float
    pixels: int
    water_speed: float | None = None
    body: np.ndarray | None = None

    @property
    def in_space(self) -> bool:
        """Whether a volume is wanted."""
        return self.detectors.shape[1] == 3

    @property
    def axis(self) -> np.ndarray:
        """The pixels' coordinates along x and y [m]."""
        return np.linspace(-self.half_width, self.half_width, self.pixels)

    @property
    def times(self) -> np.ndarray:
        """Of the samples [s]."""
        return np.arange(self.record.shape[1]) / self.sampling_rate


class NotForThis(Exception):
    """The problem is none for this method: the reason."""


def load(path: str) -> Problem:
    """A problem of a file."""
    with np.load(path) as file:
        return Problem(
            file["record"].astype(np.float64),
            file["detectors"],
            *(float(file[name]) for name in ("sampling_rate", "sound_speed", "half_width")),
            int(file["pixels"]),
            float(file["water_speed"]) if "water_speed" in file else None,
            file.get("body"),
        )


def run(
    package: str,
    reconstruct: Callable[[Problem], np.ndarray],
    *,
    version: str = "",
    compiles: bool = True,
) -> None:
    """Reconstructs twice, the first time with all that compiles, and writes what it cost.

    Once is enough where nothing compiles. Seconds are those of processors, of all threads: the
    clock's depend on what else a machine has to do.
    """
    problem, seconds = load(sys.argv[1]), []
    image = None
    try:
        while not seconds or (compiles and len(seconds) == 1 and seconds[0] < AGAIN):
            start = time.process_time()
            image = np.asarray(reconstruct(problem))
            seconds.append(time.process_time() - start)
    except NotForThis as reason:
        np.savez(sys.argv[2], reason=str(reason))
        return
    np.savez(
        sys.argv[2],
        image=image,
        seconds=seconds,
        memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / UNITS_PER_MIB,
        version=version or importlib.metadata.version(package),
    )
