"""The paper's geometries at any size: n pixels, 4 n - 16 detectors at most, n radii."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Array

from jaxtat import ImageGrid, Setup, circular_arc, data_radii, disk, phantoms

DETECTORS = {65: 250, 129: 500, 257: 1000, 513: 2000, 1025: 4000}


@dataclass(frozen=True)
class Problem:
    """A setup, a smooth phantom, its data and its image."""

    setup: Setup
    phantom: phantoms.Bells
    g: Array

    def error(self, image: Array) -> float:
        """Largest over the pixels of the region."""
        grid = self.setup.grid
        inside = self.setup.region.contains(grid.points)
        return float(np.abs(np.asarray(image - self.phantom.image(grid)))[inside].max())


@lru_cache(2)  # what several rows share
def problem(n: int, cut: float = 1.0) -> Problem:
    """Geometry #1 (cut = 1) or #2 (cut = 0) with n x n pixels."""
    curve, grid = circular_arc(1.3, cut, DETECTORS[n]), ImageGrid(n)
    region, whole = disk(1.0, cut), disk(1.0)
    setup = Setup(curve, region, grid, data_radii(curve, region, grid.spacing[0], sources=whole))
    if cut == 1.0:
        bells = phantoms.Bells([[0.3, 0.3], [-0.4, 0.2]], [0.55, 0.5])
    else:
        bells = phantoms.Bells([[-0.45, 0.3], [-0.5, -0.3]], [0.35, 0.3])
    return Problem(setup, bells, bells.circular_integrals(curve, setup.radii))
