"""From records to images on a given grid: the common part of the interfaces of other packages."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Num

from ..geometry import ImageGrid
from ..geometry.measured_curves import flat_axis
from ..io import Scan
from ..reconstruction import Setup
from ..scans import Choices, choose, integrals, setup_of, with_best_method
from ..scans.constrained import fitted, warn_of_hardly_any
from ..scans.images import formula_images


def images_on_grid(
    records: Num[np.ndarray | Array, "frames detectors samples"],
    positions: Float[np.ndarray, "detectors 3"],
    sampling_rate: float,
    sound_speed: float | None,
    axes: list[Float[np.ndarray, " nodes"]],
    choices: Mapping[str, Any],
    chosen: Choices | None = None,
) -> tuple[Float[np.ndarray, "frames x y z"], Choices]:
    """Images (frames, x, y, z) of records, zero outside the region of interest, and its choices.

    In 64 bits, whatever the caller has set.

    Args:
        records: from time 0, with (detectors, 3) positions in a coordinate plane [m].
        sampling_rate: [Hz].
        sound_speed: [m/s]; None to find that at which least is unexplained.
        axes: equispaced nodes along x, y and z [m], one across the plane of the detectors.
        choices: choices by name, as in `scans.choose`.
        chosen: in place of new choices: those of an earlier call with these positions.

    Raises:
        ValueError: for a volume, images under constraints, and as `scans.choose`.
    """
    flat, shape = flat_axis(positions), tuple(len(along) for along in axes)
    if flat is None or shape[flat] != 1:
        raise ValueError(
            f"the image has {shape} pixels, expected 1 across the plane of the detectors, which "
            "must be a coordinate plane."
        )
    known = {"detectors": positions, "sampling_rate": sampling_rate}
    if sound_speed is not None:
        known["sound_speed"] = float(sound_speed)
    scan = Scan("pressure", np.asarray(records, float), known)
    nodes = [along for axis, along in enumerate(axes) if axis != flat]
    ends = np.array([along[[0, -1]] for along in nodes])
    with jax.enable_x64(True):
        if chosen is None:
            chosen = with_best_method(scan, choose(scan, **choices))
        grid = ImageGrid(tuple(map(len, nodes)), np.ptp(ends, axis=1) / 2, ends.mean(axis=1))
        of_choices = setup_of(scan, chosen)
        where = of_choices.curve, of_choices.region, grid, of_choices.radii
        setup = Setup(*where, medium=of_choices.medium, max_frequency=chosen.max_frequency)
        frames = np.asarray(scan.data)
        if chosen.model_based:
            found = fitted(scan, chosen, setup, frames)
            images = np.asarray(found.image)
            left = np.full(scan.n_frames, np.asarray(found.residual))
            warn_of_hardly_any(left, np.arange(scan.n_frames))
        else:
            g = integrals(scan, chosen, setup, frames)
            images = np.asarray(formula_images(setup, g, chosen, None))
        inside = np.asarray(setup.region.contains(grid.points))
    return np.expand_dims(np.where(inside, images, 0.0), 1 + flat), chosen
