"""A record on a whole circle and an image on the square around it: what two of the peers want."""

import numpy as np
from peer import NotForThis
from scipy.interpolate import RegularGridInterpolator

DETECTORS = 512  # around the circle, at least


def on_full_circle(problem):
    """The record (samples, detectors) from the angle 0, radius and duration; zero in the gap.

    Angles between those of the array are interpolated.
    """
    distances = np.linalg.norm(problem.detectors, axis=1)
    radius = distances.mean()
    if np.ptp(distances) > 1e-3 * radius:
        raise NotForThis("for circles only")
    angles = np.arctan2(problem.detectors[:, 1], problem.detectors[:, 0]) % (2 * np.pi)
    order = np.argsort(angles)
    angles, record = angles[order], problem.record[order]
    around = np.concatenate([angles[-1:] - 2 * np.pi, angles, angles[:1] + 2 * np.pi])
    record = np.concatenate([record[-1:], record, record[:1]])
    wanted = 2 * np.pi * np.arange(max(DETECTORS, len(angles))) / max(DETECTORS, len(angles))
    after = np.searchsorted(around, wanted, side="right").clip(1, len(around) - 1)
    step = np.diff(around)
    share = ((wanted - around[after - 1]) / step[after - 1])[:, None]
    found = (1 - share) * record[after - 1] + share * record[after]
    found[step[after - 1] > 2.5 * np.median(step)] = 0.0  # the gap
    duration = (problem.record.shape[1] - 1) / problem.sampling_rate
    return found.T, float(radius), duration


def on_image(problem, found, radius):
    """At the image's pixels, of a square [-radius, radius] whose rows run along y."""
    x = np.linspace(-radius, radius, len(found))
    points = np.stack(np.meshgrid(problem.axis, problem.axis, indexing="ij"), axis=-1)
    return RegularGridInterpolator((x, x), found.T, bounds_error=False, fill_value=0.0)(points)
