"""The picture of the page: an image with axes, values under the cursor, and its grey levels."""

from typing import Any

import numpy as np
from bokeh.layouts import row
from bokeh.models import (
    BoxZoomTool,
    ColorBar,
    ColumnDataSource,
    CrosshairTool,
    HoverTool,
    LinearColorMapper,
    Range1d,
    RangeSlider,
    Select,
    Title,
    Toggle,
)
from bokeh.palettes import Greys256, Inferno256, Viridis256
from bokeh.plotting import figure

from ..geometry import ImageGrid
from .session import Session
from .zoom_controls import lengths

COLOURS = {"grey": Greys256, "viridis": Viridis256, "inferno": Inferno256}


class Picture:
    """Shows images; its own controls change how, and nothing is computed for them.

    Args:
        session: whose unit the axes have, and whose region they show at first.

    Attributes:
        figure: of Bokeh.
        title: above it, what is shown.
        settings: with which it was made, in words.
        image: that is shown, (x1, x2); None before the first.
        colours: from values to grey levels.
        levels: slider of the percentiles between which colours are.
        controls: this slider, and those that go with it.
    """

    def __init__(self, session: Session):
        self.image: np.ndarray | None = None
        self.settings = ""
        self._grid = session.grid(session.start)
        self._scale, unit = lengths(session)
        self._pixels = ColumnDataSource({"image": [np.zeros((1, 1), np.float32)]})
        self.colours = LinearColorMapper(COLOURS["grey"], low=0.0, high=1.0, nan_color="#00000000")
        self._make_figure(unit)
        self.levels = RangeSlider(
            title="darkest and brightest [percentile]",
            start=0,
            end=100,
            value=(0.2, 99.8),
            step=0.1,
        )
        self._hold = Toggle(label="hold levels")
        self._palette = Select(options=list(COLOURS), value="grey", width=110)
        self.controls = self.levels, row(self._hold, self._palette)
        self.levels.on_change("value", lambda attr, old, new: self._take_levels())
        self._hold.on_change("active", lambda attr, old, new: self._take_levels())
        self._palette.on_change("value", lambda attr, old, new: self._take_palette())

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
            self._glyph.glyph.update(**self.place)
            self.figure.x_range.update(start=low[0], end=low[0] + size[0])
            self.figure.y_range.update(start=low[1], end=low[1] + size[1])
        self.image, self.title.text, self.settings = image, title, settings
        self._pixels.data = {"image": [np.ascontiguousarray(image.T, np.float32)]}
        self._take_levels()

    def _make_figure(self, unit: str) -> None:
        low, size = _corner_and_size(self._grid, self._scale)
        self.figure = figure(
            frame_width=540,
            frame_height=540,
            x_range=Range1d(start=low[0], end=low[0] + size[0]),
            y_range=Range1d(start=low[1], end=low[1] + size[1]),
            tools="pan,wheel_zoom,reset",
            active_scroll="wheel_zoom",
            x_axis_label=f"x₁{unit}",
            y_axis_label=f"x₂{unit}",
        )
        self.figure.toolbar.logo = None
        self.title = Title(text="", text_font_style="normal")
        self.figure.add_layout(self.title, "above")
        self.figure.grid.visible = False
        self._glyph = self.figure.image(
            "image",
            source=self._pixels,
            color_mapper=self.colours,  # pyright: ignore[reportCallIssue]
            **self.place,
        )
        values = [("x₁, x₂", "$x{0.00}, $y{0.00}" + unit), ("f", "@image{%.4g}")]
        hover = HoverTool(tooltips=values, formatters={"@image": "printf"}, point_policy="none")
        zoom = BoxZoomTool(match_aspect=True)
        self.figure.add_tools(zoom, hover, CrosshairTool(line_alpha=0.3))
        self.figure.add_layout(ColorBar(color_mapper=self.colours, width=14), "right")

    def _take_levels(self) -> None:
        if self.image is None or self._hold.active:
            return
        low, high = np.nanpercentile(self.image, self.levels.value)
        self.colours.update(low=float(low), high=float(high) if high > low else float(low) + 1.0)

    def _take_palette(self) -> None:
        self.colours.palette = COLOURS[self._palette.value]


def _corner_and_size(grid: ImageGrid, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Lower left corner and size of an image, in the unit of the axes."""
    axes, step = (np.asarray(grid.x1), np.asarray(grid.x2)), np.asarray(grid.spacing)
    low, high = (np.array([axis[k] for axis in axes]) for k in (0, -1))
    return scale * (low - step / 2), scale * (high - low + step)


def _as_place(low: np.ndarray, size: np.ndarray) -> dict[str, Any]:
    return dict(zip(("x", "y", "dw", "dh"), map(float, (*low, *size)), strict=True))


def _numbers(grid: ImageGrid) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(grid.half_width), np.asarray(grid.center)
