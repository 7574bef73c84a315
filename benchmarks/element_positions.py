"""Positions of a real hemisphere's elements, displaced by 0.2 mm, from simulated records of balls.

Every coordinate of the 256 elements is displaced by 0.2 mm in the root mean square; the record, of
40 balls all over the region, is in closed form, with noise relative to its largest value. Printed
is by how much the positions that were found are off, in the root mean square of coordinates: all,
along the line to the middle, and beyond what moves and turns all elements together.

    python benchmarks/element_positions.py [--voxels 15] [--noise 0.01]
"""

import argparse
import os
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxtat import Setup, VolumeGrid
from jaxtat.spherical import DetectorPoints, ball
from jaxtat.studies import calibrate_positions

REGION, ELEMENT, OFF = 7e-3, 2e-3 / np.sqrt(3), 0.2e-3  # radii of region and element [m]
SPEED, RATE = 1500.0, 62.5e6
RNG = np.random.default_rng(7)
UNITS = RNG.standard_normal((40, 3))
UNITS /= np.linalg.norm(UNITS, axis=1, keepdims=True)
CENTERS = 0.7 * REGION * UNITS * RNG.uniform(0, 1, (40, 1)) ** (1 / 3)
RADII, VALUES = REGION * RNG.uniform(0.08, 0.15, 40), RNG.uniform(0.5, 1.5, 40)


def pressure(points: jax.Array, paths: np.ndarray) -> jax.Array:
    """Σ v (d - ct)/2d where |d - ct| < a."""
    total = jnp.zeros((len(points), len(paths)))
    for center, radius, value in zip(CENTERS, RADII, VALUES, strict=True):
        distance = jnp.linalg.norm(points - center, axis=1)[:, None]
        apart = distance - paths
        total += jnp.where(jnp.abs(apart) < radius, value * apart / (2 * distance), 0.0)
    return total


def without_common(off: np.ndarray, points: np.ndarray) -> np.ndarray:
    """What is left of displacements by the best motion of all elements together."""
    moves = [np.tile(axis, (len(points), 1)) for axis in np.eye(3)]
    moves += [np.cross(axis, points) for axis in np.eye(3)]
    columns = np.stack(moves, axis=-1).reshape(-1, 6) / [1, 1, 1, *3 * [np.ptp(points)]]
    return off.ravel() - columns @ np.linalg.lstsq(columns, off.ravel(), rcond=None)[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--voxels", type=int, default=15, help="along an axis of the grid")
    parser.add_argument("--noise", type=float, default=0.01)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    folder = Path(os.environ.get("JAXTAT_DATA", "../shared/data"))
    points, rng = np.load(folder / "arrays_in_space.npz")["hemisphere_256"], RNG
    off = OFF * rng.standard_normal(points.shape)
    reach, middle = 1.15 * REGION / SPEED, np.linalg.norm(points[0]) / SPEED
    times = np.arange(middle - reach, middle + reach, 1 / RATE)
    true = DetectorPoints(points + off, element_radius=ELEMENT)
    record = true.mean_over_elements(lambda z: pressure(z, SPEED * times), 3)
    noise = options.noise * float(jnp.abs(record).max())
    record = record + noise * rng.standard_normal(record.shape)
    grid = VolumeGrid(options.voxels, REGION)
    curve = DetectorPoints(points, element_radius=ELEMENT)
    setup = Setup(curve, ball(REGION), grid, max_frequency=4 / REGION)  # of the formula: not used
    given = {"noise": noise, "position_error": OFF, "sound_speed": SPEED}
    begun = time.process_time()
    found = calibrate_positions(setup, record, times, **given)
    spent = time.process_time() - begun
    left = np.asarray(found.curve.points) - points - off
    along = np.sum(left * points, axis=1) / np.linalg.norm(points, axis=1)
    parts = {"given": off, "found": left, "along": along, "own": without_common(left, points)}
    parts["standard errors"] = np.asarray(found.standard_errors)
    sizes = {name: 1e3 * np.sqrt(np.mean(part**2)) for name, part in parts.items()}
    print(f"{options}, {len(found.moved)} steps, {spent:.0f} CPU-s, misfit {found.misfit:.2f}")
    print(", ".join(f"{name} {size:.3f}" for name, size in sizes.items()), "mm")


if __name__ == "__main__":
    main()
