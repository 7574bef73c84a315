"""Memory and time of a reconstruction, estimated from its sizes before it is started.

Both grow with a power of the number of pixels, so that a slip of the keyboard is a day of work, or
more memory than there is. The constants are measured by benchmarks/cost.py, to a factor of two.
"""

import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import psutil

BYTES_PER_PIXEL = 65.0  # of image, nodes, and what back-projection keeps: 33 to 65 were measured
SECONDS_PER_PIXEL = 2e-8  # of one processor, for each direction: 1.25e-8 to 3.4e-8 were measured
SECONDS_PER_VOXEL = 1e-7  # of one processor
LONG = 300.0  # seconds above which it is said beforehand

GROUPS = 4  # of frequencies, whose densities are kept in full until the group is done
BYTES_PER_RADIUS = 24.0 * 25**2  # of the polynomials through its neighbours
# of one processor: an entry of a matrix times its shorter side, decomposed, and in a product
SECONDS_PER_ENTRY = {"direct": 3e-11, "plan": 2e-9}


class LongWorkWarning(UserWarning):
    """The computation is possible but will take many minutes."""


class Cost(NamedTuple):
    """What a reconstruction takes.

    Attributes:
        nbytes: memory at its peak, at least [byte].
        seconds: on the processors of this machine, at least [s].
    """

    nbytes: float
    seconds: float


def image_cost(shape: tuple[int | float, ...], n_frequencies: int, n_directions: int) -> Cost:
    """Cost of steps 4 and 5 for one image or volume, without what depends on the detectors.

    The polar Fourier transform has 16 bytes at each frequency and direction, its projections 16
    more, and the matrix of the ramp 6 n x 2 n entries. In space both kinds of angles count.
    """
    pixels, n = float(np.prod(shape, dtype=float)), float(n_frequencies)
    polar = n * float(n_directions) ** (len(shape) - 1)
    nbytes = BYTES_PER_PIXEL * pixels + 32.0 * polar + 96.0 * n**2
    seconds = SECONDS_PER_PIXEL * pixels * n_directions
    if len(shape) == 3:  # by Fourier sums, as is usual in space
        seconds = SECONDS_PER_VOXEL * pixels
    return Cost(nbytes, seconds / (os.cpu_count() or 1))


def volume_fit_cost(n_voxels: int, n_samples: int, n_waves: int, n_data: int, n_bands: int) -> Cost:
    """Memory of a fit in space with 32 bits; its time depends on the steps, and is not estimated.

    Measured with 17 to 129 voxels a side and 100 to 1013 detectors: within 15 %.

    Args:
        n_voxels: of the volume: some thirty copies, and the finer grid of the non-uniform FFT.
        n_samples: of its Fourier transform.
        n_waves: entries of tables of waves at the detectors, first made with 64 bits.
        n_data: samples of all detectors.
        n_bands: of frequencies, each of which has programs of its own.
    """
    programs = 1.5e8 + 1e8 * n_bands
    return Cost(programs + 190.0 * n_voxels + 100.0 * n_samples + 12.0 * n_waves + 32.0 * n_data, 0)


class Systems(NamedTuple):
    """Sizes of steps 1 to 3.

    Attributes:
        n_detectors, n_radii: of the data.
        n_frequencies, n_directions: of the polar grid.
        rows: of A at the highest frequency: two for each order, or the boundary points.
        blocks: into which A falls apart, 2 in a mirrored geometry.
        n_boundary: points on the boundary of a region that is no disk; 0 of a disk.
        on_circle: whether the detectors are; else their waves are in memory one by one.
    """

    n_detectors: int
    n_radii: int
    n_frequencies: int
    n_directions: int
    rows: int
    blocks: int = 1
    n_boundary: int = 0
    on_circle: bool = True


def systems_cost(sizes: Systems, plan: str | None = None) -> Cost:
    """Cost of steps 1 to 3 for one image, or of a plan.

    Step 2 has the matrix of the radial quadrature, and kernels at all frequencies and radii; step 3
    a few matrices of one frequency. Densities are rows of all frequencies, and those of one group
    have besides their singular vectors and the factors of single directions.

    Args:
        sizes: of the problem.
        plan: None for a reconstruction without densities; "cylindrical" or "sampled" by how a plan
            keeps them.
    """
    n_detectors, n_radii, n, n_directions, rows, n_blocks, n_boundary, on_circle = sizes
    columns = 2 * n_detectors
    system = rows**2 / n_blocks
    if not on_circle or plan:
        system += 3.0 * rows * columns / (n_blocks if on_circle else 1)
    system += 3.0 * rows * n_boundary
    rank = min(rows, columns)
    nbytes = 8.0 * (4 * system + 4 * n * rows)
    seconds = SECONDS_PER_ENTRY["plan" if plan else "direct"] * n / 2
    if plan is None:
        nbytes += BYTES_PER_RADIUS * n_radii + 8.0 * (3 * n_radii**2 + 6 * n * n_radii)
        nbytes += 8.0 * 6 * n * n_detectors
        seconds *= rows**3 / n_blocks**2
    elif plan == "cylindrical":
        nbytes += 8.0 * n * rows * columns / n_blocks / 2  # fewer orders at low frequencies
        of_group = (rows + rank) * columns / n_blocks + 2.0 * rank * n_directions
        nbytes += 8.0 * 2 * (n / GROUPS) * of_group
        seconds *= rows * columns * rank / n_blocks**2
    else:
        nbytes += 2 * 16.0 * n * n_directions * columns  # pieces, and all of them
        seconds *= rows * columns * rank
    return Cost(nbytes, seconds / (os.cpu_count() or 1))


def most_that_fit(cost_of: Callable[[int], Cost], too_many: int, room: float) -> int:
    """The largest number below ``too_many`` whose cost fits into ``room`` bytes."""
    fits = 0
    while too_many - fits > 1:
        middle = (fits + too_many) // 2
        fits, too_many = (middle, too_many) if cost_of(middle).nbytes <= room else (fits, middle)
    return fits


def require_room(
    cost_of: Callable[[int], Cost],
    n: int,
    what: str = "pixels a side",
    advice: Callable[[int], str] | None = None,
) -> None:
    """Raise ValueError if an image with n pixels along its longer side does not fit into memory.

    Args:
        cost_of: the cost with that many pixels, or whatever else, everything else being equal.
        n: that are wanted.
        what: that is counted.
        advice: what to do if so many fit.

    Raises:
        ValueError: with the largest number that fits.

    Warns:
        LongWorkWarning: with the minutes that are expected, if they are many.
    """
    cost, room = cost_of(n), available_memory()
    if cost.nbytes > room:
        fits = most_that_fit(cost_of, n, room)
        raise ValueError(
            f"{n} {what} take at least {gigabytes(cost.nbytes)} of memory, and "
            f"{gigabytes(room)} are free: at most {fits} fit"
            f"{': ' + advice(fits) if advice else ''}."
        )
    if cost.seconds > LONG:
        warnings.warn(
            f"{n} {what} take {cost.seconds / 60:.0f} minutes or more on this machine, and "
            f"{gigabytes(cost.nbytes)} of memory.",
            LongWorkWarning,
            stacklevel=4,
        )


def gigabytes(nbytes: float) -> str:
    """In words.

    >>> gigabytes(3.4e9)
    '3.4 GB'
    """
    return f"{nbytes / 1e9:.3g} GB"


def available_memory() -> float:
    """Bytes still free for arrays: on JAX's device, or by the smallest of the system's limits."""
    statistics = jax.devices()[0].memory_stats() if jax.default_backend() != "cpu" else None
    if statistics and "bytes_limit" in statistics:
        return float(statistics["bytes_limit"] - statistics.get("bytes_in_use", 0))
    process = psutil.Process()
    left = min(float(psutil.virtual_memory().available), group_memory(Path("/")))
    if hasattr(process, "rlimit"):  # Linux: what `ulimit -v` leaves
        most, _ = process.rlimit(psutil.RLIMIT_AS)
        if most != psutil.RLIM_INFINITY:
            left = min(left, float(most - process.memory_info().vms))
    return left


def group_memory(root: Path) -> float:
    """Bytes left by control groups (containers, batch systems), which psutil does not report.

    Args:
        root: the directory in which Linux has /proc and /sys.
    """
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return float("inf")
    left = float("inf")
    for inner in (Path(line[4:]) for line in lines if line.startswith("0::/")):
        for group in (inner, *inner.parents):
            folder = root / "sys/fs/cgroup" / group
            try:
                limit, used = (
                    int((folder / name).read_text()) for name in ("memory.max", "memory.current")
                )
                left = min(left, float(limit - used))
            except (OSError, ValueError):  # "max", or a group that is not shown here
                continue
    return left
