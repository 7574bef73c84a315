"""Images and volumes out, single ones and stacks; the suffix of the file chooses the format.

Everywhere f[i, j] = f(x1_i, x2_j), of volumes f[i, j, k]. A file that people look at (PNG, TIFF)
shows x1 to the right and x2 upwards; HDF5, NIfTI and NumPy files keep the order of the array.
"""

import gzip
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import h5py
import numpy as np

from ..base.atomic import replacing
from ..base.checks import Numbers, real_array
from ..base.messages import name_of, require_file
from ..base.option_values import IMAGE_SUFFIXES, WITH_ERRORS
from ..base.optional_packages import optional
from ..base.units import millimetres
from ..geometry import ImageGrid, VolumeGrid
from .hdf5 import creating_hdf5
from .limits import Allowance, refusing
from .provenance import as_json, provenance_of
from .reader import read_file

FORMAT, VERSION = "jaxtat image", 2


@runtime_checkable
class HasInside(Protocol):
    """A region of images or volumes."""

    def contains(self, points: Any) -> Any:
        """Whether each point, (..., 2 or 3), lies inside."""
        ...


class _Output(NamedTuple):
    """What a writer writes: all of it checked."""

    values: np.ndarray  # (x1, x2) or (frames, x1, x2), with x3 of volumes; of a stack a memory map
    inside: np.ndarray  # (x1, x2) or (x1, x2, x3)
    grid: ImageGrid | VolumeGrid
    frames: np.ndarray | None  # (frames,) of a stack
    unit: str | None
    errors: tuple[np.ndarray, ImageGrid] | None  # (x1, x2) or (frames, x1, x2), and their grid
    settings: str  # JSON
    provenance: str  # JSON

    @property
    def image(self) -> np.ndarray:
        """All values, zero outside the region."""
        return np.where(self.inside, self.values, 0.0)

    @property
    def text(self) -> str:
        """Settings and provenance for formats that have room for a comment."""
        return f'{{"settings": {self.settings}, "provenance": {self.provenance}}}'


def save_image(
    path: str | Path,
    image: Numbers,
    grid: ImageGrid | VolumeGrid,
    region: HasInside | None = None,
    settings: dict[str, Any] | None = None,
    *,
    frames: Numbers | None = None,
    errors: tuple[Numbers, ImageGrid] | None = None,
    unit: str | None = None,
    inputs: Sequence[str | Path] = (),
) -> None:
    """Write an image, a volume or a stack; outside a region it is blank (PNG) or zero.

    - ``.png``: a picture with axes, colour bar and, if the unit is known, a scale bar in
      millimetres; of a stack, up to 16 images evenly chosen; of a volume, the three slices that
      hold most and the largest values in three directions, of up to four frames;
    - ``.npy``: the bare array;
    - ``.h5``, ``.hdf5``: image, coordinates, whether each pixel is inside the region, frames, how
      far the image may be off (``errors``, with ``errors_x1`` and ``errors_x2``), all settings
      (`load_settings` gives them back) and provenance: date, versions, input files;
    - ``.nii``, ``.nii.gz``: NIfTI in float64, first axis x1, second x2, third x3 or of length 1,
      fourth the frames; the affine gives positions in mm. There is no anatomical orientation in it;
    - ``.tif``, ``.tiff``: ImageJ's, float32, rows from the top (largest x2) downwards, columns
      along x1, of volumes slices along x3, pixel size in mm.

    NIfTI, TIFF and PNG files carry settings and provenance as text (JSON) too.

    Args:
        path: the file.
        image: (x1, x2) or (frames, x1, x2), of a `VolumeGrid` with a last axis x3.
        grid: its pixels.
        region: where it means something; by default everywhere.
        settings: names and values with which the image was made, whatever JSON can hold; by default
            none.
        frames: a number for every image of a stack, such as time or wavelength, (frames,); by
            default 0, 1, 2...
        errors: standard deviations of the image, (x1, x2) or (frames, x1, x2), NaN where there is
            none, and their grid; for ``.h5`` alone.
        unit: of length in grid and region: "m", "cm", "mm" or "um"; None if it is not known.
        inputs: files from which the image was made; their names and SHA-256 are stored.

    Raises:
        FileNotFoundError: for an input file that does not exist.
        ValueError: for another suffix, a folder that does not exist, an image whose shape is not
            the grid's, an unknown unit, settings that cannot be stored, or a format whose package
            is not installed.

    >>> import tempfile
    >>> from jaxtat import disk
    >>> path, grid = Path(tempfile.mkdtemp()) / "f.h5", ImageGrid(5)
    >>> save_image(path, np.ones((5, 5)), grid, disk(1.0, n_boundary=16), {"alpha": 1e-3})
    >>> load_settings(path)
    {'alpha': 0.001}
    >>> save_image(path, np.ones((5, 5)), grid)
    """
    suffix = require_suffix(path)
    if errors is not None and suffix not in WITH_ERRORS:
        raise ValueError(f"cannot write {path}: files ending in .h5 alone hold errors of an image.")
    millimetres(unit)
    d = len(grid.shape)
    values = _checked(image, d)
    if values.shape[-d:] != grid.shape or values.ndim not in (d, d + 1) or values.size == 0:
        raise ValueError(
            f"the image has shape {values.shape}, its grid has {grid.shape}: expected that, or a "
            "stack with one more axis in front."
        )
    everywhere = np.ones(grid.shape, bool)
    inside = everywhere if region is None else np.asarray(region.contains(grid.points))
    output = _Output(
        values=values,
        inside=inside,
        grid=grid,
        frames=_frames(frames, values.shape[:-d]),
        unit=unit,
        errors=None if errors is None else _errors(*errors, values.shape[:-d]),
        settings=as_json("settings", settings or {}),
        provenance=as_json("provenance", provenance_of(inputs, unit)),
    )
    with replacing(path) as temporary:
        _FORMATS[suffix][0](temporary, output)


def _checked(image: Numbers, n_axes: int) -> np.ndarray:
    """The image as float64; a stack may be larger than the memory, and is looked at in parts."""
    if not (isinstance(image, np.ndarray) and image.dtype == float and image.ndim == n_axes + 1):
        return np.asarray(real_array("image", image, None))
    if not np.ma.isMaskedArray(image) and all(np.isfinite(one).all() for one in image):
        return image
    return np.asarray(real_array("image", image, None))


def _errors(
    deviation: Numbers, grid: ImageGrid, stack: tuple[int, ...]
) -> tuple[np.ndarray, ImageGrid]:
    """Standard deviations of an image or stack, checked; NaN is what is not known."""
    values = np.asarray(deviation, float)
    real_array("errors", np.nan_to_num(values), (*stack, *grid.shape))
    return values, grid


def require_suffix(path: str | Path) -> str:
    """The suffix of an image file, or ValueError: asked before hours of work, not after.

    >>> require_suffix("scan.nii.gz")
    '.nii.gz'
    """
    name = Path(path).name
    for suffix, (_, package) in _FORMATS.items():
        if name.endswith(suffix) and name != suffix:
            if package is not None:
                optional(package, f"writing {suffix} files")
            return suffix
    raise ValueError(f"cannot write {path}: expected a name ending in {', '.join(_FORMATS)}.")


def require_no_record(path: Path) -> None:
    """Raise ValueError for an HDF5 file that is there and may be somebody's record."""
    if path.suffix not in (".h5", ".hdf5") or not path.is_file():
        return
    try:
        load_settings(path)
    except ValueError as error:
        raise ValueError(
            f"cannot write {name_of(path)}: it is there, and no image that this jaxtat reads: "
            f"expected a new name. {error}"
        ) from error


def load_settings(path: str | Path) -> dict[str, Any]:
    """The settings with which an HDF5 image was made, as `save_image` was given them.

    Tuples and arrays come back as lists, paths as text; numbers to the last bit.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file that is damaged, of another kind, or of a later version.
    """
    path = Path(path)
    require_file(path)
    with refusing(f"cannot read {name_of(path)}: "):
        return _settings_of(read_parts(path)[0])


def read_parts(path: Path, *names: str) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Settings, provenance and marks of an HDF5 image, and those of its arrays that are wanted."""
    content = read_file(
        "arrays",
        path,
        Allowance(),
        texts=["settings", "provenance"],
        names=names,
        attributes=["format", "version", "settings_sha256"],
    )
    return content.about, content.arrays


def _settings_of(about: Mapping[str, Any]) -> dict[str, Any]:
    if (about["format"], about["version"]) != (FORMAT, str(VERSION)):
        raise ValueError(
            f"it is of format {about['format']!r:.40}, version {about['version']!s:.20}, expected "
            f"{FORMAT!r}, version {VERSION}: settings are in .h5 images written by save_image."
        )
    text = about["settings"] or ""
    if _digest(text) != about["settings_sha256"]:
        raise ValueError("its settings are damaged (their digest does not match).")
    settings = json.loads(text)
    if not isinstance(settings, dict):
        raise ValueError(f"its settings are {text:.40}, expected names and values.")
    return settings


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _frames(frames: Numbers | None, shape: tuple[int, ...]) -> np.ndarray | None:
    if not shape:
        if frames is not None:
            raise ValueError("frames are given, but the image is a single one, no stack.")
        return None
    if frames is None:
        return np.arange(shape[0], dtype=float)
    return np.asarray(real_array("frames", frames, shape))


def _write_png(path: Path, output: _Output) -> None:
    from ..plotting import save_picture, save_volume  # matplotlib is slow to import

    blank = np.where(output.inside, output.image, np.nan)
    comment = {"Description": output.text}
    if isinstance(output.grid, VolumeGrid):
        save_volume(path, blank, output.grid, output.frames, unit=output.unit, metadata=comment)
    else:
        save_picture(path, blank, output.grid, output.frames, unit=output.unit, metadata=comment)


def _write_npy(path: Path, output: _Output) -> None:
    np.save(path, output.image)


def _write_hdf5(path: Path, output: _Output) -> None:
    with creating_hdf5(path) as file:
        # texts of fixed length: those of variable length are kept in a heap, in which one wrong bit
        # can lead the library round in circles
        marks = {"format": FORMAT, "version": VERSION, "settings_sha256": _digest(output.settings)}
        file.attrs.update({name: np.bytes_(str(mark)) for name, mark in marks.items()})
        for name in ("settings", "provenance"):
            text = getattr(output, name).encode()
            file.create_dataset(name, data=text, dtype=h5py.string_dtype("utf-8", len(text)))
        # readers of HDF5 check these sums: a damaged image is an error, not another image
        image = _hdf5_images(file, output)
        file.create_dataset("inside", data=output.inside, fletcher32=True)
        nodes = {f"x{k + 1}": output.grid.axis(k) for k in range(len(output.grid.shape))}
        axes = nodes
        if output.frames is not None:
            axes = {"frames": output.frames, **nodes}
        for axis, (name, values) in enumerate(axes.items()):
            file[name] = np.asarray(values)
            file[name].make_scale(name)  # pyright: ignore[reportAttributeAccessIssue]
            image.dims[axis].attach_scale(file[name])
            image.dims[axis].label = name
        if output.errors is not None:
            values, coarse = output.errors
            file.create_dataset("errors", data=values, fletcher32=True)
            nodes |= {f"errors_x{k + 1}": coarse.axis(k) for k in range(2)}
            file.update({name: nodes[name] for name in nodes if name not in file})
        for name in nodes:
            file[name].attrs["unit"] = output.unit or "unknown"


def _hdf5_images(file: h5py.File, output: _Output) -> h5py.Dataset:
    """The dataset of the image; of a stack written one by one, and read so by others."""
    values, dtype = output.values, output.values.dtype
    if output.frames is None:
        return file.create_dataset("image", data=output.image, fletcher32=True)
    chunks = (1, *values.shape[1:]) if len(output.grid.shape) == 2 else True
    images = file.create_dataset("image", values.shape, dtype, chunks=chunks, fletcher32=True)
    for number, one in enumerate(values):
        images[number] = np.where(output.inside, one, 0.0)
    return images


def _write_nifti(path: Path, output: _Output) -> None:
    # the suffix of a temporary name ends in .gz alone, so compression is done here
    data = _nifti(output).to_bytes()
    path.write_bytes(gzip.compress(data, mtime=0) if path.suffix == ".gz" else data)


def _nifti(output: _Output) -> Any:
    nifti1 = optional("nibabel", "writing NIfTI files").nifti1
    stack = output.image if output.frames is not None else output.image[None]
    if max(stack.shape) > np.iinfo(np.int16).max:
        raise ValueError(f"NIfTI files hold at most 32767 pixels or frames, here {stack.shape}.")
    data, d = np.moveaxis(stack, 0, -1), len(output.grid.shape)
    data = data if d == 3 else data[:, :, None, :]
    scale = millimetres(output.unit)
    affine = np.eye(4)
    affine[range(d), range(d)] = scale * np.asarray(output.grid.spacing)
    affine[:d, 3] = [scale * float(output.grid.axis(k)[0]) for k in range(d)]
    nifti = nifti1.Nifti1Image(data if output.frames is not None else data[..., 0], affine)
    nifti.header.set_xyzt_units("unknown" if output.unit is None else "mm")
    nifti.header["descrip"] = "i along x1, j along x2, k along x3; no anatomical orientation"
    if output.frames is not None and len(output.frames) > 1:
        steps = np.diff(output.frames)
        if np.allclose(steps, steps[0]) and steps[0] > 0:
            nifti.header["pixdim"][4], nifti.header["toffset"] = steps[0], output.frames[0]
    nifti.header.extensions.append(nifti1.Nifti1Extension("comment", output.text.encode()))
    return nifti


def _write_tiff(path: Path, output: _Output) -> None:
    tifffile = optional("tifffile", "writing TIFF files")
    step = millimetres(output.unit) * np.asarray(output.grid.spacing)
    description: dict[str, Any] = {"axes": "YX", "Info": output.text}
    if output.unit is not None:
        description["unit"] = "mm"
    image = output.image
    if len(step) == 3:
        image = np.moveaxis(image, -1, -3)
        description |= {"axes": "ZYX", "spacing": float(step[2])}
    if output.frames is not None:
        n = 1 if len(step) == 2 else len(output.grid.axis(2))  # a label for every slice
        labels = [f"{frame:g}" for frame in np.repeat(output.frames, n)]
        description |= {"axes": f"T{description['axes']}", "Labels": labels}
    rows = np.swapaxes(image, -1, -2)[..., ::-1, :].astype(np.float32)
    pixels = (1 / step[0], 1 / step[1])  # per millimetre, along x1 and x2
    tifffile.imwrite(path, rows, imagej=True, resolution=pixels, metadata=description)


_PNG, _NPY, _HDF5 = (_write_png, None), (_write_npy, None), (_write_hdf5, None)
_NIFTI, _TIFF = (_write_nifti, "nibabel"), (_write_tiff, "tifffile")
# suffix: who writes it, and the package of the extra `io` that is needed for it
_FORMATS = dict(
    zip(IMAGE_SUFFIXES, (_PNG, _NPY, _HDF5, _HDF5, _NIFTI, _NIFTI, _TIFF, _TIFF), strict=True)
)
