"""Pictures of volumes: three slices, also in space among the detectors, and largest values."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure

from ..base.checks import Numbers
from ..base.units import OF_VALUES, millimetres
from ..geometry import VolumeGrid
from ..geometry.caps import Detectors
from .canvas import (
    GRAY,
    beyond,
    gray_levels,
    label_axes,
    length_label,
    new_figure,
    text_size,
)
from .images import add_scale_bar, show_image

MOST_ROWS = 4  # frames of a stack that one picture shows
_NAMES = ("$x_1$", "$x_2$", "$x_3$")


def show_slices(
    figure: Figure | SubFigure,
    volume: Numbers,
    grid: VolumeGrid,
    *,
    at: tuple[float, float, float] | None = None,
    limits: tuple[float, float] | None = None,
    cmap: str = GRAY,
    title: str = "",
    unit: str | None = None,
) -> None:
    """The slices x_1 = a, x_2 = b and x_3 = c side by side, one scale for all.

    Args:
        figure: where to draw, three pictures in a row.
        volume: (x1, x2, x3).
        grid: its nodes.
        at: (a, b, c), the nearest nodes are shown; by default the centre of the grid [length].
        limits: values shown as darkest and brightest; by default those of the volume.
        cmap: matplotlib's name of a colour map.
        title: above all three.
        unit: of length of the grid, "m", "cm", "mm" or "um"; axes are in millimetres then, and each
            picture has a scale bar.

    Raises:
        ValueError: for another shape than the grid's, and without limits where all is NaN.
    """
    values, limits = _checked(volume, grid, limits)
    pictures, labels = [], []
    for axis, index in enumerate(_nearest(grid, at)):
        pictures.append(np.take(values, index, axis=axis))
        height = float(grid.axis(axis)[index])
        height = 0.0 if abs(height) < 1e-3 * float(grid.spacing[axis]) else height
        place = f"{millimetres(unit) * height:.3g}{' mm' if unit else ''}"
        labels.append(f"{_NAMES[axis]} = {place}")
    _show_three(figure, pictures, labels, grid, limits, cmap, title, unit)


def show_projections(
    figure: Figure | SubFigure,
    volume: Numbers,
    grid: VolumeGrid,
    *,
    limits: tuple[float, float] | None = None,
    cmap: str = GRAY,
    title: str = "",
    unit: str | None = None,
) -> None:
    """The largest values along x_1, x_2 and x_3 side by side, one scale for all.

    Args:
        figure, grid, limits, cmap, title, unit: as in `show_slices`.
        volume: (x1, x2, x3); NaN is left out, and blank where there is nothing else.

    Raises:
        ValueError: as `show_slices`.
    """
    values, limits = _checked(volume, grid, limits)
    pictures = [np.fmax.reduce(values, axis=axis) for axis in range(3)]
    labels = [f"largest along {name}" for name in _NAMES]
    _show_three(figure, pictures, labels, grid, limits, cmap, title, unit)


def _show_three(
    figure: Figure | SubFigure,
    pictures: list[np.ndarray],
    labels: list[str],
    grid: VolumeGrid,
    limits: tuple[float, float],
    cmap: str,
    title: str,
    unit: str | None,
) -> None:
    """Pictures across x_1, x_2 and x_3, with a colour bar beside the last."""
    for axis, axes in enumerate(np.ravel(figure.subplots(1, 3))):
        i, j = (k for k in range(3) if k != axis)
        shown = show_image(
            axes, pictures[axis], grid.across(axis), limits=limits, cmap=cmap, unit=unit
        )
        if unit is not None:
            add_scale_bar(axes)
        label_axes(axes, labels[axis], *(length_label(_NAMES[k], unit) for k in (i, j)))
        if axis == 2:
            ends: Any = beyond(np.concatenate([np.ravel(each) for each in pictures]), limits)
            figure.colorbar(shown, ax=axes, shrink=0.8, label=OF_VALUES, extend=ends)
    if title:
        figure.suptitle(title, fontsize=text_size(10))


def show_space(
    figure: Figure | SubFigure,
    volume: Numbers,
    grid: VolumeGrid,
    detectors: Detectors | None = None,
    *,
    at: tuple[float, float, float] | None = None,
    limits: tuple[float, float] | None = None,
    cmap: str = GRAY,
    most: int = 65,
) -> None:
    """The three slices where they are in space, and the detectors as dots.

    Args:
        figure, volume, grid, at, limits, cmap: as in `show_slices`.
        detectors: drawn thinned out, none by default.
        most: nodes drawn along each axis; more are thinned out.

    Raises:
        ValueError: as `show_slices`.
    """
    values, (low, high) = _checked(volume, grid, limits)
    axes = figure.add_subplot(projection="3d")
    steps = [slice(None, None, -(-size // most)) for size in grid.shape]
    lines = [np.asarray(grid.axis(axis))[steps[axis]] for axis in range(3)]
    for axis, index in enumerate(_nearest(grid, at)):
        i, j = (k for k in range(3) if k != axis)
        part = np.take(values, index, axis=axis)[steps[i], steps[j]]
        first, second = np.meshgrid(lines[i], lines[j], indexing="ij")
        corners = {axis: np.full(part.shape, float(grid.axis(axis)[index])), i: first, j: second}
        colors = colormaps[cmap](Normalize(low, high)(part))
        axes.plot_surface(
            corners[0], corners[1], corners[2], facecolors=colors, rstride=1, cstride=1, shade=False
        )  # pyright: ignore[reportAttributeAccessIssue]
    if detectors is not None:
        dots = np.asarray(detectors.points).reshape(-1, 3)
        axes.plot(*dots[:: -(-len(dots) // 1500)].T, ".", color="tab:blue", ms=1.5)
    axes.set_box_aspect((1, 1, 1))  # pyright: ignore[reportArgumentType]
    for name, label in zip("xyz", _NAMES, strict=True):
        getattr(axes, f"set_{name}label")(label, fontsize=text_size(8))
    axes.tick_params(labelsize=text_size(7))


def save_volume(
    path: str | Path,
    volume: Numbers,
    grid: VolumeGrid,
    frames: Numbers | None = None,
    *,
    unit: str | None = None,
    metadata: dict[str, str] | None = None,
) -> None:
    """`show_slices` where most is, above `show_projections`, of up to four frames, as a PNG.

    Args:
        path: the file.
        volume: (x1, x2, x3) or (frames, x1, x2, x3); NaN stays blank.
        grid: its nodes.
        frames: a number above the slices of each, (frames,).
        unit: as in `show_slices`.
        metadata: texts in the file.
    """
    stack = np.asarray(volume).reshape(-1, *grid.shape)
    chosen = np.unique(np.linspace(0, len(stack) - 1, MOST_ROWS).round().astype(int))
    figure = new_figure(9.6, 6.8 * len(chosen))
    # the brightest voxels are few, and all that projections show
    brightest = [np.fmax.reduce(stack[chosen], axis=axis).ravel() for axis in (1, 2, 3)]
    limits = gray_levels(stack[chosen])[0], gray_levels(np.concatenate(brightest))[1]
    at = _where_most_is(stack[chosen], grid)
    rows = figure.subfigures(2 * len(chosen), 1, squeeze=False)[:, 0]
    for k, slices, projections in zip(chosen, rows[::2], rows[1::2], strict=True):
        title = "" if frames is None else f"{np.asarray(frames)[k]:g}"
        show_slices(slices, stack[k], grid, at=at, limits=limits, title=title, unit=unit)
        show_projections(projections, stack[k], grid, limits=limits, unit=unit)
    figure.savefig(path, dpi=150, metadata=metadata)


def _checked(
    volume: Numbers, grid: VolumeGrid, limits: tuple[float, float] | None
) -> tuple[np.ndarray, tuple[float, float]]:
    """Values on the grid, and what is shown as darkest and brightest."""
    values = np.asarray(volume)
    if values.shape != grid.shape:
        raise ValueError(
            f"volume has shape {values.shape}, expected that of the grid, {grid.shape}: pass one "
            "volume, and the grid of its voxels."
        )
    if limits is None:
        finite = values[np.isfinite(values)]
        if finite.size == 0:
            raise ValueError("volume holds no finite value, expected some, or limits to show.")
        limits = float(finite.min()), float(finite.max())
    return values, limits


def _nearest(grid: VolumeGrid, at: tuple[float, float, float] | None) -> list[int]:
    point = np.asarray(grid.center) if at is None else np.asarray(at)
    return [int(np.abs(np.asarray(grid.axis(k)) - point[k]).argmin()) for k in range(3)]


def _where_most_is(stack: np.ndarray, grid: VolumeGrid) -> tuple[float, float, float]:
    """Across each axis where the sum of squares of a slice is largest [length]."""
    power = np.sum(np.nan_to_num(stack) ** 2, axis=0)
    sums = (np.sum(power, axis=tuple(j for j in range(3) if j != axis)) for axis in range(3))
    first, second, third = (float(grid.axis(k)[int(np.argmax(s))]) for k, s in enumerate(sums))
    return first, second, third
