"""docs/pictures/finger_vessels.png: a finger's vessels from an open array of scattered elements.

    python scripts/figure_finger_vessels.py [--out docs/pictures/finger_vessels.png]

The vessels are 21744 balls of radius 0.1 mm, whose pressure is known in closed form; the elements
are the lower half of 1013 of Fibonacci's points on a sphere of 60 mm. Both are in
`arrays_in_space.npz` in the folder JAXTAT_DATA. 5 % noise, and 5 % of the elements are dead. Prints
errors in the 2-norm over the region, after the best factor, beside means of the balls over voxels.
Back-projection is also given the best of several low-pass filters.
"""

import argparse
import os
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import jax
import numpy as np

import jaxtat
from jaxtat.plotting import new_figure, show_projections
from jaxtat.spherical import DetectorPoints, back_projection, pressure_to_spherical_integrals

SPEED, RATE, FIRST, SAMPLES = 1500.0, 31.25e6, 30e-6, 650
NOISE, DEAD = 0.05, 0.05  # of the largest value, and of the elements
REGION = 11e-3  # its radius
PARTS = 9  # points across a ball, of which its share of voxels is counted
CUTOFFS = 1e6, 1.5e6, 2.2e6, 3e6, 4e6  # of back-projection, the best is taken
SHOWN = np.array([10e-3, 4.5e-3, 6e-3])  # from the middle along each axis
BRIGHTEST = 0.995  # share of the vessels' voxels below the brightest colour, of each volume


def data() -> tuple[np.ndarray, np.ndarray]:
    """Balls (x, y, z, value, radius), and the elements of the lower half of the sphere."""
    folder = Path(os.environ.get("JAXTAT_DATA", "../shared/data"))
    with np.load(folder / "arrays_in_space.npz") as file:
        balls, sphere = file["sources"].astype(float), file["fibonacci_1013"]
    return balls, sphere[sphere[:, 2] < 0]


def record(balls: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Means over samples of Σ v (d - ct)/2d, |d - ct| < a, of balls at the distances d.

    The integral of a term from the ball's near side to ct is v (a² - (d - ct)²)/4d, zero beyond it.
    """
    x, value, radius = balls[:, :3], balls[:, 3], balls[:, 4]
    step = SPEED / RATE
    begin = SPEED * FIRST - step / 2
    samples = np.arange(2 + int(2 * radius.max() / step) + 1)
    total = np.empty((len(elements), SAMPLES))
    for row, element in zip(total, elements, strict=True):
        distance = np.linalg.norm(x - element, axis=1)
        first = ((distance - radius - begin) / step).astype(int)
        edges = first[:, None] + samples
        off = np.clip(begin + edges * step - distance[:, None], -radius[:, None], radius[:, None])
        until = (value / (4 * distance))[:, None] * (radius[:, None] ** 2 - off**2)
        row[:] = np.diff(np.bincount(edges.ravel(), until.ravel(), SAMPLES + 1)) / step
    return total


def measured(balls: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """The record with noise and dead elements."""
    pressure, rng = record(balls, elements), np.random.default_rng(1)
    pressure += NOISE * np.abs(pressure).max() * rng.standard_normal(pressure.shape)
    pressure[rng.choice(len(elements), round(DEAD * len(elements)), replace=False)] = 0.0
    return pressure


def truth(balls: np.ndarray, grid: jaxtat.VolumeGrid) -> np.ndarray:
    """Means of the balls over voxels."""
    line = (2 * np.arange(PARTS) + 1) / PARTS - 1
    inside = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    inside = inside[np.linalg.norm(inside, axis=1) < 1]
    spacing = np.asarray(grid.spacing)
    corner = np.asarray(grid.center) - np.asarray(grid.half_width)
    share = balls[:, 3] * 4 / 3 * np.pi * balls[:, 4] ** 3 / spacing.prod() / len(inside)
    total = np.zeros(grid.shape)
    for part in inside:
        place = np.rint((balls[:, :3] + part * balls[:, 4:] - corner) / spacing).astype(int)
        np.add.at(total, tuple(place.T), share)
    return total


def back_projected(
    pressure: np.ndarray, elements: np.ndarray, grid: jaxtat.VolumeGrid, cutoff: float
) -> np.ndarray:
    """By the formula for a whole sphere, without the dead elements, waves up to a frequency."""
    alive = np.ptp(pressure, axis=1) > 0
    points, spectrum = elements[alive], np.fft.rfft(pressure[alive], axis=1)
    frequency = np.fft.rfftfreq(SAMPLES, 1 / RATE)
    passed = np.where(frequency < cutoff, (1 + np.cos(np.pi * frequency / cutoff)) / 2, 0.0)
    smooth = np.fft.irfft(spectrum * passed, SAMPLES, axis=1)
    area = 2 * np.pi * float(np.linalg.norm(points[0])) ** 2 / len(points)
    paths = SPEED * (FIRST + np.arange(SAMPLES) / RATE)
    g = pressure_to_spherical_integrals(smooth, paths, paths[1:-1])
    detectors = DetectorPoints(points, np.full(len(points), area))
    return np.asarray(back_projection(detectors, paths[1:-1], g, grid.points))


def best_factor(volume: np.ndarray, exact: np.ndarray, inside: np.ndarray) -> tuple[float, float]:
    """The factor with which a volume is nearest to the truth, and the relative error then."""
    values, wanted = volume[inside], exact[inside]
    factor = float(values @ wanted / (values @ values))
    return factor, float(np.linalg.norm(factor * values - wanted) / np.linalg.norm(wanted))


def draw(out: Path, volumes: dict[str, np.ndarray], grid: jaxtat.VolumeGrid) -> None:
    """The largest values along three directions, within a box about the finger."""
    axes = [np.flatnonzero(np.abs(np.asarray(grid.axis(k))) <= SHOWN[k]) for k in range(3)]
    half = [float(grid.axis(k)[axes[k][-1]]) for k in range(3)]
    box = jaxtat.VolumeGrid(tuple(len(axis) for axis in axes), half)
    vessels = volumes["truth"] > 0
    figure = new_figure(9.6, 8.4)
    rows = figure.subfigures(len(volumes), 1, squeeze=False)[:, 0]
    for row, (title, volume) in zip(rows, volumes.items(), strict=True):
        part, limits = volume[np.ix_(*axes)], (0.0, float(np.quantile(volume[vessels], BRIGHTEST)))
        show_projections(row, part, box, limits=limits, title=title, cmap="inferno", unit="m")
    figure.savefig(out, dpi=90, metadata={"Software": None}, pil_kwargs={"optimize": True})
    print(f"{out.name}: {out.stat().st_size // 1024} kB")


def main() -> None:
    parser = argparse.ArgumentParser(description="A finger's vessels from an open array.")
    parser.add_argument("--out", type=Path, default=Path("docs/pictures/finger_vessels.png"))
    out = parser.parse_args().out
    jax.config.update("jax_enable_x64", True)
    balls, elements = data()
    pressure, times = measured(balls, elements), FIRST + np.arange(SAMPLES) / RATE
    with TemporaryDirectory() as folder:
        path = Path(folder) / "finger.npz"
        np.savez(path, pressure=pressure, detectors=elements, times=times, sound_speed=SPEED)
        start = time.perf_counter(), time.process_time()
        found = jaxtat.reconstruct_file(path, region_radius=REGION)
    spent = time.perf_counter() - start[0], time.process_time() - start[1]
    assert isinstance(found.grid, jaxtat.VolumeGrid)
    exact, fitted = truth(balls, found.grid), np.asarray(found.image)
    inside = np.asarray(found.region.contains(found.grid.points))
    error = best_factor(fitted, exact, inside)[1]
    plain = np.linalg.norm((fitted - exact)[inside]) / np.linalg.norm(exact[inside])
    print(found.report)
    print(f"jaxtat: error {plain:.3f}, with the best factor {error:.3f}")
    print(f"{spent[0]:.0f} s, of processor time {spent[1]:.0f} s", flush=True)
    volumes = []
    for cutoff in CUTOFFS:
        start = time.process_time()
        volume = back_projected(pressure, elements, found.grid, cutoff)
        factor, error = best_factor(volume, exact, inside)
        volumes.append((error, factor * volume))
        seconds = time.process_time() - start
        print(f"back-projection up to {cutoff / 1e6} MHz: {error:.3f}, {seconds:.1f} CPU-s")
    projected = min(volumes, key=lambda pair: pair[0])[1]
    draw(out, {"truth": exact, "back-projection": projected, "jaxtat": fitted}, found.grid)


if __name__ == "__main__":
    main()
