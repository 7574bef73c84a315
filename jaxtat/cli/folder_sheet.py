"""The pictures of many image files on one sheet."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..base.atomic import replacing
from ..base.units import millimetres
from ..geometry import ImageGrid
from ..plotting import contact_sheet

MOST = 144  # pictures, evenly chosen of more
_ACROSS = 24  # characters of a title in one line


def write_sheet(path: Path, images: Sequence[tuple[Path, str]]) -> None:
    """The first image of each file, with its name above, in millimetres where all have a unit.

    Args:
        path: of the sheet.
        images: pairs of a file in HDF5 that `save_image` has written, and a name. Of a volume
            the largest values along x3 are shown.
    """
    n = min(len(images), MOST)
    chosen = np.unique(np.linspace(0, len(images) - 1, n).round().astype(int))
    panels, units = zip(*(_panel(*images[k]) for k in chosen), strict=True)
    figure = contact_sheet(panels, unit="mm" if all(units) else None)
    if n < len(images):
        figure.suptitle(f"{n} of {len(images)} scans", fontsize=10)
    with replacing(path) as new:
        figure.savefig(new, dpi=110)


def _panel(file: Path, name: str) -> tuple[tuple[np.ndarray, ImageGrid, str], bool]:
    """An image with its grid and title, and whether its unit is known."""
    with h5py.File(file) as opened:
        content: Any = opened
        data, unit = content["image"], content["x1"].attrs["unit"]
        inside, x1, x2 = (np.asarray(content[key]) for key in ("inside", "x1", "x2"))
        image = np.asarray(data[0] if data.ndim > inside.ndim else data[()])
    if image.ndim == 3:
        image, inside = image.max(axis=2), inside.any(axis=2)
    image = np.where(inside, image, np.nan)
    known = unit != "unknown"
    scale = millimetres(unit) if known else 1.0
    axes = [scale * x for x in (x1, x2)]
    half = tuple(float(np.ptp(x)) / 2 for x in axes)
    grid = ImageGrid(image.shape, half, np.array([x.mean() for x in axes]))
    return (image, grid, _title(name)), known


def _title(name: str) -> str:
    """A name in lines as wide as its picture, of a long one the end; no dollar begins a formula.

    >>> _title("monday/phantom-in-water-3.npz")
    'monday/phantom-in-\\nwater-3.npz'
    """
    shown = name if len(name) <= 2 * _ACROSS else f"...{name[3 - 2 * _ACROSS :]}"
    return "\n".join(textwrap.wrap(shown, _ACROSS)).replace("$", r"\$")
