"""Pictures of the page: an image with axes, values under the cursor, and its grey levels."""

from typing import Any, NamedTuple

import numpy as np
from bokeh.models import (
    BoxZoomTool,
    ColorBar,
    ColumnDataSource,
    CrosshairTool,
    HoverTool,
    LinearColorMapper,
    Range1d,
    Title,
)
from bokeh.plotting import figure

from ..geometry import ImageGrid
from .grey_levels import GreyLevels
from .session import Session
from .zoom_controls import lengths


class ImageFigure(NamedTuple):
    """A figure of one image, its title, and what Bokeh draws it of."""

    figure: Any
    title: Title
    pixels: ColumnDataSource
    glyph: Any

    def draw(self, image: np.ndarray) -> None:
        """Show an image (first axis to the right, second upwards)."""
        self.pixels.data = {"image": [np.ascontiguousarray(image.T, np.float32)]}


class Picture:
    """Shows images; its own controls change how, and nothing is computed for them.

    Args:
        session: whose unit the axes have, and whose region they show at first.

    Attributes:
        figure: of Bokeh.
        title: above it, what is shown.
        settings: with which it was made, in words.
        image: that is shown, (x1, x2); None before the first.
        colours, levels, controls: of its `GreyLevels`.
    """

    def __init__(self, session: Session):
        self.image: np.ndarray | None = None
        self.settings = ""
        self._grid = session.grid(session.start)
        self._scale, unit = lengths(session)
        self._grey = GreyLevels()
        self.colours, self.levels = self._grey.colours, self._grey.levels
        self.controls = self._grey.controls
        names = "x₁", "x₂"
        made = image_figure(540, self._grid, names, self._scale, unit, self.colours)
        self._made, self.figure, self.title = made, made.figure, made.title
        self.figure.add_layout(ColorBar(color_mapper=self.colours, width=14), "right")

    @property
    def place(self) -> dict[str, Any]:
        """Where the image is, by the names that Bokeh has."""
        return _as_place(*_corner_and_size(self._grid, self._scale))

    def show(self, image: np.ndarray, grid: ImageGrid, title: str, settings: str = "") -> None:
        """An image (x1, x2) with its pixels, what it is, and what it was made with.

        Axes that were zoomed stay so while the pixels do.
        """
        if not all(map(np.array_equal, _numbers(grid), _numbers(self._grid))):
            self._grid = grid
            low, size = _corner_and_size(grid, self._scale)
            self._made.glyph.glyph.update(**self.place)
            self.figure.x_range.update(start=low[0], end=low[0] + size[0])
            self.figure.y_range.update(start=low[1], end=low[1] + size[1])
        self.image, self.title.text, self.settings = image, title, settings
        self._made.draw(image)
        self._grey.take(image)


def image_figure(
    size: int,
    grid: ImageGrid,
    names: tuple[str, str],
    scale: float,
    unit: str,
    colours: LinearColorMapper,
) -> ImageFigure:
    """A figure with axes, and values under the cursor.

    Args:
        size: of its sides [pixel].
        grid: that it shows at first.
        names: of the coordinates.
        scale, unit: of `lengths`.
        colours: from values to grey levels.
    """
    low, extent = _corner_and_size(grid, scale)
    made = figure(
        frame_width=size,
        frame_height=size,
        x_range=Range1d(start=low[0], end=low[0] + extent[0]),
        y_range=Range1d(start=low[1], end=low[1] + extent[1]),
        tools="pan,wheel_zoom,reset",
        active_scroll="wheel_zoom",
        x_axis_label=f"{names[0]}{unit}",
        y_axis_label=f"{names[1]}{unit}",
    )
    made.toolbar.logo = None
    title = Title(text="", text_font_style="normal")
    made.add_layout(title, "above")
    made.grid.visible = False
    pixels = ColumnDataSource({"image": [np.zeros((1, 1), np.float32)]})
    glyph = made.image(
        "image",
        source=pixels,
        color_mapper=colours,  # pyright: ignore[reportCallIssue]
        **_as_place(low, extent),
    )
    values = [(", ".join(names), "$x{0.00}, $y{0.00}" + unit), ("f", "@image{%.4g}")]
    hover = HoverTool(tooltips=values, formatters={"@image": "printf"}, point_policy="none")
    made.add_tools(BoxZoomTool(match_aspect=True), hover, CrosshairTool(line_alpha=0.3))
    return ImageFigure(made, title, pixels, glyph)


def _corner_and_size(grid: ImageGrid, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Lower left corner and size of an image, in the unit of the axes."""
    axes, step = (np.asarray(grid.x1), np.asarray(grid.x2)), np.asarray(grid.spacing)
    low, high = (np.array([axis[k] for axis in axes]) for k in (0, -1))
    return scale * (low - step / 2), scale * (high - low + step)


def _as_place(low: np.ndarray, size: np.ndarray) -> dict[str, Any]:
    return dict(zip(("x", "y", "dw", "dh"), map(float, (*low, *size)), strict=True))


def _numbers(grid: ImageGrid) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(grid.half_width), np.asarray(grid.center)
