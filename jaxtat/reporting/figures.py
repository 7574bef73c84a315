"""The figures of a report."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..base.units import OF_VALUES
from ..geometry import ImageGrid
from ..plotting import (
    SEQUENTIAL,
    gray_levels,
    greatest,
    label_axes,
    length_label,
    new_figure,
    picture,
    show_detectors,
    show_edges,
    show_frequencies,
    show_frequency_plane,
    show_geometry,
    show_image,
    show_opening,
    show_sinogram,
)
from ..plotting.canvas import beyond
from ..studies import DataResidual, Diagnosis, WaveAccuracy
from .constrained import Constrained

_DISKS = 7  # across the region, of edges that are seen


def image(diagnosis: Diagnosis, unit: str | None) -> Figure:
    """The image."""
    return picture(diagnosis.image, diagnosis.setup.grid, unit=unit)


def constrained(diagnosis: Diagnosis, fitted_image: Constrained, unit: str | None) -> Figure:
    """The fitted image and the direct one, in the same grey levels."""
    figure = new_figure(11, 5.2)
    outside = np.isnan(np.asarray(diagnosis.image))
    pair = {
        "fitted": np.where(outside, np.nan, np.asarray(fitted_image.image)),
        "direct": diagnosis.image,
    }
    both = np.stack([*pair.values()])
    limits = gray_levels(both)
    panels = figure.subplots(1, 2)
    grid = diagnosis.setup.grid
    shown = [
        show_image(axes, image, grid, limits=limits, title=title, unit=unit)
        for axes, (title, image) in zip(panels, pair.items(), strict=True)
    ]
    ends = beyond(both, limits)
    _bar(figure, shown[0], panels, OF_VALUES, shrink=0.9, extend=ends)
    return figure


def geometry(diagnosis: Diagnosis, unit: str | None) -> Figure:
    """Detectors, region, opening and visible edges; share of edges seen at every pixel."""
    figure = new_figure(11, 4.8)
    left, right = figure.subplots(1, 2)
    points, radius = _places(diagnosis)
    show_geometry(left, diagnosis.setup.curve, diagnosis.setup.region, unit=unit)
    show_opening(left, diagnosis.setup.curve, unit=unit)
    show_edges(left, diagnosis.setup.curve, points, radius, unit=unit)
    left.legend(fontsize=7, loc="upper right")
    label_axes(left, "", length_label("$x_1$", unit), length_label("$x_2$", unit))
    least = float(np.nanmin(np.asarray(diagnosis.visible)))
    shown = show_image(
        right,
        diagnosis.visible,
        diagnosis.setup.grid,
        limits=(min(least, 0.5), 1.0),
        cmap=SEQUENTIAL,
        unit=unit,
    )
    _bar(figure, shown, right, "share of edge directions seen", shrink=0.9)
    return figure


def _places(diagnosis: Diagnosis) -> tuple[np.ndarray, float]:
    """Points spread over the region, and a radius at which disks about them do not touch."""
    boundary = np.asarray(diagnosis.setup.region.points)
    low, size = boundary.min(axis=0), np.ptp(boundary, axis=0)
    numbers = np.maximum(1, np.round(_DISKS * size / size.max())).astype(int)
    steps = size / numbers
    along = (low[i] + steps[i] * (np.arange(numbers[i]) + 0.5) for i in range(2))
    points = np.stack(np.meshgrid(*along), axis=-1).reshape(-1, 2)
    inside = np.asarray(diagnosis.setup.region.contains(jax.device_put(points)))
    return points[inside], 0.38 * float(steps.min())


def waves(accuracy: WaveAccuracy, unit: str | None) -> Figure:
    """Error and noise gain over direction and frequency, and in the plane of fhat."""
    figure = new_figure(11, 9)
    rows = figure.subplots(2, 2)
    grid = accuracy.frequencies, accuracy.angles
    error, gain = np.asarray(accuracy.residual), np.asarray(accuracy.noise_gain)
    least = float(np.clip(error.min(), 1e-8, 0.1))
    each = {
        "error of plane waves": (error, LogNorm(10 ** np.floor(np.log10(least)), 1.0)),
        "noise gain": (gain, _norm(float(gain.min()), float(gain.max()))),
    }
    for axes, (label, (values, norm)) in zip(rows, each.items(), strict=True):
        show_frequencies(axes[0], *grid, values, norm=norm, unit=unit)
        shown = show_frequency_plane(axes[1], *grid, values, norm=norm, unit=unit)
        _bar(figure, shown, axes, label)
    return figure


def _norm(low: float, high: float) -> Normalize:
    """Colour scale: logarithmic if values span more than a decade, of which three are shown."""
    return LogNorm(max(low, 1e-3 * high), high) if high > 10 * low else Normalize(0.0, high or 1.0)


def _bar(figure: Figure, shown: ScalarMappable, axes: Any, label: str, **options: Any) -> None:
    bar = figure.colorbar(shown, ax=axes, **options)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=7)


def sinograms(diagnosis: Diagnosis, unit: str | None) -> tuple[Figure, float]:
    """Measured data, modelled data and residual, and how much the residual is amplified."""
    figure = new_figure(11, 4.6)
    panels = figure.subplots(1, 3, sharey=True)
    residual = diagnosis.residual
    limit = greatest(diagnosis.g)
    left = greatest(residual.values, otherwise=limit)
    amplified = 10.0 ** max(0.0, np.floor(np.log10(limit / left)))
    each = {
        "measured": (diagnosis.g, limit),
        "of the image": (residual.modelled, limit),
        "difference": (residual.values, limit / amplified),
    }
    for axes, (title, (values, most)) in zip(panels, each.items(), strict=True):
        shown = show_sinogram(
            axes,
            values,
            diagnosis.setup.radii,
            limit=most,
            meets=residual.meets,
            title=title,
            unit=unit,
        )
        _bar(figure, shown, axes, "", shrink=0.9, location="bottom", ticks=MaxNLocator(5))
    for axes in panels[1:]:
        axes.set_ylabel("")
    return figure, amplified


def detectors(residual: DataResidual) -> Figure:
    """Residual and gain of each detector."""
    figure = new_figure(11, 4.4)
    above, below = figure.subplots(2, 1, sharex=True)
    show_detectors(
        above, residual.per_detector, marked=residual.unusual, label="difference (relative)"
    )
    show_detectors(below, residual.gains, marked=residual.unusual, label="gain")
    above.set_xlabel("")
    return figure


def uncertainty(diagnosis: Diagnosis, unit: str | None) -> Figure:
    """Standard deviations of pixels of the direct image."""
    uncertainty = diagnosis.uncertainty
    assert uncertainty is not None
    return deviations(uncertainty.deviation, uncertainty.grid, unit)


def deviations(deviation: Float[Array, "x1 x2"], grid: ImageGrid, unit: str | None) -> Figure:
    """Standard deviations of pixels, blank where they are NaN."""
    figure = new_figure(7.2, 5.6)
    axes = figure.subplots()
    limits = (0.0, float(np.nanpercentile(np.asarray(deviation), 98)) or 1.0)
    shown = show_image(axes, deviation, grid, limits=limits, cmap=SEQUENTIAL, unit=unit)
    _bar(figure, shown, axes, "standard deviation [arb. unit]", shrink=0.9, extend="max")
    return figure
