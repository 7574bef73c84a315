"""jaxtat in napari: a reader of its images, and a panel that reconstructs a scan.

``napari.toml`` tells napari what is here, once jaxtat is installed beside it. Reading needs no
package of napari's; the panel does: ``pip install 'jaxtat[napari]'``, and a Qt, such as PyQt6.

Layers have rows from the top (largest x2) downwards and columns along x1, as napari shows them, of
volumes slices along x3, and lengths in millimetres where the unit is known; napari's second axis
from the end is -x2.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..base.optional_packages import optional
from ..base.units import millimetres
from ..io import load_settings
from ..io.images import read_parts
from ..scans import ScanImages, reconstruct_file

SUFFIXES = (".h5", ".hdf5")
Layer = tuple[np.ndarray, dict[str, Any], str]


def get_reader(path: str | Sequence[str]) -> Callable[[str | Sequence[str]], list[Layer]] | None:
    """`read` for files that `save_image` has written, and None for all others, as napari expects.

    >>> get_reader("picture.png") is None
    True
    """
    for each in _each(path):
        if not each.endswith(SUFFIXES):
            return None
        try:
            load_settings(each)
        except (OSError, ValueError):
            return None  # HDF5 of others
    return read


def read(path: str | Sequence[str]) -> list[Layer]:
    """A layer for each file: the array, its position, and the type of the layer.

    Raises:
        ValueError: for a file that is damaged, or none of `save_image`.
    """
    return [_of_file(Path(each)) for each in _each(path)]


def reconstruction_panel() -> Any:
    """A panel to choose a scan and reconstruct it as `reconstruct_file`: a `magicgui` widget.

    A number that is zero is chosen from the scan.
    """
    magicgui = optional("magicgui", "the panel in napari", "napari")
    layer = optional("napari.types", "the panel in napari", "napari").LayerDataTuple

    def reconstruct(
        scan: Path, sound_speed: float = 0.0, alpha: float = 0.0, model_based: bool = False
    ) -> Any:
        options = {"sound_speed": sound_speed, "alpha": alpha, "model_based": model_based}
        with jax.enable_x64(True):
            result = reconstruct_file(
                scan, **{name: value for name, value in options.items() if value}
            )
        return [of_scan(result, scan.name)]

    # napari tells by its own type what to do with an answer
    reconstruct.__annotations__["return"] = list[layer]
    numbers = {"min": 0.0, "max": 1e9, "step": 1e-6}
    return magicgui.magicgui(
        reconstruct, call_button="Reconstruct", sound_speed=numbers, alpha=numbers
    )


def of_scan(result: ScanImages, name: str) -> Layer:
    """Images of a scan as a layer; outside the region they are NaN, which napari leaves blank.

    Args:
        result: by `scans.reconstruct` or `reconstruct_file`.
        name: of the layer.
    """
    grid = result.grid
    axes = [np.asarray(grid.axis(k), float) for k in range(len(grid.shape))]
    inside = np.asarray(result.region.contains(grid.points))
    about = {"name": name, "metadata": {"settings": result.choices.settings()}}
    return _layer(np.asarray(result.image), inside, axes, result.unit, about)


def _of_file(path: Path) -> Layer:
    settings = load_settings(path)
    texts, arrays = read_parts(path, "image", "inside", "x1", "x2", "x3")
    axes = [arrays[name].astype(float) for name in ("x1", "x2", "x3") if name in arrays]
    image, inside = arrays["image"], arrays["inside"]
    made = json.loads(texts["provenance"] or "{}")
    about = {"name": path.stem, "metadata": {"settings": settings}}
    return _layer(image, inside, axes, made.get("length_unit"), about)


def _layer(
    image: np.ndarray,
    inside: np.ndarray,
    axes: list[np.ndarray],
    unit: str | None,
    about: dict[str, Any],
) -> Layer:
    """(frames?, x1, x2) or (frames?, x1, x2, x3) as (frames?, x3?, -x2, x1)."""
    d, scale = len(axes), millimetres(unit)
    blank = np.where(inside, image, np.nan)
    frames = blank.ndim - d
    turned = blank.transpose(*range(frames), *range(blank.ndim - 1, frames - 1, -1))
    turned = np.flip(turned, axis=-2)
    nodes = [scale * nodes for nodes in axes]
    nodes[1] = -nodes[1][::-1]
    nodes = nodes[::-1]
    labels = ("-x2", "x1") if d == 2 else ("x3", "-x2", "x1")
    place = {
        "scale": (1.0,) * frames + tuple(float(along[1] - along[0]) for along in nodes),
        "translate": (0.0,) * frames + tuple(float(along[0]) for along in nodes),
        "axis_labels": ("frame",) * frames + labels,
        "units": ("pixel",) * frames + ("pixel" if unit is None else "mm",) * d,
    }
    return turned, place | about, "image"


def _each(path: str | Sequence[str]) -> list[str]:
    return [path] if isinstance(path, str) else list(path)
