"""A scan in the browser, with controls; page and server are on this machine only."""

from .export import command_line, keep
from .serve import Viewer, view
from .session import PIXELS, ControlValues, Session

__all__ = ["PIXELS", "ControlValues", "Session", "Viewer", "command_line", "keep", "view"]
