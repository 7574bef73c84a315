"""Pictures of images on a grid: x_1 to the right, x_2 upwards, one scale for both."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from ..base.checks import Numbers
from ..base.units import OF_VALUES, millimetres
from ..geometry import ImageGrid
from .canvas import GRAY, beyond, gray_levels, label_axes, length_label, new_figure, text_size

MOST_PANELS = 16  # images of a stack that one picture shows


def show_image(
    axes: Axes,
    image: Numbers,
    grid: ImageGrid,
    *,
    limits: tuple[float, float] | None = None,
    cmap: str = GRAY,
    title: str = "",
    unit: str | None = None,
) -> ScalarMappable:
    """Draw f[x1, x2] with its axes in units of length, or mm; NaN stays blank.

    Args:
        axes: where to draw.
        image: (x1, x2).
        grid: its nodes.
        limits: values shown as darkest and brightest; by default those of the image.
        cmap: matplotlib's name of a colour map.
        title: above the picture.
        unit: of length of the grid, "m", "cm", "mm" or "um"; axes are in millimetres then.

    Returns:
        What a colour bar needs.
    """
    half, scale = np.asarray(grid.spacing) / 2, millimetres(unit)
    low = scale * (np.asarray(grid.points[0, 0]) - half)
    high = scale * (np.asarray(grid.points[-1, -1]) + half)
    vmin, vmax = (None, None) if limits is None else limits
    mappable = axes.imshow(
        np.asarray(image).T,
        origin="lower",
        extent=(low[0], high[0], low[1], high[1]),
        vmin=vmin,
        vmax=vmax,
        cmap=cmap,
        interpolation="nearest",
    )
    label_axes(axes, title, length_label("$x_1$", unit), length_label("$x_2$", unit))
    return mappable


def add_scale_bar(axes: Axes) -> None:
    """A bar of 1, 2 or 5 times a power of ten mm, at most a quarter as long as the axes (in mm)."""
    most = abs(np.subtract(*axes.get_xlim())) / 4
    power = 10.0 ** np.floor(np.log10(most))
    length = power * max(step for step in (1, 2, 5) if step * power <= most)
    bar = AnchoredSizeBar(
        axes.transData,
        length,
        f"{length:g} mm",
        "lower right",
        size_vertical=length / 20,
        pad=0.3,
        fontproperties=FontProperties(size=7),
    )
    bar.patch.set(alpha=0.8, linewidth=0)  # legible on dark tissue and on white alike
    axes.add_artist(bar)


def picture(
    image: Numbers, grid: ImageGrid, frames: Numbers | None = None, *, unit: str | None = None
) -> Figure:
    """One image, or up to 16 of a stack, evenly chosen, with axes and a common colour bar.

    The grey levels are those of `gray_levels`.

    Args:
        image: (x1, x2), or (frames, x1, x2); NaN stays blank.
        grid: its nodes.
        frames: a number above every image of a stack, (frames,).
        unit: of length of the grid; axes are in mm then, and a scale bar is drawn.
    """
    values = np.asarray(image)
    stack = values.reshape(-1, *grid.shape)
    n = min(len(stack), MOST_PANELS)
    chosen = np.unique(np.linspace(0, len(stack) - 1, n).round().astype(int))
    columns = int(np.ceil(np.sqrt(n)))
    rows = -(-n // columns)
    figure = new_figure(6.4, 5.6) if n == 1 else new_figure(2.4 * columns + 0.8, 2.4 * rows)
    panels = figure.subplots(rows, columns, squeeze=False)
    limits = gray_levels(stack[chosen])
    shown = None
    for axes, k in zip(panels.flat, chosen, strict=False):
        title = "" if frames is None else f"{np.asarray(frames)[k]:g}"
        shown = show_image(axes, stack[k], grid, limits=limits, title=title, unit=unit)
        if unit is not None:
            add_scale_bar(axes)
    for axes in panels.flat[n:]:
        axes.remove()
    assert shown is not None
    ends: Any = beyond(stack[chosen], limits)
    shown_in = panels.flat[:n].tolist()
    figure.colorbar(shown, ax=shown_in, shrink=0.9, label=OF_VALUES, extend=ends)
    if n < len(stack):
        figure.suptitle(f"{n} of {len(stack)} images", fontsize=text_size(9))
    return figure


def contact_sheet(
    panels: Sequence[tuple[Numbers, ImageGrid, str]],
    *,
    columns: int | None = None,
    unit: str | None = None,
) -> Figure:
    """Images beside each other, each with its own grey levels and a title.

    Args:
        panels: image (x1, x2), its grid, and its title; NaN stays blank.
        columns: of the sheet; by default it is about square.
        unit: of length of the grids; axes are in mm then.
    """
    across = columns or int(np.ceil(np.sqrt(len(panels))))
    rows = -(-len(panels) // across)
    figure = new_figure(2.2 * across, 2.35 * rows)
    axes = list(figure.subplots(rows, across, squeeze=False).flat)
    for ax, (image, grid, title) in zip(axes, panels, strict=False):
        values = np.asarray(image)
        show_image(ax, values, grid, limits=gray_levels(values), title=title, unit=unit)
    for ax in axes[len(panels) :]:
        ax.remove()
    return figure


def save_picture(
    path: str | Path,
    image: Numbers,
    grid: ImageGrid,
    frames: Numbers | None = None,
    *,
    unit: str | None = None,
    metadata: dict[str, str] | None = None,
) -> None:
    """`picture` as a PNG file, with ``metadata`` as texts in it."""
    picture(image, grid, frames, unit=unit).savefig(path, dpi=150, metadata=metadata)
