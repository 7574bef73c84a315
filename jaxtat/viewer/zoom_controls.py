"""Three sliders for the disk within the region that is shown."""

import math
from collections.abc import Callable
from typing import Any

from bokeh.models import Slider

from ..base.units import millimetres
from .session import Session, Shown
from .viewed_scan import ViewedScan

LEAST = 0.1  # of the region's radius, that a disk has


class ZoomControls:
    """Sliders for radius and centre; a centre off the region's leaves the largest disk that fits.

    Args:
        session: whose region they are in.
        width: of a slider [pixel].
        changed: called when one is moved.
    """

    def __init__(self, session: Session, width: int, changed: Callable[[], Any]):
        self.sliders = [
            Slider(start=0.0, end=1.0, value=0.0, step=0.01, format="0.[00]", width=width)
            for _ in range(3)
        ]
        self.take(session)
        for slider in self.sliders:
            slider.on_change("value", lambda attr, old, new: changed())

    def take(self, session: Session) -> None:
        """Set the sliders to the whole region of a session."""
        scale, unit = lengths(session)
        choices = session.choices
        self._scale, self._region = scale, (choices.region_radius, *choices.region_center)
        radius, x1, x2 = (scale * value for value in self._region)
        far = (1 - LEAST) * radius
        ranges = (
            (LEAST * radius, radius, radius),
            (x1 - far, x1 + far, x1),
            (x2 - far, x2 + far, x2),
        )
        names = "look at a radius", "about x₁", "about x₂"
        for slider, name, (start, end, value) in zip(self.sliders, names, ranges, strict=True):
            slider.update(title=name + unit, start=start, end=end, value=value)
            slider.update(step=radius / 200, visible=session.can_look)

    def show(self, disk: Shown | None) -> None:
        """Set the sliders to a disk; None for all of the region."""
        radius, center = disk or (self._region[0], self._region[1:])
        for slider, value in zip(self.sliders, (radius, *center), strict=True):
            slider.value = self._scale * value

    @property
    def disk(self) -> Shown | None:
        """Radius and centre [length]; None for all of the region."""
        whole, x1, x2 = self._region
        radius, *center = (float(slider.value) / self._scale for slider in self.sliders)
        off = math.hypot(center[0] - x1, center[1] - x2)
        least, step = LEAST * whole, whole / 200
        if off < step / 2 and radius > whole - step / 2:
            return None
        share = min(1.0, (whole - least) / off) if off else 1.0
        radius = min(radius, whole - share * off)
        return radius, (x1 + share * (center[0] - x1), x2 + share * (center[1] - x2))


def lengths(session: ViewedScan) -> tuple[float, str]:
    """Millimetres of a length of 1, and how the unit is shown."""
    unit = session.choices.units.length
    return millimetres(unit), " [mm]" if unit else ""
