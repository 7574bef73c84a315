"""What is reconstructed: phantoms in the plane and in space, two records of others."""

import os
import sys
from pathlib import Path

import numpy as np
from arrays import ARRAYS, RADIUS
from phantoms import BODIES, IN_BODY, MM, PHANTOMS, image

PIXELS, HALF_WIDTH, JUDGED = 129, 8e-3, 7.2e-3
NOISE = 0.01  # standard deviation over the record's largest value
LATE = 30  # samples, 1 us, by which a record begins before the laser fires
VOXELS, CUBE, RATE, PARTS = 33, 7e-3, 30e6, 4  # in space; PARTS of a sample, whose mean is recorded


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
    if (simulated := folder / "vessels.npz").is_file():
        found.append(_save(folder, "late", _cut(simulated, "arc270", rng, LATE)))
    found += [
        _save(folder, name, _through(folder / f"{name}.npz", body, rng))
        for name, body in BODIES.items()
        if (folder / f"{name}.npz").is_file()
    ]
    data = Path(os.environ.get("JAXTAT_DATA", ""))
    for name, (file_name, make) in OTHERS.items():
        if (path := data / f"{file_name}.npz").is_file():
            with np.load(path) as file:
                found.append(_save(folder, name, make(file)))
        else:
            print(f"without {name}: JAXTAT_DATA has no {path.name}", file=sys.stderr)
    return found


def _save(folder, name, contents):
    path = folder / f"problem-{name}.npz"
    np.savez(path, **contents)
    return path


def _cut(simulated, array, rng, late=0):
    """The record of one array, with noise."""
    sizes = [len(points) for points in ARRAYS.values()]
    start = sum(sizes[: list(ARRAYS).index(array)])
    with np.load(simulated) as file:
        clean = file["record"][start : start + len(ARRAYS[array])]
        known = {name: file[name] for name in ("sampling_rate", "sound_speed")}
    clean = np.pad(clean, ((0, 0), (late, 0)))[:, : clean.shape[1]]
    return known | _plane(clean, array, simulated.stem, rng)


def _through(simulated, body, rng):
    """A body of another speed; others are told the speed of sound that comes from its middle."""
    with np.load(simulated) as file:
        clean, rate, water = (file[key] for key in ("record", "sampling_rate", "sound_speed"))
    x, y, *half_axes = MM * np.array(body)
    radius = np.sqrt(np.prod(half_axes))
    share = radius / RADIUS
    return _plane(clean, "arc270", "vessels", rng) | {
        "sampling_rate": rate,
        "sound_speed": 1 / (share / IN_BODY + (1 - share) / water),
        "water_speed": water,
        "body": (x, y, radius, IN_BODY),
    }


def _noisy(clean, rng):
    return clean + NOISE * np.abs(clean).max() * rng.standard_normal(clean.shape)


def _plane(clean, array, phantom, rng):
    x = np.linspace(-HALF_WIDTH, HALF_WIDTH, PIXELS)
    return {
        "record": _noisy(clean, rng),
        "detectors": ARRAYS[array],
        "half_width": HALF_WIDTH,
        "pixels": PIXELS,
        "truth": image(phantom, x, x),
        "inside": _disk(x, JUDGED),
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
    }


def _half_disk(file):
    rows = np.r_[921:1024, 1:616]  # the others are weakened or absent
    return _of_unit_circle(file, rows, 1024, lambda x: x > 0)


def _full_circle(file):
    return _of_unit_circle(file, np.arange(64), 64, lambda x: np.isfinite(x))


def _hemisphere(file):
    """Balls, whose waves in space are known, at the places of a real array's elements.

    Σ v (d - ct) / 2d for |d - ct| < a, of balls of radius a and value v at the distance d.
    """
    rng, detectors = np.random.default_rng(7), file["hemisphere_256"]
    balls = [
        (rng.uniform(-0.45, 0.45, 3) * CUBE, rng.uniform(0.15, 0.35) * CUBE, rng.uniform(0.5, 1.5))
        for _ in range(8)
    ]
    x = np.linspace(-CUBE, CUBE, VOXELS)
    parts = (np.arange(PARTS) + 0.5) / PARTS - 0.5
    near = (x[:, None] + (x[1] - x[0]) * parts).ravel()
    fine = np.stack(np.meshgrid(near, near, near, indexing="ij"), -1)
    paths = 1500.0 / RATE * (np.arange(int(RATE * 40e-3 / 1500)) + parts[:, None])
    clean = truth = 0.0
    for middle, radius, value in balls:
        distance = np.linalg.norm(detectors - middle, axis=1)[:, None, None]
        off = distance - paths
        clean = clean + np.where(np.abs(off) < radius, value * off / (2 * distance), 0).mean(axis=1)
        truth = truth + value * (np.linalg.norm(fine - middle, axis=-1) < radius)
    return {
        "record": _noisy(clean, rng),
        "detectors": detectors,
        "sampling_rate": RATE,
        "sound_speed": 1500.0,
        "half_width": CUBE,
        "pixels": VOXELS,
        "truth": truth.reshape(*(VOXELS, PARTS) * 3).mean(axis=(1, 3, 5)),
        "inside": np.hypot(np.hypot(x[:, None, None], x[:, None]), x) < CUBE,
    }


OTHERS = {  # problem: file in JAXTAT_DATA, and what is made of it
    "full_circle_64_detectors": ("full_circle_64_detectors", _full_circle),
    "half_disk_three_quarter_arc": ("half_disk_three_quarter_arc", _half_disk),
    "hemisphere": ("arrays_in_space", _hemisphere),
}
IN_SPACE, TWO_SPEEDS = ("hemisphere",), tuple(BODIES)
NAMES = tuple(f"{phantom}-{array}" for phantom in PHANTOMS for array in ARRAYS)
NAMES = (*NAMES, "late", *TWO_SPEEDS, *OTHERS)
PLANE = tuple(name for name in NAMES if name not in IN_SPACE)
