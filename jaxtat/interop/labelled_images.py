"""Images with coordinates: as labelled arrays of xarray, and as OME-Zarr.

Both keep the order of the array, f[x1, x2]; outside the region both are NaN.
"""

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from ..base.optional_packages import optional
from ..base.units import millimetres
from ..io.provenance import as_json, provenance_of
from ..scans import ScanImages

OME_VERSION = "0.5"
_NAMES = ("x1", "x2", "x3")


def to_xarray(
    result: ScanImages,
    *,
    deviation: np.ndarray | None = None,
    wavelengths: np.ndarray | None = None,
    inputs: Sequence[str | Path] = (),
) -> Any:
    """Images of a scan as an `xarray.Dataset`, which writes itself to NetCDF or Zarr.

    Needs xarray: ``pip install 'jaxtat[xarray]'``.

    Args:
        result: by `scans.reconstruct` or `reconstruct_file`.
        deviation: of its pixels, by `scans.standard_deviations`.
        wavelengths: of the frames, (frames,) [nm], such as ``scan.known["wavelengths"]``.
        inputs: files from which the images were made; names and SHA-256 are stored.

    Returns:
        With ``image`` and perhaps ``standard_deviation`` over ``frame`` (of several), ``x1``,
        ``x2`` (and ``x3``) in metres where the scan's unit is known; coordinates ``frame`` (the
        numbers in the file) and ``wavelength`` [nm]; settings and provenance as attributes (JSON).

    Raises:
        ValueError: without xarray, and for another number of wavelengths than frames.
    """
    xarray = optional("xarray", "to_xarray", "xarray")
    scale, unit = _metres(result)
    axes = [scale * along for along in _nodes(result)]
    names, several = _NAMES[: len(axes)], result.frames is not None
    dims = ("frame", *names) if several else names
    inside = np.asarray(result.region.contains(result.grid.points))
    coordinates: dict[str, Any] = {
        name: (name, along, {"units": unit}) for name, along in zip(names, axes, strict=True)
    }
    if several:
        coordinates["frame"] = np.asarray(result.numbers)
    if wavelengths is not None:
        along = np.asarray(wavelengths, float)
        if along.shape != result.numbers.shape:
            raise ValueError(
                f"wavelengths have shape {along.shape}, but there are {len(result.numbers)} images."
            )
        dimension = ("frame", along) if several else ((), along[0])
        coordinates["wavelength"] = (*dimension, {"units": "nm"})
    variables = {"image": (dims, np.where(inside, result.image, np.nan))}
    if deviation is not None:
        spread = deviation if several else np.asarray(deviation)[0]
        variables["standard_deviation"] = (dims, np.where(inside, spread, np.nan))
    return xarray.Dataset(variables, coordinates, _texts(result, inputs))


def save_ome_zarr(
    path: str | Path,
    result: ScanImages,
    *,
    wavelengths: np.ndarray | None = None,
    inputs: Sequence[str | Path] = (),
) -> None:
    """Write images of a scan as OME-Zarr 0.5 (Zarr 3), for napari, Fiji and viewers in browsers.

    One resolution, float32, axes frame (a channel), z, y, x with x1 along x and x2 along y;
    millimetres; the translation is the position of pixel 0. Needs zarr: ``pip install
    'jaxtat[zarr]'``.

    Args:
        path: a folder that is not there yet, such as ``scan.ome.zarr``; it appears when whole.
        result: by `scans.reconstruct` or `reconstruct_file`.
        wavelengths: of the frames, (frames,) [nm]: names of the channels.
        inputs: files from which the images were made; names and SHA-256 are stored.

    Raises:
        ValueError: without zarr, for a folder that is there, or where none can be made.

    Source: OME-NGFF 0.5, https://ngff.openmicroscopy.org/0.5.
    """
    zarr, target = require_ome_zarr(path), Path(path).resolve()
    shape, d = result.grid.shape, len(result.grid.shape)
    inside = np.asarray(result.region.contains(result.grid.points))
    images = np.where(inside, result.image, np.nan).reshape(-1, *shape, *(1,) * (3 - d))
    data = images.transpose(0, 3, 2, 1).astype(np.float32)
    labels = result.numbers if wavelengths is None else [f"{w:g} nm" for w in wavelengths]
    marks = {
        "ome": _ome(result, [str(label) for label in labels]),
        "jaxtat": _texts(result, inputs),
    }
    made = Path(mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        group = zarr.create_group(made, attributes=json.loads(as_json("attributes", marks)))
        array = group.create_array(
            "0",
            shape=data.shape,
            chunks=(1, *data.shape[1:]),
            dtype="float32",
            dimension_names=("c", "z", "y", "x"),
        )
        array[:] = data
        made.chmod(0o755)
        made.rename(target)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def require_ome_zarr(path: str | Path) -> Any:
    """The package that writes OME-Zarr; ValueError without it, and if no folder can be made."""
    zarr, target = optional("zarr", "save_ome_zarr", "zarr"), Path(path).resolve()
    if target.exists():
        raise ValueError(f"cannot write {path}: it is there already.")
    if not target.parent.is_dir():
        raise ValueError(f"cannot write {path}: there is no folder {target.parent}.")
    return zarr


def _ome(result: ScanImages, labels: Sequence[str]) -> dict[str, Any]:
    """The meta data of an image with one resolution."""
    unit = None if result.unit is None else "millimeter"
    scale = millimetres(result.unit)
    nodes = [*_nodes(result), np.zeros(1)][:3][::-1]  # z, y, x
    steps = [scale * float(along[1] - along[0]) if len(along) > 1 else 1.0 for along in nodes]
    first = [scale * float(along[0]) for along in nodes]
    space: list[dict[str, Any]] = [
        {"name": name, "type": "space"} | ({"unit": unit} if unit else {}) for name in "zyx"
    ]
    where = [
        {"type": "scale", "scale": [1.0, *steps]},
        {"type": "translation", "translation": [0.0, *first]},
    ]
    multiscale = {
        "axes": [{"name": "c", "type": "channel"}, *space],
        "datasets": [{"path": "0", "coordinateTransformations": where}],
        "name": "jaxtat",
    }
    low, high = float(np.nanmin(result.image)), float(np.nanmax(result.image))
    window = {"min": low, "max": high, "start": low, "end": high}
    shown = [
        {"label": label, "active": k == 0, "color": "FFFFFF", "window": window}
        for k, label in enumerate(labels)
    ]
    return {"version": OME_VERSION, "multiscales": [multiscale], "omero": {"channels": shown}}


def _nodes(result: ScanImages) -> list[np.ndarray]:
    return [np.asarray(result.grid.axis(k), float) for k in range(len(result.grid.shape))]


def _metres(result: ScanImages) -> tuple[float, str]:
    """The unit of length in metres, and the name of the unit in which lengths are written."""
    return (1.0, "unknown") if result.unit is None else (1e-3 * millimetres(result.unit), "m")


def _texts(result: ScanImages, inputs: Sequence[str | Path]) -> Mapping[str, str]:
    return {
        "settings": as_json("settings", result.choices.settings()),
        "provenance": as_json("provenance", provenance_of(inputs, result.unit)),
    }
