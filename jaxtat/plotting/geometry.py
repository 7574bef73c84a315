"""Detectors, region of interest and opening, and which edges can be seen at chosen points."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection

from ..base.checks import Numbers
from ..base.units import millimetres
from ..geometry import (
    VISIBLE,
    DetectorCurve,
    ImageGrid,
    Region,
    edge_weight,
    fit_circle,
    visibility_map,
)
from ..geometry.measured_curves import behind_gap
from .canvas import SEQUENTIAL
from .images import show_image

_DIRECTIONS = 90  # over half a turn


def show_geometry(
    axes: Axes, curve: DetectorCurve, region: Region, *, unit: str | None = None
) -> None:
    """Draw the detectors (dots) and the boundary of the region of interest (line).

    Args:
        axes: where to draw.
        curve, region: the geometry.
        unit: of length, as in `show_image`; labels are the caller's.
    """
    scale, label = millimetres(unit), "region of interest"
    for part in region.components:
        boundary = scale * np.asarray(part.points)
        outline = np.concatenate([boundary, boundary[:1]])
        axes.plot(*outline.T, "-", color="tab:orange", lw=1, label=label)
        label = ""
    axes.plot(*scale * np.asarray(curve.points).T, ".", color="tab:blue", ms=1.5, label="detectors")
    axes.set_aspect("equal")
    axes.autoscale()  # an image drawn before has fixed the limits to itself


def show_opening(axes: Axes, curve: DetectorCurve, *, unit: str | None = None) -> None:
    """Draw a dashed line where detectors are missing: along the circle, if they lie on one."""
    points = millimetres(unit) * np.asarray(curve.points)
    after = np.roll(points, -1, axis=0)
    steps = np.linalg.norm(after - points, axis=1)
    gaps = np.flatnonzero(behind_gap(steps, curve.closed))
    for number, gap in enumerate(gaps.tolist()):
        label = "" if number else "opening"
        axes.plot(*_bridge(points, gap).T, "--", color="0.5", lw=1, label=label)


def _bridge(points: np.ndarray, gap: int) -> np.ndarray:
    """Points from detector ``gap`` to the next, in the order of the detectors."""
    ends = points[[gap, (gap + 1) % len(points)]]
    try:
        circle = fit_circle(points)
    except ValueError:  # a straight array
        return ends
    center, radius = np.asarray(circle.center), float(circle.radius)
    if np.abs(np.linalg.norm(points - center, axis=1) - radius).max() > 1e-2 * radius:
        return ends
    angles = np.arctan2(*(points - center).T[::-1])
    sense = np.sign(np.median(np.diff(np.unwrap(angles))))
    first, last = np.arctan2(*(ends - center).T[::-1])
    turn = np.linspace(0, (sense * (last - first)) % (2 * np.pi), 100)
    return center + radius * _unit(first + sense * turn)


def show_visibility(
    axes: Axes, curve: DetectorCurve, grid: ImageGrid, *, unit: str | None = None
) -> ScalarMappable:
    """Draw which share of edge directions can be seen at each pixel, dark for 0, bright for 1.

    Args:
        axes: where to draw.
        curve: the detectors.
        grid: where `visibility_map` is wanted.
        unit: of length, as in `show_image`.

    Returns:
        What a colour bar needs.
    """
    seen = visibility_map(curve, grid)
    return show_image(axes, seen, grid, limits=(0.0, 1.0), cmap=SEQUENTIAL, unit=unit)


def show_edges(
    axes: Axes, curve: DetectorCurve, points: Numbers, radius: float, *, unit: str | None = None
) -> None:
    """Draw a small disk about each point, filled in the directions of edge normals that are seen.

    An empty sector is a direction of normals whose edges no detector records, so that they are
    missing or smeared in the image; a full disk is a point where every edge is recorded.

    Args:
        axes: where to draw.
        curve: the detectors.
        points: (points, 2) [length].
        radius: of the disks [length].
        unit: of length, as in `show_image`.
    """
    points = np.asarray(points, float)
    step = np.pi / _DIRECTIONS
    angles = (np.arange(_DIRECTIONS) + 0.5) * step
    seen = np.asarray(edge_weight(curve, points, angles)) >= VISIBLE
    points, radius = millimetres(unit) * points, millimetres(unit) * radius
    corners = radius * _unit(angles[:, None] + step * np.array([-0.5, 0.5]))  # (angles, 2, 2)
    sector = np.concatenate([np.zeros_like(corners[:, :1]), corners], axis=1)
    rim = radius * _unit(np.linspace(0, 2 * np.pi, 40))
    rims = [center + rim for center in points]
    axes.add_collection(PolyCollection(rims, facecolor="white", edgecolor="0.4", lw=0.5))
    sectors = [
        center + sign * sector[here]
        for center, here in zip(points, seen, strict=True)
        for sign in (1, -1)
    ]
    filled = np.concatenate(sectors) if sectors else np.zeros((0, 3, 2))
    axes.add_collection(
        PolyCollection(list(filled), facecolor="tab:blue", edgecolor="tab:blue", lw=0.3)
    )


def _unit(angles: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)
