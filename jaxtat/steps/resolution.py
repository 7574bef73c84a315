"""The polar grid of frequencies and directions, and checks of detectors, radii and pixels."""

import warnings

import jax
import numpy as np
from jaxtyping import Array

from ..base.checks import Numbers, is_concrete, real_array, require_positive, whole_number
from ..base.cost import Cost, image_cost, require_room
from ..geometry import (
    DetectorCurve,
    Grid,
    ImageGrid,
    Region,
    VisibilityWarning,
    require_outside,
    visibility,
)
from .quadrature import wave_error

UNSAMPLED = 0.05  # of the data that is too fine for the detectors without a word
_SHORTEST = 0.2  # error of the shortest wave, read between the radii; longer ones are much better
_FEWEST_DETAILS = 8  # radial steps within the region's reach: with fewer, images are wrong by 20 %
_COARSE = 2  # pixels between radii, above which there is detail that they miss
_BOUNDED = 0.9  # of the frequency that radii sample: a lower highest one was wanted for itself
_TO_SPARE = 2.5  # boundary points over the fewest, one for half the shortest wave


class AccuracyWarning(UserWarning):
    """The image may be inaccurate: too few detectors or radii, or unsolved linear systems."""


class Contradiction(AccuracyWarning):
    """A record cannot be of the detectors, times and units that it is said to have."""


class TooFewDetectors(AccuracyWarning):
    """The image holds waves that the detectors do not sample."""


class UnreachedWaves(AccuracyWarning):
    """Densities do not make the plane waves that the image is of."""


def enough_directions(waves: float) -> int:
    """Directions over half a turn for so many radians across the radius; a multiple of 32.

    Projections and image turn through twice as many in half a turn; a quarter is to spare.
    """
    return 32 * max(1, int(np.ceil(1.25 * waves / 32)))


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
    spacing, distances, reach = jax.lax.stop_gradient((grid.spacing, radii, region.reach))
    pixel, step = float(np.asarray(spacing).max()), float(np.diff(distances).max())
    if max_frequency is not None:
        max_frequency = real_array("max_frequency", max_frequency, ())
        require_positive("max_frequency", max_frequency)
    if n_directions is not None:
        n_directions = whole_number("n_directions", n_directions, 1)

    def sizes(coarser: float) -> tuple[float, int, int]:
        """Sizes of the polar grid for pixels that are this many times larger."""
        highest = np.pi / max(pixel * coarser, step)
        highest = highest if max_frequency is None else float(max_frequency)
        waves = highest * float(reach)  # radians across the radius
        n_frequencies = max(1, int(np.ceil(2 * waves / np.pi - 1e-6)))
        return highest, n_frequencies, n_directions or enough_directions(waves)

    def cost(n: int) -> Cost:
        """Cost with n pixels along the longest side."""
        coarser = max(grid.shape) / n
        return image_cost(tuple(size / coarser for size in grid.shape), *sizes(coarser)[1:])

    require_room(cost, max(grid.shape))
    highest, n_frequencies, n_directions = sizes(1.0)
    if is_concrete(radii):
        few = max_frequency is None or step > float(reach) / _FEWEST_DETAILS
        why = _unsampled_waves(np.asarray(radii), highest)
        why = why or (_too_few_radii(np.asarray(radii), highest, pixel) if few else "")
        if why:
            warnings.warn(why, AccuracyWarning, stacklevel=6)
    frequencies = highest / n_frequencies * np.arange(1, n_frequencies + 1)
    angles = np.arange(n_directions) * (np.pi / n_directions)
    return jax.device_put(frequencies), jax.device_put(angles)


def require_problem(curve: DetectorCurve, region: Region, grid: ImageGrid) -> None:
    """Raise ValueError for an impossible geometry; warn of lines that miss the curve."""
    require_outside(curve.points, region)
    if not is_concrete(curve, region, grid):
        return
    require_pixels(grid, float(region.reach))
    if not np.asarray(region.contains(grid.points)).any():
        raise ValueError(
            f"no node of the image grid (from {grid.points[0, 0]} to {grid.points[-1, -1]}) lies "
            f"in the region of interest, within {float(region.reach):.6g} of {region.center}: "
            "move or widen the grid."
        )
    seen = visibility(curve, region)
    # told where the Setup is made, two calls of equinox further up
    if float(seen.invisible_fraction) > 0:
        warnings.warn(str(seen), VisibilityWarning, stacklevel=6)


def require_pixels(grid: Grid, reach: float) -> None:
    """Raise ValueError for pixels larger than the region."""
    pixel = float(np.asarray(grid.spacing).max())
    if pixel > reach:
        raise ValueError(
            f"pixels are {pixel:.6g} apart, but the region reaches only {reach:.6g} from its "
            f"centre: use a half_width of about {reach:.6g}, or more pixels."
        )


def _unsampled_waves(radii: np.ndarray, highest: float) -> str:
    """In words, that the radii do not sample the shortest wave; "" if they do."""
    steps = np.diff(radii)
    error = 0.0
    if highest > (1 + 1e-3) * np.pi / steps.mean():
        error = 2.0  # waves that are alike on the radii may be opposite between them
    elif np.ptp(steps) > 1e-6 * steps.mean():
        error = wave_error(radii, highest)
    if error <= _SHORTEST:
        return ""
    return (
        f"radii {steps.mean():.4g} apart (up to {steps.max():.4g}) do not sample waves of "
        f"lambda = {highest:.4g}, they come out wrong by {100 * error:.0f} %: pass a lower "
        "max_frequency, or data on equispaced radii."
    )


def _too_few_radii(radii: np.ndarray, highest: float, pixel: float) -> str:
    """In words, that not the pixels bound the detail but radii much farther apart; "" if not."""
    step = float(np.diff(radii).max())
    if step <= (1 + 1e-6) * _COARSE * pixel or highest * step < _BOUNDED * np.pi:
        return ""
    n_wanted = int(np.ceil(np.ptp(radii) / pixel - 1e-6)) + 1
    return (
        f"radii are too few: {len(radii)}, up to {step:.4g} apart, for pixels {pixel:.4g} apart. "
        f"The image has details of {np.pi / highest:.4g} at best, and finer ones in the data "
        f"falsify it: record at {n_wanted} radii, or pass a lower max_frequency for data that are "
        "smooth."
    )


def warn_of_detectors(highest: float, possible: float, where: str, stacklevel: int) -> None:
    """Warn of waves that the detectors do not sample, for curves and for detectors in space.

    Args:
        highest: max_frequency [rad/length].
        possible: up to which frequency they do [rad/length].
        where: which detectors and which part of the region.
        stacklevel: of `warnings.warn`, counted from the caller.
    """
    warnings.warn(
        f"detectors are too few: they resolve frequencies up to {possible:.4g}, details of "
        f"{np.pi / possible:.4g}, but max_frequency is {highest:.4g}; {where}: use more "
        f"detectors, a smaller region, or pass max_frequency={possible:.4g}.",
        TooFewDetectors,
        stacklevel=stacklevel + 1,
    )


def enough_boundary(length: float, highest: float) -> int:
    """Boundary points for waves up to lambda: five a wavelength, as in the paper's examples.

    Args:
        length: of the boundary, or more [length].
        highest: lambda_max [rad/length].

    >>> enough_boundary(2 * np.pi, 100.0)
    500
    """
    return max(64, int(np.ceil(_TO_SPARE * length * highest / np.pi)))


def require_boundary(region: Region, highest: float) -> None:
    """Raise ValueError if boundary points are too far apart for the shortest wave."""
    spacing, half_wave = float(region.weights.max()), np.pi / highest
    if spacing > half_wave:
        n_least = enough_boundary(region.points.shape[0] * spacing, highest)
        raise ValueError(
            f"boundary points are {spacing:.4g} apart, more than half the shortest wavelength "
            f"({half_wave:.4g}): use n_boundary >= {n_least} or a lower max_frequency; "
            "left out, n_boundary is chosen by the frequencies."
        )
