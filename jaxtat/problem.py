"""What is asked: the polar grid of frequencies and directions, and whether it can be answered."""

import warnings

import jax
import numpy as np
from jaxtyping import Array

from .checks import Numbers, is_concrete, real_array, require_positive, whole_number
from .geometry import (
    DetectorCurve,
    Grid,
    ImageGrid,
    Region,
    VisibilityWarning,
    require_cover,
    require_outside,
    visibility,
)


class AccuracyWarning(UserWarning):
    """The image will not be what was asked for: waves not reached, or systems not solved."""


def polar_grid(
    region: Region,
    grid: Grid,
    radii: Array,
    max_frequency: Numbers | None,
    n_directions: int | None,
) -> tuple[Array, Array]:
    """Frequencies i d lambda, i = 1..n, and directions over half a turn.

    lambda_max is by default π over the larger of pixel and radial step, beyond which neither data
    nor image hold anything; d lambda <= π/(2 R) resolves projections up to |s| = 2 R.
    """
    if max_frequency is None:
        spacing, distances = jax.lax.stop_gradient((grid.spacing, radii))
        highest = np.pi / max(np.asarray(spacing).max(), np.diff(distances).max())
    else:
        frequency = real_array("max_frequency", max_frequency, ())
        require_positive("max_frequency", frequency)
        highest = float(frequency)
    waves = highest * float(jax.lax.stop_gradient(region.reach))  # radians across the radius
    n_frequencies = max(1, int(np.ceil(2 * waves / np.pi - 1e-6)))
    if n_directions is None:
        # projections and image turn through 2 * waves radians in half a turn; a quarter to spare
        n_directions = 32 * max(1, int(np.ceil(1.25 * waves / 32)))
    n_directions = whole_number("n_directions", n_directions, 1)
    frequencies = highest / n_frequencies * np.arange(1, n_frequencies + 1)
    angles = np.arange(n_directions) * (np.pi / n_directions)
    return jax.device_put(frequencies), jax.device_put(angles)


def require_problem(curve: DetectorCurve, region: Region, grid: ImageGrid, radii: Array) -> None:
    """Raise ValueError for a geometry that cannot work, warn of one that sees too little."""
    require_outside(curve, region)
    require_cover(curve, region, radii)
    if not is_concrete(curve, region, grid):
        return
    if not np.asarray(region.contains(grid.points)).any():
        raise ValueError(
            f"no node of the image grid (from {grid.points[0, 0]} to {grid.points[-1, -1]}) lies "
            f"in the region of interest, within {float(region.reach):.6g} of {region.center}: "
            "move or widen the grid."
        )
    seen = visibility(curve, region)
    if seen.invisible_fraction > 0:
        warnings.warn(str(seen), VisibilityWarning, stacklevel=4)


def enough_boundary(region: Region, highest: float) -> int:
    """Boundary points for waves up to lambda: five a wavelength, as in the paper's examples."""
    return max(64, int(np.ceil(2.5 * float(region.weights.sum()) * highest / np.pi)))


def require_boundary(region: Region, highest: float) -> None:
    """Raise ValueError if boundary points are too far apart for the shortest wave."""
    spacing, half_wave = float(region.weights.max()), np.pi / highest
    if spacing > half_wave:
        n_least = int(np.ceil(1.5 * region.points.shape[0] * spacing / half_wave))
        raise ValueError(
            f"boundary points are {spacing:.4g} apart, more than half the shortest wavelength "
            f"({half_wave:.4g}): use n_boundary >= {n_least} or a lower max_frequency."
            " Left out, n_boundary is chosen by the frequencies."
        )
