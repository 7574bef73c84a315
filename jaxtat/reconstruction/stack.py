"""Many images: slices, wavelengths or time frames that together do not fit into memory."""

from typing import Any

import numpy as np
from tqdm import tqdm

from ..base.checks import require_unmasked, whole_number
from ..steps.radon import LowPass
from .direct import reconstruct
from .plan import ReconstructionPlan
from .setup import Setup, require_setup


def reconstruct_stack(
    problem: Setup | ReconstructionPlan,
    frames: Any,
    rule: Any = None,
    *,
    out: Any = None,
    batch_size: int = 32,
    low_pass: LowPass | None = None,
    inversion: str = "fourier",
    progress: bool = False,
) -> Any:
    """Images of a stack of data, read, reconstructed and written a few at a time.

    Args:
        problem, rule: as in `reconstruct`; with a plan images take milliseconds.
        frames: circular integrals, (n, *data_shape): an array, a memory map, an HDF5 dataset,
            or anything else with a shape that gives arrays for slices.
        out: where images go, (n, *grid.shape): likewise anything that slices can be assigned to; by
            default a new array.
        batch_size: images at a time, which bounds the memory.
        low_pass, inversion: as in `reconstruct`.
        progress: show a progress bar.

    Returns:
        ``out``.

    Raises:
        ValueError: for frames or an ``out`` of the wrong shape, and as `reconstruct`.

    >>> from jaxtat import ImageGrid, build_plan, circular_arc, disk
    >>> plan = build_plan(Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21)))
    >>> frames = np.zeros((5, *plan.setup.data_shape))
    >>> reconstruct_stack(plan, frames, batch_size=3).shape
    (5, 21, 21)
    """
    shape: tuple[int, ...] = tuple(getattr(frames, "shape", ()))
    setup = problem.setup if isinstance(problem, ReconstructionPlan) else problem
    require_setup(setup)
    wanted = setup.data_shape
    if not shape or shape[1:] != wanted:
        raise ValueError(f"frames have shape {shape}, expected (n, {str(wanted)[1:-1]}).")
    batch_size = whole_number("batch_size", batch_size, 1)
    expected = (shape[0], *setup.grid.shape)
    out = np.empty(expected) if out is None else out
    if tuple(out.shape) != expected:
        raise ValueError(f"out has shape {tuple(out.shape)}, expected {expected}.")
    with tqdm(total=shape[0], desc="images", unit="image", disable=not progress) as bar:
        for start in range(0, shape[0], batch_size):
            part = frames[start : start + batch_size]
            require_unmasked("frames", part)
            part = np.asarray(part)
            # one compiled size: the last batch is filled up
            missing = min(batch_size, shape[0]) - len(part)
            filled = np.pad(part, ((0, missing), *[(0, 0)] * len(wanted)))
            images = reconstruct(problem, filled, rule, low_pass=low_pass, inversion=inversion)
            out[start : start + len(part)] = np.asarray(images)[: len(part)]
            bar.update(len(part))
    return out
