"""Figures without a screen, colour maps, and units on axes."""

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

GRAY, SEQUENTIAL, DIVERGING = "gray", "viridis", "RdBu_r"


def new_figure(width: float, height: float) -> Figure:
    """A figure of the given size [inch] that needs no screen."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def length_label(symbol: str, unit: str | None) -> str:
    """Of an axis of lengths: in millimetres if the unit of the coordinates is known.

    >>> length_label("$r$", "m"), length_label("$r$", None)
    ('$r$ [mm]', '$r$')
    """
    return symbol if unit is None else f"{symbol} [mm]"


def frequency_label(symbol: str, unit: str | None) -> str:
    """Of an axis of frequencies, in radians per length."""
    return symbol if unit is None else f"{symbol} [rad/mm]"
