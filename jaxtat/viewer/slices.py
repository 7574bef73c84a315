"""Three pictures of a volume side by side: slices at sliders, or the largest values along axes."""

import math

import numpy as np
from bokeh.layouts import column
from bokeh.models import ColorBar, RadioButtonGroup, Slider, Span, Title

from ..base.units import OF_VALUES
from ..geometry import VolumeGrid
from .grey_levels import GreyLevels
from .picture import image_figure

NAMES = ("x₁", "x₂", "x₃")
SLICES, PROJECTIONS = "slices", "maximum projections"
SIZE = 300  # of a picture [pixel]
LINES = "#e67e22"  # where the two other slices are


class Slices:
    """Shows a volume; the browser gets the pictures that change, and not the volume.

    Args:
        grid: the voxels.
        scale, unit: of `lengths`.

    Attributes:
        shown: "slices" or "maximum projections".
        sliders: where the slices across x1, x2, x3 are, by voxels, in the unit of the axes.
        figures: of the slices across x1, x2, x3, of Bokeh.
        columns: each figure with its slider.
        grey: their common grey levels.
        volume: that is shown, (x1, x2, x3); None before the first.
    """

    def __init__(self, grid: VolumeGrid, scale: float, unit: str):
        self.volume: np.ndarray | None = None
        self.grey = GreyLevels()
        self._nodes = [scale * np.asarray(grid.axis(axis)) for axis in range(3)]
        self._unit, step = unit, scale * float(np.min(np.asarray(grid.spacing)))
        self._digits = max(0, 1 - math.floor(math.log10(step)))
        self.shown = RadioButtonGroup(labels=[SLICES, PROJECTIONS], active=0)
        self.sliders = [self._slider(nodes) for nodes in self._nodes]
        self._made = [
            image_figure(
                SIZE, grid.across(axis), _others(NAMES, axis), scale, unit, self.grey.colours
            )
            for axis in range(3)
        ]
        self.figures = [made.figure for made in self._made]
        self.figures[-1].add_layout(ColorBar(color_mapper=self.grey.colours, width=14), "right")
        self.figures[-1].add_layout(Title(text=OF_VALUES, align="center"), "right")
        self.columns = list(map(column, self.figures, self.sliders))
        self._lines = [self._lines_in(axis) for axis in range(3)]
        for axis, slider in enumerate(self.sliders):
            slider.on_change("value", lambda attr, old, new, axis=axis: self._turn(axis))
        self.shown.on_change("active", lambda attr, old, new: self._take_shown())
        for axis in range(3):
            self._turn(axis)

    def show(self, volume: np.ndarray) -> None:
        """Another volume, at the same places; NaN stays blank."""
        self.volume = volume
        for axis in range(3):
            self._draw(axis)
        self.grey.take(volume)

    def voxel(self, axis: int) -> int:
        """Number of the voxel along an axis at which its slice is."""
        return int(np.abs(self._nodes[axis] - self.sliders[axis].value).argmin())

    def _slider(self, nodes: np.ndarray) -> Slider:
        middle, step = float(nodes[len(nodes) // 2]), float(nodes[1] - nodes[0])
        form = f"0.{'0' * self._digits}" if self._digits else "0"
        return Slider(
            start=nodes[0], end=nodes[-1], value=middle, step=step, format=form, width=SIZE
        )

    def _lines_in(self, axis: int) -> dict[int, Span]:
        """Lines in the picture across an axis, by the axis across which their slice is."""
        right, up = _others((0, 1, 2), axis)
        lines = {
            right: Span(dimension="height", line_color=LINES),
            up: Span(dimension="width", line_color=LINES),
        }
        for line in lines.values():
            self.figures[axis].add_layout(line)
        return lines

    def _turn(self, axis: int) -> None:
        """Show another slice across an axis, and where it is in the two other pictures."""
        node = float(self._nodes[axis][self.voxel(axis)])
        self.sliders[axis].title = NAMES[axis] + self._unit
        for lines in self._lines:
            if axis in lines:
                lines[axis].location = node
        self._draw(axis)

    def _take_shown(self) -> None:
        for axis in range(3):
            self.sliders[axis].disabled = self._projects
            for line in self._lines[axis].values():
                line.visible = not self._projects
            self._draw(axis)

    @property
    def _projects(self) -> bool:
        return self.shown.active == 1

    def _draw(self, axis: int) -> None:
        if self.volume is None:
            return
        made, voxel = self._made[axis], self.voxel(axis)
        if self._projects:
            made.title.text = f"largest along {NAMES[axis]}"
            made.draw(np.fmax.reduce(self.volume, axis=axis))  # of all but NaN
        else:
            node = self._nodes[axis][voxel]
            made.title.text = f"{NAMES[axis]} = {node:.{self._digits}f}{self._unit}"
            made.draw(np.take(self.volume, voxel, axis=axis))


def _others(items: tuple, axis: int) -> tuple:
    first, second = (item for k, item in enumerate(items) if k != axis)
    return first, second
