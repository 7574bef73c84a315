"""What is reconstructed: three phantoms in five arrays, two records of others, a measured scan."""

import os
import sys
from pathlib import Path

import numpy as np
from arrays import ARRAYS
from phantoms import PHANTOMS, image

PIXELS, HALF_WIDTH, BODY = 129, 8e-3, 7.2e-3
NOISE = 0.01  # standard deviation over the record's largest value


def write(folder: Path) -> list[Path]:
    """All problems as files, of those whose data are there: simulated ones, then those of others.

    A file has what `peer.Problem` has, and for the judge truth and inside, [x, y], if known.
    """
    rng = np.random.default_rng(20)
    found = []
    for phantom in PHANTOMS:
        for array in ARRAYS:
            simulated = folder / f"{phantom}.npz"
            if simulated.is_file():
                found.append(_save(folder, f"{phantom}-{array}", _cut(simulated, array, rng)))
    data = Path(os.environ.get("JAXTAT_DATA", ""))
    for name, make in OTHERS.items():
        if (path := data / f"{name}.npz").is_file():
            with np.load(path) as file:
                found.append(_save(folder, name, make(file)))
        else:
            print(f"without {name}: JAXTAT_DATA has no {path.name}", file=sys.stderr)
    return found


def _save(folder, name, contents):
    path = folder / f"problem-{name}.npz"
    np.savez(path, **contents)
    return path


def _cut(simulated, array, rng):
    """The record of one array, with noise."""
    sizes = [len(points) for points in ARRAYS.values()]
    start = sum(sizes[: list(ARRAYS).index(array)])
    x = np.linspace(-HALF_WIDTH, HALF_WIDTH, PIXELS)
    with np.load(simulated) as file:
        clean = file["record"][start : start + len(ARRAYS[array])]
        known = {name: file[name] for name in ("sampling_rate", "sound_speed")}
    return known | {
        "record": clean + NOISE * np.abs(clean).max() * rng.standard_normal(clean.shape),
        "detectors": ARRAYS[array],
        "half_width": HALF_WIDTH,
        "pixels": PIXELS,
        "truth": image(simulated.stem, x, x),
        "inside": _disk(x, BODY),
        "body": BODY,
    }


def _disk(x, radius):
    return np.hypot(x[:, None], x) < radius


def _of_unit_circle(file, rows, n, inside):
    """The Fast-Hankel solver's own examples: radius 1, speed 1, every other pixel."""
    angles = 2 * np.pi * rows / n
    x = np.linspace(-1, 1, 257)[::2]
    return {
        "record": file["pressure"][:, rows].T,
        "detectors": np.stack([np.cos(angles), np.sin(angles)], axis=1),
        "sampling_rate": 768 / 6,
        "sound_speed": 1.0,
        "half_width": 1.0,
        "pixels": len(x),
        "truth": file["truth"].T[::2, ::2],
        "inside": _disk(x, 0.97) & inside(x),
        "body": 0.97,
    }


def _half_disk(file):
    rows = np.r_[921:1024, 1:616]  # the others are weakened or absent
    return _of_unit_circle(file, rows, 1024, lambda x: x > 0)


def _full_circle(file):
    return _of_unit_circle(file, np.arange(64), 64, lambda x: np.isfinite(x))


def _msot(file):
    """A cross-section of an animal: no truth. Its plane, a mean of zero in every channel."""
    raw, geometry = file["raw"].astype(float), file["geometry"]
    flat = np.ptp(geometry, axis=0).argmin()
    raw[:, :200] = np.median(raw)  # the laser's own noise, before any sound of the animal
    return {
        "record": raw - np.median(raw, axis=1, keepdims=True),
        "detectors": np.delete(geometry, flat, axis=1),
        "sampling_rate": float(file["fs"]),
        "sound_speed": 1480.0,
        "half_width": 12.5e-3,
        "pixels": PIXELS,
        "dimension": 3,
    }


OTHERS = {
    "full_circle_64_detectors": _full_circle,
    "half_disk_three_quarter_arc": _half_disk,
    "msot_scan9": _msot,
}
