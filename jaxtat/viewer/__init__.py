"""A scan in the browser, with knobs to turn: the page and its server are on this machine alone."""

from .keeping import command_line, keep
from .serve import Viewer, view
from .session import PIXELS, Knobs, Session

__all__ = ["PIXELS", "Knobs", "Session", "Viewer", "command_line", "keep", "view"]
