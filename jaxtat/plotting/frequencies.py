"""Values on the polar grid of frequencies: as a rectangle, and in the plane of fhat."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable

from ..base.checks import Numbers
from ..base.units import millimetres
from .canvas import SEQUENTIAL, frequency_label, label_axes


def show_frequencies(
    axes: Axes,
    frequencies: Numbers,
    angles: Numbers,
    values: Numbers,
    *,
    norm: Any = None,
    cmap: str = SEQUENTIAL,
    title: str = "",
    unit: str | None = None,
) -> ScalarMappable:
    """Draw values over the direction theta (to the right) and the frequency lambda (upwards).

    Args:
        axes: where to draw.
        frequencies: i d lambda, (frequencies,) [rad/length].
        angles: equispaced over half a turn, (directions,) [rad].
        values: (frequencies, directions).
        norm: matplotlib's, for instance `matplotlib.colors.LogNorm`.
        cmap, title: as in `show_image`.
        unit: of length, as in `show_image`.

    Returns:
        What a colour bar needs.
    """
    edges, theta = _edges(frequencies, angles, unit)
    options = {"norm": norm, "cmap": cmap, "rasterized": True}
    shown = axes.pcolormesh(np.degrees(theta), edges, np.asarray(values), **options)
    frequency = frequency_label("frequency $\\lambda$", unit)
    label_axes(axes, title, "direction $\\theta$ [degrees]", frequency)
    axes.set_xticks([0, 45, 90, 135, 180])
    return shown


def show_frequency_plane(
    axes: Axes,
    frequencies: Numbers,
    angles: Numbers,
    values: Numbers,
    *,
    norm: Any = None,
    cmap: str = SEQUENTIAL,
    title: str = "",
    unit: str | None = None,
) -> ScalarMappable:
    """Draw values in the plane of frequencies, at xi = lambda (cos theta, sin theta) and at -xi.

    fhat(-xi) is the conjugate of fhat(xi), and found as accurately. Arguments as in
    `show_frequencies`.
    """
    edges, theta = _edges(frequencies, angles, unit)
    turn = np.concatenate([theta, theta[1:] + np.pi])
    values = np.asarray(values)
    options = {"norm": norm, "cmap": cmap, "rasterized": True}
    shown = axes.pcolormesh(
        edges[:, None] * np.cos(turn),
        edges[:, None] * np.sin(turn),
        np.concatenate([values, values], axis=1),
        **options,
    )
    axes.set_aspect("equal")
    horizontal, vertical = (frequency_label(f"$\\xi_{i}$", unit) for i in (1, 2))
    label_axes(axes, title, horizontal, vertical)
    return shown


def _edges(
    frequencies: Numbers, angles: Numbers, unit: str | None
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the cells around the nodes of the grid."""
    frequencies = np.asarray(frequencies, float) / millimetres(unit)
    angles = np.asarray(angles, float)
    step, turn = frequencies[0], np.pi / len(angles)
    return np.append(frequencies - step / 2, frequencies[-1] + step / 2), np.append(
        angles - turn / 2, angles[-1] + turn / 2
    )
