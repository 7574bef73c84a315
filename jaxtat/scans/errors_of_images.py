"""How far a scan's image may be off: of a fitted one on few pixels, of the formula by its noise."""

import warnings
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.scipy.ndimage import map_coordinates
from jaxtyping import Array, Float, Real

from ..fitting import fitted_deviation
from ..geometry import ImageGrid
from ..io import Scan
from ..reconstruction import Setup, forward_operator
from ..records import circular_integrals_to_pressure
from ..steps import AccuracyWarning
from .acquisition import some_frames
from .choices import Choices
from .constrained import fitted, of_all_sound
from .deviations import standard_deviations
from .frames import lit_frames, setup_of, shifted_times, through_elements

PIXELS = 48  # along an axis, at most: what is wide takes no more
FITTED = 2  # along an axis, pixels that are fitted for each of them
FINER = 4  # parts of a pixel over which the image is averaged


class ImageErrors(NamedTuple):
    """Standard deviations of an image's errors.

    Attributes:
        grid: their nodes, of a fitted image fewer than it has.
        image: means of the image over these pixels, NaN outside of the region.
        deviation: (x1, x2), NaN outside of the region [unit of f].
    """

    grid: ImageGrid
    image: Float[Array, "x1 x2"]
    deviation: Float[Array, "x1 x2"]


def image_errors(
    scan: Scan, choices: Choices, number: int, image: Float[Array | np.ndarray, "x1 x2"]
) -> ImageErrors | None:
    """How far the image of one frame may be off, by whichever method it was made.

    Of a fitted image that is `fit_errors`: noise, bias, and what the penalty filled in. Of one by
    the formula it is the noise alone, by `standard_deviations`.

    Args:
        scan, choices: of the image.
        number: of the frame in the scan, from 0.
        image: of that frame.

    Returns:
        ImageErrors; None where nothing tells of the noise of an image by the formula.

    Raises:
        ValueError: for volumes, and an image of another shape than the choices' grid.
    """
    if choices.in_space:
        raise ValueError("errors of images are known in the plane alone, and this is a volume.")
    if jnp.shape(image) != choices.grid.shape:
        raise ValueError(
            f"image has shape {jnp.shape(image)}, expected that of the choices' grid, "
            f"{choices.grid.shape}: pass the image of one frame, made by these choices."
        )
    (frame,) = lit_frames(scan, choices, number, number + 1)
    if choices.model_based:
        return fit_errors(scan, choices, frame, jnp.asarray(image))
    deviation = standard_deviations(some_frames(scan, [number]), choices)
    if deviation is None:
        return None
    inside = np.asarray(choices.region.contains(choices.grid.points))
    both = (jnp.where(inside, x, jnp.nan) for x in (image, deviation[0]))
    assert isinstance(choices.grid, ImageGrid)
    return ImageErrors(choices.grid, *both)


def fit_errors(
    scan: Scan,
    choices: Choices,
    frame: Real[np.ndarray, "detectors samples"],
    image: Float[Array, "x1 x2"],
    *,
    samples: int = 8,
) -> ImageErrors:
    """`fitted_deviation` of a frame's fitted image, made again from simulated records.

    Args:
        scan, choices: of the image.
        frame: of which it was made, rows as in the file.
        image: in the plane.
        samples: fits that are made for it.
    """
    shown = _shown(choices)
    coarse = _coarse(choices, shown)
    setup, rows = setup_of(scan, coarse), list(choices.channels)
    fine, grid = choices.grid, setup.grid
    assert isinstance(fine, ImageGrid) and isinstance(grid, ImageGrid)

    def in_file(data: Array) -> np.ndarray:
        frames = np.zeros((*data.shape[:-2], *frame.shape))
        frames[..., rows, :] = np.asarray(data)
        return frames

    inside = setup.may_sound(grid, coarse.max_frequency)
    means = _means(fine, image, grid)
    deviation = fitted_deviation(
        lambda data: fitted(scan, coarse, setup, in_file(data)).image,
        lambda images: _heard(scan, coarse, setup, images),
        means,
        np.asarray(frame, float)[rows],
        inside,
        nonnegative=choices.nonnegative,
        seen=shown.means,
        samples=samples,
    )
    means = jnp.where(jnp.isnan(deviation), jnp.nan, shown.means(means))
    return ImageErrors(shown, means, deviation)


def _shown(choices: Choices) -> ImageGrid:
    """The grid on which errors are shown, of at most half as many pixels as the image has."""
    n = max(4, min(PIXELS, choices.pixels // FITTED))
    return ImageGrid(n, choices.half_width, np.array(choices.region_center))


def _coarse(choices: Choices, shown: ImageGrid) -> Choices:
    """Of images on a grid as fine as `FITTED` says, and no finer waves than it holds."""
    grid = shown.finer(FITTED)
    highest = min(choices.max_frequency, float(np.pi / grid.spacing.max()))
    half_width = float(grid.half_width.max())
    return replace(choices, pixels=grid.shape[0], half_width=half_width, max_frequency=highest)


def _heard(scan: Scan, choices: Choices, setup: Setup, images: Array) -> Array:
    """What a scanner would have recorded, (images, detectors that are used, samples)."""
    times = shifted_times(scan, choices)
    if times is None:
        return forward_operator(setup)(images)
    reaching = of_all_sound(setup, choices)
    g = forward_operator(reaching)(images)
    with warnings.catch_warnings():  # details reach to the rim of the region, and no farther
        warnings.simplefilter("ignore", AccuracyWarning)
        pressure = circular_integrals_to_pressure(
            g, reaching.radii, times, sound_speed=choices.path_speed, model=choices.model
        )
    return through_elements(scan, choices, pressure)


def _means(fine: ImageGrid, image: Array, coarse: ImageGrid) -> Float[Array, "x1 x2"]:
    """Means over the pixels of a coarser grid; what is beyond the image is zero."""
    points = coarse.finer(FINER).points
    places = (points - fine.points[0, 0]) / fine.spacing
    return coarse.means(map_coordinates(image, list(jnp.moveaxis(places, -1, 0)), order=1))
