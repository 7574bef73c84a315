"""The paper's geometries at any size: n pixels, 4 n - 16 detectors at most, n radii."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxtat import ImageGrid, circular_arc, data_radii, disk, phantoms
from jaxtat.geometry import CircularArc

DETECTORS = {65: 250, 129: 500, 257: 1000, 513: 2000, 1025: 4000}


@dataclass(frozen=True)
class Problem:
    """A geometry, a smooth phantom, its data and its image."""

    curve: CircularArc
    region: TruncatedDisk
    grid: ImageGrid
    radii: Array
    phantom: phantoms.Bells
    g: Array

    @property
    def where(self) -> tuple:
        return self.curve, self.region, self.grid, self.radii

    def error(self, image: Array) -> float:
        """Largest over the pixels of the region."""
        inside = self.region.contains(self.grid.points)
        return float(np.abs(np.asarray(image - self.phantom.image(self.grid)))[inside].max())


def problem(n: int, right: float = 1.0) -> Problem:
    """Geometry #1 (right = 1) or #2 (right = 0) with n x n pixels."""
    n_detectors = DETECTORS[n]
    curve, grid = circular_arc(1.3, right, n_detectors), ImageGrid(n)
    whole = disk(1.0)
    region = disk(1.0, right)
    radii = data_radii(curve, region, grid.spacing[0], sources=whole)
    if right == 1.0:
        bells = phantoms.Bells([[0.3, 0.3], [-0.4, 0.2]], [0.55, 0.5])
    else:
        bells = phantoms.Bells([[-0.45, 0.3], [-0.5, -0.3]], [0.35, 0.3])
    g = bells.circular_integrals(curve, radii)
    return Problem(curve, region, grid, jnp.asarray(radii), bells, g)
