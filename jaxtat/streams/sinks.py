"""Destinations of images: an HDF5 file that can be read meanwhile, or a folder of files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import h5py
import numpy as np

from ..base.atomic import replacing
from ..geometry import ImageGrid
from ..io.provenance import as_json


@runtime_checkable
class Sink(Protocol):
    """Takes images one after the other."""

    def write(self, number: int, image: np.ndarray) -> None: ...

    def close(self) -> None: ...


class GrowingFile:
    """An HDF5 file with ``image`` (images, x1, x2) and ``frames``, their numbers in the stream.

    Written in the library's mode for one writer and many readers (SWMR): open it meanwhile with
    ``h5py.File(path, "r", swmr=True)`` and call ``refresh`` of the datasets. So it has its own name
    from the start, and is refused if there is a file of that name.
    """

    def __init__(self, path: Path, grid: ImageGrid, settings: dict[str, Any]):
        if path.exists():
            raise ValueError(f"cannot write {path}: a stream needs a new file.")
        self._file = h5py.File(path, "x", libver="latest")
        shape = grid.shape
        for name, axis in (("x1", grid.x1), ("x2", grid.x2)):
            self._file[name] = np.asarray(axis)
        self._file.attrs["settings"] = as_json("settings", settings)
        self._images = self._file.create_dataset(
            "image", (0, *shape), "f4", maxshape=(None, *shape), chunks=(1, *shape)
        )
        self._frames = self._file.create_dataset(
            "frames", (0,), "i8", maxshape=(None,), chunks=(512,)
        )
        self._file.swmr_mode = True

    def write(self, number: int, image: np.ndarray) -> None:
        n = len(self._frames)
        self._images.resize(n + 1, axis=0)
        self._images[n] = image
        self._images.flush()  # the image before its number: a reader counts numbers
        self._frames.resize(n + 1, axis=0)
        self._frames[n] = number
        self._frames.flush()

    def close(self) -> None:
        self._file.close()


class Folder:
    """Files 00000000.npy or .png, by the frames' numbers, each there when it is whole."""

    def __init__(self, path: Path, save: Callable[[Path, np.ndarray], None], suffix: str):
        path.mkdir(exist_ok=True)
        self._path, self._save, self._suffix = path, save, suffix

    def write(self, number: int, image: np.ndarray) -> None:
        with replacing(self._path / f"{number:08d}{self._suffix}") as temporary:
            self._save(temporary, image)

    def close(self) -> None:
        pass
