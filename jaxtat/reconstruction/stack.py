"""Many images: slices, wavelengths or time frames that together do not fit into memory."""

from typing import Any

import numpy as np
from tqdm import tqdm

from ..checks import whole_number
from ..plan import ReconstructionPlan
from .pipeline import reconstruct
from .radon import LowPass


def reconstruct_stack(
    plan: ReconstructionPlan,
    frames: Any,
    *,
    out: Any = None,
    batch_size: int = 32,
    low_pass: LowPass | None = None,
    inversion: str = "fbp",
    progress: bool = True,
) -> Any:
    """Images of a stack of data, read, reconstructed and written a few at a time.

    Args:
        plan: as in `reconstruct`.
        frames: circular integrals, (n, detectors, radii): an array, a memory map, an HDF5 dataset,
            or anything else with a shape that gives arrays for slices.
        out: where images go, (n, x1, x2): likewise anything that slices can be assigned to; by
            default a new array.
        batch_size: images at a time, which bounds the memory.
        low_pass, inversion: as in `reconstruct`.
        progress: show a progress bar.

    Returns:
        ``out``.

    Raises:
        ValueError: for frames or an ``out`` of the wrong shape, and as `reconstruct`.

    >>> from jaxtat import ImageGrid, build_plan, circular_arc, data_radii, truncated_disk
    >>> curve, region, grid = circular_arc(1.3, 1.0, 40), truncated_disk(1, 1, 80), ImageGrid(11)
    >>> radii = data_radii(curve, region, grid.spacing[0])
    >>> plan = build_plan(curve, region, grid, radii, progress=False)
    >>> frames = np.zeros((5, 40, len(radii)))
    >>> reconstruct_stack(plan, frames, batch_size=2, progress=False).shape
    (5, 11, 11)
    """
    shape = tuple(getattr(frames, "shape", ()))
    wanted = (plan.curve.n_detectors, plan.radii.shape[0])
    if len(shape) != 3 or shape[1:] != wanted:
        raise ValueError(f"frames have shape {shape}, expected (n, {wanted[0]}, {wanted[1]}).")
    batch_size = whole_number("batch_size", batch_size, 1)
    images = (shape[0], *plan.grid.shape)
    out = np.empty(images) if out is None else out
    if tuple(out.shape) != images:
        raise ValueError(f"out has shape {tuple(out.shape)}, expected {images}.")
    with tqdm(total=shape[0], desc="images", unit="image", disable=not progress) as bar:
        for start in range(0, shape[0], batch_size):
            part = np.asarray(frames[start : start + batch_size])
            # one compiled size: the last batch is filled up
            missing = min(batch_size, shape[0]) - len(part)
            filled = np.pad(part, ((0, missing), (0, 0), (0, 0)))
            found = reconstruct(plan, filled, low_pass=low_pass, inversion=inversion)
            out[start : start + len(part)] = np.asarray(found)[: len(part)]
            bar.update(len(part))
    return out
