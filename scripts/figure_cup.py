"""docs/pictures/cup.png: a cup of scattered elements, from its record to a volume.

    python scripts/figure_cup.py [--out docs/pictures/cup.png]

256 square elements of 2 mm on a cap of radius 30 mm that sees a quarter of all edges, on no rings;
five balls, whose pressure is known in closed form, 5 % noise and twelve dead elements. Prints
errors of the fit and of the formula, in the 2-norm, beside means of the balls over voxels.
"""

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jax
import numpy as np

import jaxtat
from jaxtat.geometry.elements import across
from jaxtat.io import save_image

SPEED, RATE, FIRST, SAMPLES = 1500.0, 31.25e6, 10e-6, 750
RADIUS, WIDTH, PARTS = 0.03, 2e-3, 8  # PARTS of a sample: the mean over them is recorded
NODES = np.sqrt(0.6) * np.array([-1, 0, 1]), np.array([5, 8, 5]) / 18  # Gauss's, on an element
BALLS = 1e-3 * np.array([[0, 0, 0], [3, -2, 1], [-3.5, 1, -1.5], [1, 4, 2], [-1, -4, -3]])
RADII = 1e-3 * np.array([3.0, 1.2, 1.0, 0.8, 0.6])
VALUES = np.array([1.0, 2.0, 2.0, 3.0, 3.0])


def cup(n: int) -> np.ndarray:
    """Fibonacci's points of a cap of 86 degrees."""
    height = -1 + 0.27 * (np.arange(n) + 0.5) / n
    turn, ring = np.pi * (3 - np.sqrt(5)) * np.arange(n), np.sqrt(1 - height**2)
    return RADIUS * np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)


def pressure(points: np.ndarray, paths: np.ndarray) -> np.ndarray:
    """Σ v (d - ct)/2d where |d - ct| < a, of balls at the distances d."""
    total = np.zeros((len(points), len(paths)))
    for center, radius, value in zip(BALLS, RADII, VALUES, strict=True):
        distance = np.linalg.norm(points - center, axis=1)[:, None]
        inside = np.abs(distance - paths) < radius
        total += value * np.where(inside, (distance - paths) / (2 * distance), 0.0)
    return total


def record(points: np.ndarray) -> np.ndarray:
    """Means over samples and square elements."""
    shifts = (np.arange(PARTS) - (PARTS - 1) / 2) / PARTS
    steps = (np.arange(SAMPLES)[:, None] + shifts).ravel()
    sides = WIDTH / 2 * np.stack(across(jax.device_put(points / RADIUS)))
    total = np.zeros((len(points), SAMPLES))
    for x, first in zip(*NODES, strict=True):
        for y, second in zip(*NODES, strict=True):
            at = pressure(points + x * sides[0] + y * sides[1], SPEED * (FIRST + steps / RATE))
            total += first * second * at.reshape(len(points), SAMPLES, PARTS).mean(axis=-1)
    return total


def truth(grid: Any) -> np.ndarray:
    """Means of the balls over voxels."""
    x = np.asarray(grid.finer(3).points)
    near = [np.linalg.norm(x - c, axis=-1) < a for c, a in zip(BALLS, RADII, strict=True)]
    return np.asarray(grid.means(np.tensordot(VALUES, np.array(near, float), 1)))


def main() -> None:
    parser = argparse.ArgumentParser(
        description="A cup of scattered elements, from its record to a volume."
    )
    parser.add_argument("--out", default="docs/pictures/cup.png")
    out = parser.parse_args().out
    jax.config.update("jax_enable_x64", True)
    points, rng = cup(256), np.random.default_rng(1)
    data = record(points)
    data += 0.05 * np.abs(data).max() * rng.standard_normal(data.shape)
    data[rng.choice(256, 12, replace=False)] = 0.0
    times = FIRST + np.arange(SAMPLES) / RATE
    with TemporaryDirectory() as folder:
        path = Path(folder) / "cup.npz"
        np.savez(path, pressure=data, detectors=points, times=times, element_size=WIDTH)
        for name, given in {"fit": {}, "formula": {"model_based": False}}.items():
            start = time.process_time()
            found = jaxtat.reconstruct_file(path, **given)
            spent, exact = time.process_time() - start, truth(found.grid)
            inside = np.asarray(found.region.contains(found.grid.points))
            off = np.linalg.norm((found.image - exact)[inside]) / np.linalg.norm(exact[inside])
            print(f"{name}: {found.grid.shape}, error {off:.3f}, {spent:.1f} CPU-s", flush=True)
            if name == "fit":
                save_image(out, found.image, found.grid, found.region, unit=found.unit)


if __name__ == "__main__":
    main()
