"""Destinations of images: an HDF5 file that can be read meanwhile, or a folder of files."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import h5py
import numpy as np

from ..base.atomic import replacing, require_new
from ..base.messages import name_of
from ..geometry import ImageGrid
from ..io.provenance import as_json

METADATA = 2**16  # [byte] of HDF5's own for one image, at most


@runtime_checkable
class Sink(Protocol):
    """A destination that receives images one after the other."""

    def write(self, number: int, image: np.ndarray) -> None: ...

    def close(self) -> None: ...


class GrowingFile:
    """An HDF5 file with ``image`` (images, x1, x2) and ``frames``, their numbers in the stream.

    It is whole after every image, and can be opened meanwhile: ``h5py.File(path)`` has all images
    until then. Only in the moment of writing one it may be refused; open it again. The oldest
    format of HDF5 has no mark for files that are being written, which those of a killed program
    would keep.

    HDF5 does not recover from a disk that is full. So there is room before it writes: zeros behind
    the end of its data, which are overwritten next.

    Args:
        path: of a new file.
        grid: of the images.
        settings: kept as an attribute.

    Raises:
        ValueError: if there is a file of that name.
        OSError: without room on the disk.
    """

    def __init__(self, path: Path, grid: ImageGrid, settings: dict[str, Any]):
        require_new(path)
        shape, self._path = grid.shape, path
        self._room = 4 * math.prod(shape) + METADATA
        path.touch(exist_ok=False)
        self._reserve(0)
        self._file = h5py.File(path, "w", libver="earliest", locking=False)
        for name, axis in (("x1", grid.x1), ("x2", grid.x2)):
            self._file[name] = np.asarray(axis)
        self._file.attrs["settings"] = as_json("settings", settings)
        self._images = self._file.create_dataset(
            "image", (0, *shape), "f4", maxshape=(None, *shape), chunks=(1, *shape)
        )
        self._frames = self._file.create_dataset(
            "frames", (0,), "i8", maxshape=(None,), chunks=(512,)
        )
        self._file.flush()

    def write(self, number: int, image: np.ndarray) -> None:
        self._reserve(self._file.id.get_filesize())
        n = len(self._frames)
        self._images.resize(n + 1, axis=0)
        self._images[n] = image
        self._frames.resize(n + 1, axis=0)
        self._frames[n] = number
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def _reserve(self, end: int) -> None:
        """Fill the file with zeros behind its data, so that there is room for one image."""
        try:
            with self._path.open("r+b") as file:
                file.seek(end)
                file.write(bytes(self._room))
        except OSError as error:
            reason = f"cannot write {name_of(self._path)}: {error.strerror}"
            raise OSError(error.errno, reason) from error


class Folder:
    """A folder with a file for each image, 00000000.npy or .png by the frames' numbers."""

    def __init__(self, path: Path, save: Callable[[Path, np.ndarray], None], suffix: str):
        path.mkdir(exist_ok=True)
        self._path, self._save, self._suffix = path, save, suffix

    def write(self, number: int, image: np.ndarray) -> None:
        with replacing(self._path / f"{number:08d}{self._suffix}") as temporary:
            self._save(temporary, image)

    def close(self) -> None:
        pass
