"""Pictures of images on a grid: x_1 to the right, x_2 upwards, one scale for both."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from .checks import Numbers
from .geometry import DetectorCurve, ImageGrid, Region

GRAY, DIVERGING = "gray", "RdBu_r"


def new_figure(width: float, height: float) -> Figure:
    """A figure of the given size [inch] that needs no screen."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def show_image(
    axes: Axes,
    image: Numbers,
    grid: ImageGrid,
    *,
    limits: tuple[float, float] | None = None,
    cmap: str = GRAY,
    title: str = "",
) -> ScalarMappable:
    """Draw f[x1, x2] with its axes in units of length; NaN stays blank.

    Args:
        axes: where to draw.
        image: (x1, x2).
        grid: its nodes.
        limits: values shown as darkest and brightest; by default those of the image.
        cmap: matplotlib's name of a colour map.
        title: above the picture.

    Returns:
        What a colour bar needs.
    """
    half = np.asarray(grid.spacing) / 2
    low = np.asarray(grid.points[0, 0]) - half
    high = np.asarray(grid.points[-1, -1]) + half
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
    axes.set_title(title, fontsize=9)
    axes.set_xlabel("$x_1$", fontsize=8)
    axes.set_ylabel("$x_2$", fontsize=8)
    axes.tick_params(labelsize=7)
    return mappable


def show_geometry(axes: Axes, curve: DetectorCurve, region: Region) -> None:
    """Draw the detectors (dots) and the boundary of the region of interest (line)."""
    boundary = np.asarray(region.points)
    order = np.argsort(np.arctan2(*(boundary - boundary.mean(axis=0)).T[::-1]))
    outline = boundary[np.append(order, order[0])]
    axes.plot(*outline.T, "-", color="tab:orange", lw=1, label="region of interest")
    axes.plot(*np.asarray(curve.points).T, ".", color="tab:blue", ms=1.5, label="detectors")
    axes.set_aspect("equal")
    axes.autoscale()  # an image drawn before has fixed the limits to itself


def save_picture(path: str | Path, image: Numbers, grid: ImageGrid) -> None:
    """One image with axes and a colour bar as a PNG file.

    The scale runs between the 0.2th and 99.8th percentile, so that one bright pixel does not
    darken the rest.
    """
    figure = new_figure(6.4, 5.6)
    axes = figure.subplots()
    low, high = (float(v) for v in np.nanpercentile(np.asarray(image), [0.2, 99.8]))
    shown = show_image(axes, image, grid, limits=(low, high))
    figure.colorbar(shown, ax=axes, shrink=0.9)
    figure.savefig(path, dpi=150)
