"""Figures without a screen, colour maps, and units on axes."""

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..base.checks import Numbers

GRAY, SEQUENTIAL, DIVERGING = "gray", "viridis", "RdBu_r"


def new_figure(width: float, height: float) -> Figure:
    """A figure of the given size [inch] that needs no screen."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def label_axes(axes: Axes, title: str, horizontal: str, vertical: str) -> None:
    """Set a title and the names of both axes, in the sizes that all plots here share."""
    axes.set_title(title, fontsize=text_size(9))
    axes.set_xlabel(horizontal, fontsize=text_size(8))
    axes.set_ylabel(vertical, fontsize=text_size(8))
    axes.tick_params(labelsize=text_size(7))


def text_size(points: float) -> float:
    """Size of a text in points: this many at matplotlib's font size 10, else in proportion."""
    return points / 10 * float(rcParams["font.size"])


def gray_levels(image: np.ndarray) -> tuple[float, float]:
    """The 0.2th and 99.8th percentile, so that one bright pixel does not darken the rest."""
    low, high = np.nanpercentile(image, [0.2, 99.8])
    return float(low), float(high)


def beyond(values: np.ndarray, limits: tuple[float, float]) -> str:
    """At which ends of a colour bar values lie beyond the limits, as Matplotlib names them.

    >>> beyond(np.array([0.0, 1.0, 5.0]), (0.0, 2.0)), beyond(np.ones(3), (0.0, 2.0))
    ('max', 'neither')
    """
    below, above = np.any(values < limits[0]), np.any(values > limits[1])  # NaN is neither
    return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[int(below), int(above)]


def greatest(values: Numbers, otherwise: float = 1.0) -> float:
    """The 99.8th percentile of |values|, a limit for colours; ``otherwise`` if that is 0."""
    return float(np.percentile(np.abs(np.asarray(values)), 99.8)) or otherwise


def length_label(symbol: str, unit: str | None) -> str:
    """Label of an axis of lengths: in millimetres if the unit of the coordinates is known.

    >>> length_label("$r$", "m"), length_label("$r$", None)
    ('$r$ [mm]', '$r$')
    """
    return symbol if unit is None else f"{symbol} [mm]"


def frequency_label(symbol: str, unit: str | None) -> str:
    """Label of an axis of frequencies, in radians per length."""
    return symbol if unit is None else f"{symbol} [rad/mm]"
