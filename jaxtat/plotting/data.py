"""Data and residuals: over detectors and radii, and detector by detector."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable

from ..base.checks import Numbers
from ..base.units import millimetres
from .canvas import DIVERGING, greatest, label_axes, length_label, text_size


def show_sinogram(
    axes: Axes,
    values: Numbers,
    radii: Numbers,
    *,
    limit: float | None = None,
    meets: Numbers | None = None,
    title: str = "",
    unit: str | None = None,
) -> ScalarMappable:
    """Draw g(z_k, r): detectors to the right, radii upwards, zero in the middle of the colours.

    Args:
        axes: where to draw.
        values: (detectors, radii).
        radii: increasing, (radii,) [length].
        limit: value of the strongest colours, by default the 99.8th percentile of |values|.
        meets: whether circles meet the region of interest, (detectors, radii): outlined.
        title: above the picture.
        unit: of length, as in `show_image`.

    Returns:
        What a colour bar needs.
    """
    values, radii = np.asarray(values), millimetres(unit) * np.asarray(radii)
    if limit is None:
        limit = greatest(values)
    numbers = np.arange(values.shape[0] + 1) - 0.5
    middles = (radii[1:] + radii[:-1]) / 2
    edges = np.concatenate([2 * radii[:1] - middles[:1], middles, 2 * radii[-1:] - middles[-1:]])
    options = {"vmin": -limit, "vmax": limit, "cmap": DIVERGING, "rasterized": True}
    shown = axes.pcolormesh(numbers, edges, values.T, **options)
    if meets is not None:
        inside = np.asarray(meets)
        for bound in (inside.argmax(axis=1), inside.shape[1] - 1 - inside[:, ::-1].argmax(axis=1)):
            axes.plot(radii[bound], "--", color="0.3", lw=0.8)
    label_axes(axes, title, "detector", length_label("radius $r$", unit))
    return shown


def show_detectors(axes: Axes, values: Numbers, *, marked: Numbers = (), label: str = "") -> None:
    """Draw one value per detector, some of them marked.

    Args:
        axes: where to draw.
        values: (detectors,).
        marked: numbers of detectors that get a cross and, up to eight of them, their number.
        label: of the vertical axis.
    """
    values, marked = np.asarray(values), np.asarray(marked, int)
    axes.plot(values, ".-", color="tab:blue", lw=0.6, ms=3)
    axes.plot(marked, values[marked], "x", color="tab:orange", ms=8, mew=2)
    for number in marked[:8]:
        axes.annotate(
            f"{number}",
            (number, values[number]),
            xytext=(6, 0),
            textcoords="offset points",
            fontsize=text_size(8),
            va="center",
        )
    axes.set_xlim(-0.5, len(values) - 0.5)
    axes.set_ylim(bottom=min(0.0, 1.05 * float(values.min())))
    label_axes(axes, "", "detector", label)
    axes.grid(alpha=0.3)
