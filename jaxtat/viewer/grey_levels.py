"""From values to grey levels or colours, and the controls that change how."""

import numpy as np
from bokeh.layouts import row
from bokeh.models import LinearColorMapper, RangeSlider, Select, Toggle
from bokeh.palettes import Greys256, Inferno256, Viridis256

COLOURS = {"grey": Greys256, "viridis": Viridis256, "inferno": Inferno256}


class GreyLevels:
    """Levels by percentiles of what is shown; nothing is computed again for its controls.

    Attributes:
        colours: from values to grey levels.
        levels: slider of the percentiles between which colours are.
        controls: this slider, and those that go with it.
    """

    def __init__(self):
        self._values: np.ndarray | None = None
        self.colours = LinearColorMapper(COLOURS["grey"], low=0.0, high=1.0, nan_color="#00000000")
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

    def take(self, values: np.ndarray) -> None:
        """Set the levels by these values, which are shown now; NaN does not count."""
        self._values = values
        self._take_levels()

    def _take_levels(self) -> None:
        if self._values is None or self._hold.active:
            return
        low, high = np.nanpercentile(self._values, self.levels.value)
        self.colours.update(low=float(low), high=float(high) if high > low else float(low) + 1.0)

    def _take_palette(self) -> None:
        self.colours.palette = COLOURS[self._palette.value]
