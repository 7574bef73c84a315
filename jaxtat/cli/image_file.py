"""The images of one scan in a file; those of a series are kept while they are made."""

import argparse
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.option_values import OME_ZARR
from ..geometry import ImageGrid
from ..io import Scan
from ..io.images import save_image
from ..io.unfinished import UnfinishedImages
from ..reconstruction import ReconstructionPlan
from ..scans import Choices, ScanImages, image_errors, reconstruct
from ..scans.images import without_blank_frames
from ..steps import AccuracyWarning
from .digest_of_inputs import made_from


def settings_of(options: argparse.Namespace) -> dict[str, Any]:
    """The options as settings of an image."""
    return {name: value for name, value in vars(options).items() if name != "run"}


def inputs_of(options: argparse.Namespace) -> list[str]:
    """The input files of an image."""
    return [path for path in (options.file, options.plan) if path]


def write_image(
    options: argparse.Namespace,
    scan: Scan,
    choices: Choices,
    plan: ReconstructionPlan | None,
    more: Callable[[ScanImages], dict[str, Any]] = lambda result: {},
) -> str:
    """Make the images of a scan and write them to ``options.out``.

    Several images are kept on the disk as they are made, and so need no memory together; a command
    that was interrupted goes on with them.

    Args:
        options: of the command.
        scan, choices, plan: as in `scans.reconstruct`.
        more: settings of the file besides options and choices.

    Returns:
        How well systems were solved, or images fitted, in words.
    """
    if options.errors and choices.in_space:
        raise ValueError("--errors are known of images in the plane, and this is a volume.")
    scan = without_blank_frames(scan, choices)
    with _room_for_images(options, scan, choices, plan) as kept:
        done = 0 if kept is None else kept.done
        progress = not options.quiet
        result = reconstruct(scan, choices, plan=plan, out=kept, done=done, progress=progress)
        images = result.image if kept is None else kept.images()
        errors = _errors(scan, choices, images) if options.errors else None
        of_fit = {"of_fit": shares_of_fit(result)}
        if options.out.endswith(OME_ZARR):
            from ..interop import save_ome_zarr  # with adapters that no other image needs

            save_ome_zarr(
                options.out,
                replace(result, image=images, unit=options.length_unit or result.unit),
                wavelengths=scan.known.get("wavelengths"),
                inputs=inputs_of(options),
            )
            return result.report
        save_image(
            options.out,
            images,
            result.grid,
            result.region,
            settings_of(options) | choices.settings() | of_fit | more(result),
            frames=result.frames,
            errors=errors,
            unit=options.length_unit or result.unit,
            inputs=inputs_of(options),
        )
        del images  # a memory map keeps its file
    return result.report


def shares_of_fit(result: ScanImages) -> dict[str, float]:
    """What a fit leaves of the record, and of its way if it took steps enough to tell."""
    both = {"unexplained": result.unexplained, "remaining": result.remaining}
    return {name: share for name, share in both.items() if share is not None and share < np.inf}


def _errors(scan: Scan, choices: Choices, images: Any) -> tuple[np.ndarray, ImageGrid] | None:
    """How far the images may be off, as `save_image` takes it; None where that is not known."""
    stack = images if images.ndim == 3 else images[None]
    found = [image_errors(scan, choices, k, image) for k, image in enumerate(stack)]
    known = [errors for errors in found if errors is not None]
    if len(known) < len(found):
        warnings.warn(
            "how far the image may be off is not known: its formula's errors are those of noise, "
            "and no part of the record is quiet.",
            AccuracyWarning,
            stacklevel=2,
        )
        return None
    deviations = np.stack([np.asarray(errors.deviation) for errors in known])
    return deviations.reshape(*images.shape[:-2], *deviations.shape[1:]), known[0].grid


@contextmanager
def _room_for_images(
    options: argparse.Namespace,
    scan: Scan,
    choices: Choices,
    plan: ReconstructionPlan | None,
) -> Iterator[UnfinishedImages | None]:
    """A place for the images of several frames, which stays if the command does not end well."""
    if scan.n_frames == 1:
        yield None
        return
    shape = choices.grid.shape if plan is None else plan.setup.grid.shape
    kept = UnfinishedImages(options.out, made_from(options), (scan.n_frames, *shape))
    if kept.done:
        _note(options, f"goes on after {kept.done} of {scan.n_frames} images of an earlier run")
    try:
        yield kept
    except BaseException:
        if kept.done:
            _note(options, f"{kept.done} of {scan.n_frames} images are kept: run it again to go on")
        else:
            kept.remove()
        raise
    kept.remove()


def _note(options: argparse.Namespace, text: str) -> None:
    if not options.quiet:
        print(f"jaxtat: note: {text}.", file=sys.stderr)
