"""Time reversal on a grid: what k-Wave and jwave are given alike."""

import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline
from scipy.ndimage import map_coordinates

FINEST = 1 / 240  # spacing over the array's width: 0.2 mm for 48 mm


def grid_of(problem):
    """Coordinates, the same along both axes, and times."""
    reach = np.abs(problem.detectors).max()
    spacing = max(2 * reach * FINEST, 2 * problem.half_width / (problem.pixels - 1))
    n = 2 * int(np.ceil(1.04 * reach / spacing))
    x = spacing * (np.arange(n) - n // 2)
    step = 0.3 * spacing / problem.sound_speed
    return x, np.arange(0, problem.times[-1], step)


def played(problem, x, times):
    """Grid points on the curve between detectors, as a mask, and their records, row by row."""
    order, joined = _along(problem.detectors)
    fine = np.unique(np.linspace(0, joined, 40 * (len(order) + 1)).clip(0, joined))
    points = np.stack(
        [np.interp(fine, np.arange(len(order)), problem.detectors[order, i]) for i in (0, 1)], 1
    )
    nodes = np.rint((points - x[0]) / (x[1] - x[0])).astype(int)
    flat, first = np.unique(np.ravel_multi_index(nodes.T, (len(x),) * 2), return_index=True)
    at = CubicSpline(problem.times, problem.record[order], axis=1)(times)
    record = map_coordinates(
        at,
        np.stack(np.meshgrid(fine[first], np.arange(len(times)), indexing="ij")),
        order=1,
    )
    mask = np.zeros(len(x) ** 2, bool)
    mask[flat] = True
    return mask.reshape(len(x), len(x)), record


def _along(detectors):
    """Rows along the curve, the first again where it is closed, and the last place on it."""
    steps = np.linalg.norm(np.diff(detectors, axis=0), axis=1)
    closing = np.linalg.norm(detectors[0] - detectors[-1])
    rows = np.arange(len(detectors))
    if closing < 1.5 * steps.max():
        rows = np.append(rows, 0)
    return rows, float(len(rows) - 1)


def on_image(problem, x, field):
    """At the image's pixels."""
    return RectBivariateSpline(x, x, field)(problem.axis, problem.axis)
