"""Sources of frames and destinations of images for `jaxtat stream`."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..base.option_values import STREAM_SUFFIXES
from ..geometry import ImageGrid
from ..io import save_image
from ..reconstruction import Setup
from ..scans import Choices
from ..streams import Folder, GrowingFile, Sink, frames_of_bytes, frames_of_folder


def frames_from(
    source: str, shape: tuple[int, int], dtype: np.dtype, follow: bool
) -> Iterator[Any]:
    """Raw frames of a pipe, file or folder."""
    path = Path(source)
    if source == "-":
        return frames_of_bytes(sys.stdin.buffer, shape, dtype, lambda: False)
    if path.is_dir():
        return frames_of_folder(path, shape, lambda: follow)
    return _of_file(path, shape, dtype, follow)


def _of_file(
    path: Path, shape: tuple[int, int], dtype: np.dtype, follow: bool
) -> Iterator[np.ndarray]:
    with path.open("rb", buffering=0) as file:
        yield from frames_of_bytes(file, shape, dtype, lambda: follow)


def sink_at(out: str, kind: str | None, setup: Setup, choices: Choices) -> Sink:
    """A file that grows, or a folder of .npy files or of another format."""
    path, grid = Path(out), setup.grid
    assert isinstance(grid, ImageGrid)
    if path.suffix in STREAM_SUFFIXES:
        return GrowingFile(path, grid, choices.settings())

    def picture(file: Path, image: np.ndarray) -> None:
        save_image(file, image, grid, setup.region, unit=choices.units.length)

    return Folder(path, picture if kind == "png" else np.save, f".{kind or 'npy'}")
