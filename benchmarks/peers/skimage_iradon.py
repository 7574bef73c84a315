"""scikit-image: filtered back-projection of straight lines, where circles are taken for lines.

It has no method for circular means. What it has, `iradon`, serves detectors all around and far
away: the integral over time of sound in space is then about the integral over the line that crosses
the detector's direction at this distance. So a user without any other code may do it.
"""

import numpy as np
from peer import NotForThis, run
from scipy.integrate import cumulative_trapezoid
from skimage.transform import iradon
from sound_in_space import in_space


def reconstruct(problem):
    distances = np.linalg.norm(problem.detectors, axis=1)
    angles = np.degrees(np.arctan2(problem.detectors[:, 1], problem.detectors[:, 0]))
    gaps = np.diff(np.sort(angles), append=np.sort(angles)[0] + 360)
    if np.ptp(distances) > 1e-3 * distances.mean() or gaps.max() > 2 * np.median(gaps):
        raise NotForThis("iradon would need detectors all around")
    path = problem.sound_speed * problem.times
    means = cumulative_trapezoid(in_space(problem).record, path, axis=1, initial=0)
    offsets = distances.mean() - problem.axis
    lines = np.stack([np.interp(offsets, path, row) for row in means])
    found = iradon(lines.T, angles, problem.pixels, circle=True)
    # its rows run downwards along -y
    return found[::-1].T


if __name__ == "__main__":
    run("scikit-image", reconstruct)
