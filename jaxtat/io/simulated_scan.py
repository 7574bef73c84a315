"""A small simulated scan, written as a scanner would write it.

The detectors are those of a ring of 40 mm that leaves a quarter open, focused into its plane; the
record has a scanner's band, noise, offset and whole counts, and its file has no speed of sound.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt16

from ..base.atomic import replacing
from ..base.checks import require_x64
from ..geometry import detector_curve
from ..phantoms import Disks
from ..records import circular_integrals_to_pressure, condition_record

SOUND_SPEED = 1510.0
"""Speed of sound of the simulation [m/s], which is not in the file."""

_RADIUS, _SPAN, _N_DETECTORS = 40e-3, np.radians(270.0), 256
_RATE, _N_SAMPLES = 40e6, 1600
_BAND = (1e5, 6e6)  # of the elements [Hz]
_OFFSET, _LARGEST, _NOISE = 2048, 1500, 8.0  # [counts]
_STEP = 5e-5  # of the radii [m]: half the shortest wave of the band would be 0.13 mm


def sample_phantom() -> Disks:
    """What the sample shows: a body of 17 mm with organs and vessels in it [m].

    >>> import jax.numpy as jnp
    >>> float(sample_phantom()(jnp.array([0.0, 0.0])))
    1.0
    """
    parts = np.array(
        [  # x1, x2, radius [mm], amplitude
            [0.0, 0.0, 8.5, 1.0],
            [-3.2, 2.4, 2.6, 0.8],
            [3.6, 2.0, 1.8, -0.5],
            [2.4, -3.4, 2.2, 0.6],
            [-3.4, -3.2, 1.2, 1.5],
            [0.3, 5.8, 0.5, 4.0],
            [-6.2, -0.6, 0.35, 4.0],
            [6.3, -1.4, 0.35, 4.0],
            [0.4, -6.4, 0.7, 3.0],
        ]
    )
    return Disks(1e-3 * parts[:, :2], 1e-3 * parts[:, 2], parts[:, 3])


def sample_positions() -> Float[np.ndarray, "detectors 3"]:
    """Detectors on 270 degrees of a circle of 40 mm, open downwards, (256, 3) [m]."""
    angles = np.pi / 2 + np.linspace(-_SPAN / 2, _SPAN / 2, _N_DETECTORS)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(_N_DETECTORS)], axis=1)
    return _RADIUS * ring


def sample_scan(path: str | Path) -> None:
    """Write a small simulated scan: as `jaxtat sample`, always the same.

    The .npz file holds ``pressure`` (256, 1600) uint16 counts, ``detectors`` (256, 3) [m] and
    ``sampling_rate`` [Hz].

    Args:
        path: file to write, ending in .npz.

    Raises:
        ValueError: for another ending, or a place where no file can be written.

    >>> import tempfile
    >>> from jaxtat.io import load_scan
    >>> path = Path(tempfile.mkdtemp()) / "scan.npz"
    >>> sample_scan(path)
    >>> load_scan(path).data.shape
    (256, 1600)
    """
    require_x64()
    if Path(path).suffix != ".npz":
        raise ValueError(f"cannot write {path}: expected a name ending in .npz.")
    with replacing(path) as temporary:
        np.savez_compressed(
            temporary, pressure=_counts(), detectors=sample_positions(), sampling_rate=_RATE
        )


def _counts() -> UInt16[np.ndarray, "detectors samples"]:
    """The record, band-limited, noisy, in whole counts."""
    curve = detector_curve(sample_positions()[:, :2])
    radii = _RADIUS + np.arange(-0.012, 0.012, _STEP)
    times = np.arange(_N_SAMPLES) / _RATE
    g = sample_phantom().circular_integrals(curve, radii)
    record = circular_integrals_to_pressure(
        g, radii, times, sound_speed=SOUND_SPEED, model="in-plane"
    )
    record = np.asarray(condition_record(record, times, band=_BAND, baseline=False))
    noise = np.random.default_rng(0).normal(0.0, _NOISE, record.shape)
    counts = _OFFSET + _LARGEST * record / np.abs(record).max() + noise
    return np.round(counts).astype(np.uint16)
