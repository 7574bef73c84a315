"""The volumes of one page: a scan in space, by each method that it allows."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..geometry import SphericalCap
from ..io import Scan
from ..reconstruction.setup import require_complete
from ..scans import Choices, ScanImages, reconstruct, setup_of, with_best_method
from ..scans.acquisition import some_frames
from ..scans.space import require_few
from .image_methods import DIRECT, MODEL_BASED, as_direct, as_fit
from .viewed_scan import ViewedScan


class ShownVolume(NamedTuple):
    """The volume of one frame.

    Attributes:
        method, frame: which.
        made: as `scans.reconstruct` gives it, for a file.
        values: NaN outside of the region, to be shown.
        seconds: that it took.
    """

    method: str
    frame: int
    made: ScanImages
    values: Float[np.ndarray, "x1 x2 x3"]
    seconds: float


class VolumeSession(ViewedScan):
    """Volumes of a scan; they are those of `scans.reconstruct` for the same choices.

    Args:
        scan: in space; its frames may be lazy, and only those that are shown are read.
        choices: with which volumes are made; those of a fit are of the model-based ones.
        facts: what was said of the scan in options of the command, by their names.

    Attributes:
        by_method: the choices by "direct" and "model-based", as far as the scan allows.
        start: the method that is more accurate.
        direct_first: whether the direct volume is so fast that it is shown before a fit. Off rings
            it takes dense systems of all detectors, which are slower.

    Raises:
        ValueError: as `scans.reconstruct`, for scans that the formula does not take where it is
            asked for.
    """

    def __init__(self, scan: Scan, choices: Choices, facts: Mapping[str, Any] | None = None):
        best = with_best_method(scan, choices)
        choices = replace(choices, pixels=best.pixels)  # the slices of both stay where they are
        super().__init__(scan, choices, facts)
        direct = as_direct(choices)
        self.start = MODEL_BASED if best.model_based else DIRECT
        fit = best if best.model_based else as_fit(direct, best)
        self.by_method = {DIRECT: direct, MODEL_BASED: fit}
        setup = setup_of(scan, choices)
        try:
            require_complete(setup)
            require_few(setup.curve)
        except ValueError:
            if not best.model_based:
                raise
            del self.by_method[DIRECT]
        self.direct_first = DIRECT in self.by_method and isinstance(setup.curve, SphericalCap)

    def volume(self, method: str, frame: int) -> ShownVolume:
        """The volume of a frame.

        Raises:
            ValueError: for a frame that cannot be read or holds NaN, and a fit that takes more
                memory than is free.
        """
        start = time.perf_counter()
        made = reconstruct(some_frames(self.scan, [frame]), self.by_method[method])
        inside = np.asarray(made.region.contains(made.grid.points))
        volume = np.where(inside, np.reshape(made.image, made.grid.shape), np.nan)
        return ShownVolume(method, frame, made, volume, time.perf_counter() - start)
