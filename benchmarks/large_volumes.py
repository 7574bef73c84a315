"""A fit of a large volume to thousands of scattered elements, to its end: time, memory, error.

    python benchmarks/large_volumes.py 129 1013 --waves 0.31
    python benchmarks/large_volumes.py 193 4096 --waves 0.34

Elements at Fibonacci's points of a whole sphere, 5 % of them dead; eight balls as in
`bench_scattered.py`, 5 % noise. The error is relative, in the 2-norm over the region, beside the
balls at the voxels; times and memory are those of the process, with compiling. With ``--again`` the
fit is done a second time, compiled.
"""

import argparse
import resource
import time
from functools import partial

import jax
import numpy as np
from bench_scattered import (
    CENTERS,
    FIBONACCI,
    PROFILES,
    RADII,
    VALUES,
    elements,
    parts_of,
    pressure,
    recorded,
)

from jaxtat import Setup, VolumeGrid, model_based
from jaxtat.spherical import ball


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("voxels", type=int)
    parser.add_argument("elements", type=int)
    parser.add_argument("--waves", type=float, default=1.0, help="up to this share of the voxels'")
    parser.add_argument("--again", action="store_true", help="time the fit once it is compiled")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    FIBONACCI["whole"] = given.voxels, given.elements, 1.1, 0.03
    n, curve = elements("whole")
    grid = VolumeGrid(n)
    setup = Setup(curve, ball(1.0), grid, max_frequency=4.0)  # of the formula, which is not used
    distance, step = float(np.asarray(curve.distance)[0]), float(grid.spacing[0]) / 2
    times = np.arange(distance - 1, distance + 1 + step, step)
    fit = partial(
        model_based,
        setup,
        record(curve.points, times),
        nonnegative=True,
        tolerance=1.5e-2,
        times=times,
        dtype="float32",
        max_frequency=given.waves * float(np.pi / grid.spacing[0]),
        progress=True,
    )
    start, began = time.process_time(), time.perf_counter()
    found = jax.block_until_ready(fit())
    spent, wall = time.process_time() - start, time.perf_counter() - began
    inside, exact = np.asarray(setup.region.contains(grid.points)), truth(grid)
    off = np.linalg.norm((np.asarray(found.image) - exact)[inside]) / np.linalg.norm(exact[inside])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"{len(curve.points)} elements, {n} voxels along an axis: {found.steps} steps, ", end="")
    print(f"{spent:.0f} CPU-s, {wall:.0f} s, {peak:.1f} GB, error {off:.3f}")
    if given.again:
        began = time.perf_counter()
        jax.block_until_ready(fit())
        print(f"compiled: {time.perf_counter() - began:.1f} s")


def record(points: jax.Array, times: np.ndarray) -> np.ndarray:
    """Element after element."""
    parts = parts_of(times)
    fine = jax.lax.map(lambda z: pressure(z[None], parts, PROFILES["balls"])[0], points)
    return recorded(np.asarray(fine))


def truth(grid: VolumeGrid) -> np.ndarray:
    """The balls at the voxels."""
    points = np.asarray(grid.points)
    within = [np.linalg.norm(points - c, axis=-1) < a for c, a in zip(CENTERS, RADII, strict=True)]
    return np.tensordot(VALUES, np.array(within, float), 1)


if __name__ == "__main__":
    main()
