"""An image that is kept beside the one that is shown, to compare two settings."""

import numpy as np
from bokeh.models import ColumnDataSource, Title, Toggle
from bokeh.plotting import figure

from .picture import Picture


class Beside:
    """A copy of a picture as it is now, on the same axes and with the same grey levels.

    Args:
        picture: the one that goes on.

    Attributes:
        figure: of Bokeh, hidden until an image is kept.
        toggle: keeps the image that is shown, and hides it again.
    """

    def __init__(self, picture: Picture):
        self._picture = picture
        self._pixels = ColumnDataSource({"image": [np.zeros((1, 1), np.float32)]})
        of = picture.figure
        self.figure = figure(
            frame_width=of.frame_width,
            frame_height=of.frame_height,
            x_range=of.x_range,
            y_range=of.y_range,
            tools="pan,wheel_zoom,reset",
            active_scroll="wheel_zoom",
            visible=False,
        )
        self.figure.toolbar.logo = None
        self.figure.grid.visible = False
        self.title = Title(text="", text_font_style="normal")
        self.figure.add_layout(self.title, "above")
        self._glyph = self.figure.image(
            "image",
            source=self._pixels,
            color_mapper=picture.colours,  # pyright: ignore[reportCallIssue]
            **picture.place,
        )
        self.toggle = Toggle(label="keep beside")
        self.toggle.on_change("active", lambda attr, old, new: self._take())

    def _take(self) -> None:
        image = self._picture.image
        if self.toggle.active and image is not None:
            self._glyph.glyph.update(**self._picture.place)
            self._pixels.data = {"image": [np.ascontiguousarray(image.T, np.float32)]}
            self.title.text = f"{self._picture.title.text}: {self._picture.settings}"
        self.figure.visible = bool(self.toggle.active) and image is not None
