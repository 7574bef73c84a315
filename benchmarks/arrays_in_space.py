"""Errors of fits and of back-projection for arrays in space that others built or proposed.

    JAXTAT_DATA=FOLDER python benchmarks/arrays_in_space.py [--voxels 33] [--arrays hemisphere_256]

The arrays of `arrays_in_space.npz`: 256 square elements of 2 mm on a cap, which 74 % of the lines
through the region miss, and points on a whole sphere, whose size the file does not tell. In a
region of 7 mm the balls and bells of `bench_scattered.py`, in closed form; 5 % of the elements are
dead, noise is 5 % of the record's root mean square. Once as pressure, once through the pulse that
the file has for the first array: so much slower that its band, 8 to 16 MHz where it is half as
large as at most, ends where that of the voxels does. Errors are relative, in the 2-norm over the
region, beside means over voxels; back-projection knows nothing of the pulse, and is given its best
factor.
"""

import argparse
import os
import time
from pathlib import Path

import jax
import numpy as np
from bench_scattered import (
    PARTS,
    PROFILES,
    by_best_factor,
    living,
    parts_of,
    pressure,
    recorded,
    truth_on,
)
from scipy.signal import fftconvolve

from jaxtat import Setup, VolumeGrid, model_based
from jaxtat.geometry.elements import across
from jaxtat.spherical import DetectorPoints, back_projection, ball, pressure_to_spherical_integrals

REGION, SIDE = 7e-3, {"hemisphere_256": 2e-3}  # [m]
RATE, BAND_END = 62.5e6, 16e6  # of the pulse [Hz]
SPEED = 1500.0  # [m/s]
TAPS = 40  # of the pulse, either side, at the samples of records


def alive_of(points: np.ndarray, side: float | None) -> DetectorPoints:
    """Elements that are not dead, on a whole sphere or a cap of it."""
    size, height = np.linalg.norm(points[0]), np.abs(points[:, 2])
    share = 1.0 if (points[:, 2] < 0).any() else (size - height.min()) / (2 * size)
    return living(points, share, None if side is None else side / np.sqrt(3))  # second moments


def over_squares(curve: DetectorPoints, side: float | None, paths: np.ndarray, profile):
    """Pressure, or its mean over square elements by Gauss's rule."""
    points = np.asarray(curve.points)
    if side is None:
        return np.asarray(pressure(curve.points, paths, profile))
    sides = (
        side / 2 * np.stack(across(jax.device_put(points / np.asarray(curve.distance)[:, None])))
    )
    total = np.zeros((len(points), len(paths)))
    for x, first in zip(*np.polynomial.legendre.leggauss(4), strict=True):
        for y, second in zip(*np.polynomial.legendre.leggauss(4), strict=True):
            at = jax.device_put(points + x * sides[0] + y * sides[1])
            total += first * second / 4 * np.asarray(pressure(at, paths, profile))
    return total


def pulse_at(pulse: np.ndarray, step: float, slower: float) -> np.ndarray:
    """The pulse at steps of a time, its largest value in the middle, at most 1 at any frequency."""
    steps = np.arange(-TAPS * PARTS, TAPS * PARTS + 1) * step
    times = (np.arange(len(pulse)) - np.abs(pulse).argmax()) / RATE * slower
    values = np.interp(steps, times, np.real(pulse), left=0.0, right=0.0)
    return values / np.abs(np.fft.rfft(values)).max()


def at_samples(pulse: np.ndarray) -> np.ndarray:
    """The pulse at whole samples, without the frequencies that these do not hold."""
    spectrum = np.fft.rfft(np.fft.ifftshift(pulse))
    spectrum[np.fft.rfftfreq(len(pulse)) > 0.5 / PARTS] = 0.0
    return PARTS * np.fft.fftshift(np.fft.irfft(spectrum, len(pulse)))[::PARTS]


def root_mean_square(record: np.ndarray) -> float:
    return float(np.sqrt(np.mean(record**2)))


def compare(name: str, points: np.ndarray, voxels: int, body: str, pulse: np.ndarray | None) -> str:
    """A row of the table."""
    side = SIDE[name] / REGION if name in SIDE else None
    curve, grid = alive_of(points / REGION, side), VolumeGrid(voxels)
    setup = Setup(curve, ball(1.0), grid, max_frequency=4.0)  # of the formula, which is not used
    distance, step = float(np.asarray(curve.distance)[0]), float(grid.spacing[0]) / 2
    more = 0.0 if pulse is None else TAPS * step
    times = np.arange(distance - 1 - more, distance + 1 + more + step, step)
    fine = over_squares(curve, side, parts_of(times), PROFILES[body])
    given = {"times": times, "dtype": "float32", "nonnegative": True, "tolerance": 1.5e-2}
    if pulse is not None:
        slower = BAND_END / (SPEED / (2 * float(grid.spacing[0]) * REGION))
        response = pulse_at(pulse, step / PARTS * REGION / SPEED, slower)
        fine = fftconvolve(fine, response[None], mode="same", axes=1)
        given["element_responses"] = np.tile(at_samples(response), (len(fine), 1))
    record, inside = (
        recorded(fine, root_mean_square),
        np.asarray(setup.region.contains(grid.points)),
    )
    truth = np.asarray(truth_on(grid, PROFILES[body]))[inside]
    spent = time.process_time()
    found = model_based(setup, record, **given)
    spent = time.process_time() - spent
    g = pressure_to_spherical_integrals(record, times, times[1:-1])
    projected = np.asarray(back_projection(curve, times[1:-1], g, grid.points))[inside]
    each = np.asarray(found.image)[inside], by_best_factor(projected, truth)
    off = [np.linalg.norm(values - truth) / np.linalg.norm(truth) for values in each]
    kind = "pressure" if pulse is None else "pulse"
    errors = " | ".join(f"{e:.3f}" for e in off)
    return f"| {name} | {len(record)} | {body} | {kind} | {errors} | {found.steps} | {spent:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    arrays = ("hemisphere_256", "fibonacci_1013", "fibonacci_4096")
    parser.add_argument("--arrays", nargs="+", default=arrays, choices=arrays)
    parser.add_argument("--voxels", type=int, default=33)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    data = np.load(Path(os.environ.get("JAXTAT_DATA", "../shared/data")) / "arrays_in_space.npz")
    print("| array | elements | object | record | fit | back-projection | steps | CPU-s |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name in options.arrays:
        for pulse in (None, data["pulse_256"]):
            for body in PROFILES:
                print(compare(name, data[name], options.voxels, body, pulse), flush=True)


if __name__ == "__main__":
    main()
