"""Images out: PNG, NumPy and HDF5, chosen by the suffix of the file."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..checks import Numbers
from ..geometry import ImageGrid, Region
from .atomic import replacing

SUFFIXES = (".png", ".npy", ".h5")


def save_image(
    path: str | Path,
    image: Numbers,
    grid: ImageGrid,
    region: Region,
    settings: dict[str, Any],
) -> None:
    """Write an image; outside the region of interest it is blank (PNG) or zero.

    Args:
        path: ends in .png (a picture with axes), .npy (the bare array f[x1, x2]) or .h5 (image,
            coordinates, whether each pixel is inside the region, and settings).
        image: (x1, x2).
        grid, region: where it is.
        settings: names and values to be stored with an .h5 file.

    Raises:
        ValueError: for another suffix, a folder that does not exist, or an image whose shape is
            not the grid's.
    """
    suffix = require_suffix(path)
    if np.shape(image) != grid.shape:
        raise ValueError(f"the image has shape {np.shape(image)}, its grid has {grid.shape}.")
    inside = np.asarray(region.contains(grid.points))
    image = np.where(inside, np.asarray(image), 0.0)
    with replacing(path) as temporary:
        if suffix == ".png":
            from ..plotting import save_picture  # matplotlib is slow to import

            save_picture(temporary, np.where(inside, image, np.nan), grid)
        elif suffix == ".npy":
            np.save(temporary, image)
        else:
            with h5py.File(temporary, "w") as file:
                file["image"], file["inside"], file["x1"], file["x2"] = (
                    image,
                    inside,
                    grid.x1,
                    grid.x2,
                )
                file.attrs.update(settings)


def require_suffix(path: str | Path) -> str:
    """The suffix of an image file, or ValueError: asked before hours of work, not after."""
    suffix = Path(path).suffix
    if suffix not in SUFFIXES:
        raise ValueError(f"cannot write {path}: expected a name ending in {', '.join(SUFFIXES)}.")
    return suffix
