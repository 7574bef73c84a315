"""The images of a scan, frame after frame, with what was chosen."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from tqdm import tqdm

from ..fitting import ModelBased
from ..fitting.coarse_grids import ladder
from ..geometry import ImageGrid, VolumeGrid
from ..io import Scan, load_scan
from ..io.images import HasInside
from ..reconstruction import (
    Reconstruction,
    ReconstructionPlan,
    Setup,
    on_ladder,
    solve,
    solve_on_ladder,
)
from ..reconstruction import reconstruct as reconstruct_by
from ..records import ranges
from ..steps import AccuracyWarning
from .acquisition import blank_frames, facts_of, frame_numbers, some_frames, with_facts
from .choices import Choices
from .choosing import choose
from .constrained import fitted, warn_of_hardly_any
from .frames import GROUPS, bounded_as_said, integrals, lit_frames, setup_of
from .method import with_best_method
from .space import TurnedOver, facts_in_space, require_few

AT_A_TIME = 2**26  # bytes of data, as float64, that are reconstructed together
TOGETHER, FEW = (32, 8), 2  # frames; the last are filled up, but for a single one


@dataclass(frozen=True, eq=False)
class ScanImages:
    """Images of a scan and how they were made.

    Attributes:
        image: (x1, x2), or (frames, x1, x2) of a scan of more than one frame; of detectors in
            space volumes, with a third axis x3.
        grid, region: where they are; outside the region they mean nothing.
        choices: with which they were made.
        frames: wavelengths [nm], or numbers in the file from 0, (frames,); None of a single frame.
        numbers: of the frames in the file, from 0, (frames,).
        unit: of length, "m" or "mm" if it is known.
        report: how well the systems were solved, in words; nothing with a plan.
        unexplained: the share of the record that fitted images leave, the largest of all frames;
            None of others, and where images of an earlier run are among them.
        remaining: how far fitted images are from where their iteration goes, relative, the farthest
            of all frames; None likewise.
    """

    image: Any
    grid: ImageGrid | VolumeGrid
    region: HasInside
    choices: Choices
    frames: Float[np.ndarray, " frames"] | None
    numbers: Int[np.ndarray, " frames"]
    unit: str | None
    report: str
    unexplained: float | None = None
    remaining: float | None = None


def reconstruct_file(
    path: str | Path,
    *,
    scanner: str | None = None,
    detectors: Any = None,
    sampling_rate: float | None = None,
    times: Any = None,
    start_time: float | None = None,
    element_response: Any = None,
    element_band: Any = None,
    frames: Any = None,
    out: Any = None,
    progress: bool = False,
    report: Callable[[str], Any] | None = None,
    **given: Any,
) -> ScanImages:
    """The image or images of a scan file; parameters that are not given are chosen.

    Args:
        path: a file that `load_scan` reads.
        scanner, detectors, sampling_rate, times, start_time, element_response, element_band,
            frames: what the file lacks, and which frames are wanted, see `with_facts`.
        out: as in `scans.reconstruct`.
        progress: whether to show a bar, if there is more than one frame.
        report: what to do with the table of choices, such as ``print``.
        given: choices by name, see `choose`.

    Returns:
        ScanImages.

    Raises:
        FileNotFoundError, ValueError: as `load_scan`, `choose` and `solve`.

    >>> import tempfile
    >>> from jaxtat import circular_arc, data_radii, disk, phantoms
    >>> curve = circular_arc(1.3, 1.0, 24)
    >>> radii = data_radii(curve, disk(0.8), 0.16)
    >>> g = phantoms.Bells([[0.1, -0.15]], [0.6]).circular_integrals(curve, radii)
    >>> path = Path(tempfile.mkdtemp()) / "scan.npz"
    >>> np.savez(path, circular_integrals=g, radii=radii, detectors=curve.points)
    >>> found = reconstruct_file(path, region_radius=0.8, pixels=11, max_frequency=7.85)
    >>> found.image.shape, found.choices.alpha
    ((11, 11), 1e-06)
    """
    scan = with_facts(
        load_scan(path),
        scanner=scanner,
        detectors=detectors,
        sampling_rate=sampling_rate,
        times=times,
        start_time=start_time,
        element_response=element_response,
        element_band=element_band,
        frames=frames,
    )
    choices = with_best_method(scan, choose(scan, **given))
    if report is not None:
        report(choices.table())
    return reconstruct(scan, choices, out=out, progress=progress)


def reconstruct(
    scan: Scan,
    choices: Choices,
    *,
    plan: ReconstructionPlan | None = None,
    out: Any = None,
    done: int = 0,
    progress: bool = False,
) -> ScanImages:
    """The images of all frames, a few in memory at a time; the geometry is computed once.

    Frames with NaN or infinite values in detectors that are used are left out, if there are others.

    Args:
        scan: its frames may be lazy.
        choices: from `choose`.
        plan: to use in place of a direct reconstruction; it has decided geometry and alpha. There
            are none in space.
        out: where images go, (frames that are good, x1, x2), or anything that slices can be
            assigned to; by default a new array.
        done: number of images that ``out`` has already; those that follow are made.
        progress: whether to show a bar, if there is more than one frame.

    Raises:
        ValueError: for ``out`` of another shape, images that do not fit into memory, and data that
            cannot be.

    Warns:
        AccuracyWarning: names the frames that are left out, and of fitted images that explain
            hardly anything.
    """
    shape = choices.grid.shape if plan is None else plan.setup.grid.shape
    room = _room((scan.n_frames, *shape)) if out is None else None
    scan = without_blank_frames(scan, choices)
    setup = setup_of(scan, choices) if plan is None else plan.setup
    report, (left, far) = "", np.zeros((2, scan.n_frames))
    worst, images = 0.0, (scan.n_frames, *shape)
    out = out if room is None else room[: scan.n_frames]
    if tuple(out.shape) != images:
        raise ValueError(f"out has shape {tuple(out.shape)}, expected {images}.")
    about = choices.body_center
    flipped = choices.in_space and facts_in_space(scan, choices.channels, about).upside_down
    with tqdm(total=scan.n_frames, unit="image", disable=not progress or scan.n_frames == 1) as bar:
        one_by_one = ((k, 1) for k in range(scan.n_frames))
        fits = choices.model_based and plan is None
        if choices.in_space and not fits:
            require_few(setup.curve)
        before = _first_start(setup) if choices.in_space and scan.n_frames > 1 else None
        for start, size in one_by_one if fits else frames_together(scan, scan.n_frames):
            n = min(size, scan.n_frames - start)
            if start + n <= done:
                bar.update(n)
                continue
            frames = _frames(scan, choices, start, size)
            if fits:
                found = fitted(scan, choices, setup, frames, initial=before, progress=progress)
                before = found.image if choices.in_space else None
                image, report = found.image, _fitted(found)
                left[start : start + n] = np.asarray(found.residual)
                far[start : start + n] = np.asarray(found.remaining)
            elif plan is None:
                g = integrals(scan, choices, setup, frames)
                found = _solve(setup, g, choices)
                residual = np.asarray(found.report.residual)
                image, worst = found.image, max(worst, float(residual.max()))
                report = _solved(setup, choices, worst)
            else:
                image = _by_plan(plan, integrals(scan, choices, setup, frames), choices)
            image = image[..., ::-1] if flipped else image
            out[start : start + n] = np.asarray(image).reshape(-1, *shape)[:n]
            bar.update(n)
    warn_of_hardly_any(left, frame_numbers(scan))
    several = scan.n_frames > 1 or "frame_numbers" in scan.known  # one of several is known by it
    numbers = scan.known.get("wavelengths", frame_numbers(scan))
    return ScanImages(
        image=out if several else out[0],
        grid=setup.grid,
        region=TurnedOver(setup.region) if flipped else setup.region,
        choices=choices,
        frames=np.asarray(numbers, float) if several else None,
        numbers=frame_numbers(scan),
        unit=choices.units.length if plan is None else facts_of(scan).units.length,
        report=report,
        unexplained=float(left.max()) if fits and not done else None,
        remaining=float(far.max()) if fits and not done else None,
    )


def without_blank_frames(scan: Scan, choices: Choices) -> Scan:
    """The scan without frames that have NaN in detectors in use; unchanged if all have."""
    good = ~blank_frames(scan, choices.channels)
    if good.all() or not good.any():
        return scan
    warnings.warn(
        f"frames {ranges(frame_numbers(scan)[~good])} are left out: they hold NaN or infinite "
        f"values in detectors that are used; {good.sum()} of {scan.n_frames} are reconstructed.",
        AccuracyWarning,
        stacklevel=3,
    )
    return some_frames(scan, np.flatnonzero(good))


def _first_start(setup: Setup) -> Array | None:
    """Zeros where no coarser grid gives a start, by which all frames share their programs."""
    return jnp.zeros(setup.grid.shape) if len(ladder(setup.grid)) == 1 else None


def _room(shape: tuple[int, ...]) -> np.ndarray:
    """A new array, or ValueError: a file may hold, or claim, any number of frames."""
    try:
        return np.empty(shape)
    except MemoryError as error:
        raise ValueError(
            f"the images of {shape[0]} frames do not fit into memory ({error}): choose fewer "
            "pixels, or give out, a memory map or dataset of an HDF5 file."
        ) from error


def _solve(setup: Setup, g: Array, choices: Choices) -> Reconstruction:
    with bounded_as_said(choices):
        alpha, low_pass, inversion = choices.alpha, choices.low_pass, choices.inversion
        if choices.in_space or inversion != "fourier":
            return solve(setup, g, alpha, low_pass=low_pass, inversion=inversion)
        problem = on_ladder(setup, len(choices.order), n_groups=GROUPS)
        return solve_on_ladder(problem, g, alpha, low_pass=low_pass)


def formula_images(
    setup: Setup, g: Array, choices: Choices, plan: ReconstructionPlan | None
) -> Array:
    """Images of integrals, by a plan if there is one; linear in them."""
    return _solve(setup, g, choices).image if plan is None else _by_plan(plan, g, choices)


def _by_plan(plan: ReconstructionPlan, g: Array, choices: Choices) -> Array:
    return reconstruct_by(plan, g, low_pass=choices.low_pass, inversion=choices.inversion)


def _solved(setup: Setup, choices: Choices, worst: float) -> str:
    return (
        f"{setup.sizes.n_frequencies} frequencies, alpha {choices.alpha:.1e}; systems solved to "
        f"{worst:.1e} (worst)"
    )


def _fitted(found: ModelBased) -> str:
    """Text about a fit; of several frames the worst values."""
    parts = found.steps, found.residual, found.weight, found.converged
    steps, residual, weight, converged = map(np.asarray, parts)  # else NumPy asks JAX
    ended = "" if converged.all() else f", not converged: {found.unsettled()}"
    return (
        f"{steps.max()} steps{ended}, weight {weight.max():.2e}; "
        f"{100 * residual.max():.0f} % of the record is not explained"
    )


def frames_together(scan: Scan, n: int) -> Iterator[tuple[int, int]]:
    """First frame and size of stacks of n frames: of few sizes, each of which takes programs.

    Only the last stack may be larger than what is left.
    """
    fit = AT_A_TIME // (8 * scan.n_detectors * scan.n_samples)
    sizes = [size for size in TOGETHER if size <= fit] or [min(max(fit, 1), FEW)]
    start = 0
    while start < n:
        size = next((size for size in sizes if size <= n - start), sizes[-1])
        size = 1 if n == 1 else size
        yield start, size
        start += size


def _frames(scan: Scan, choices: Choices, start: int, size: int) -> np.ndarray:
    """Frames from ``start`` on: one as (detectors, samples), else always as many, by zeros."""
    part = lit_frames(scan, choices, start, start + size)
    if size == 1:
        return part[0]
    return np.pad(part, ((0, size - len(part)), (0, 0), (0, 0)))
