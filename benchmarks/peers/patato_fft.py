"""PATATO: the Fourier-Hankel method for circles, absent detectors being zero.

Its images are turned as its scanner's are, whose middle is at the top: so the array is turned
there, and the image back. A ring has no middle: it is moved by 1e-9 of its radius.
"""

import numpy as np
from patato_scan import image_of, preprocessed
from peer import NotForThis, run
from scipy.ndimage import rotate


def reconstruct(problem, mend=lambda image: image):
    from patato.recon.fourier_transform_rec import FFTReconstruction

    distances = np.linalg.norm(problem.detectors, axis=1)
    if np.ptp(distances) > 1e-3 * distances.mean():
        raise NotForThis("for circles only")
    record, rate, geometry = preprocessed(problem, hilbert=False)
    middle = problem.detectors.mean(axis=0)
    turn = np.pi / 2 - np.arctan2(middle[1], middle[0])
    if np.linalg.norm(middle) < 1e-3 * distances.mean():
        turn = 0.0
    c, s = np.cos(turn), np.sin(turn)
    geometry[:, :2] = problem.detectors @ np.array([[c, s], [-s, c]])
    geometry[:, 1] += 1e-9 * distances.mean()
    order = np.argsort(_from_the_middle(geometry))
    found = mend(image_of(problem, FFTReconstruction, record[:, :, order], rate, geometry[order]))
    return found if turn == 0 else rotate(found, np.degrees(turn), reshape=False, order=3)


def _from_the_middle(geometry):
    """Angles by which it interpolates, from -pi to pi: they have to increase."""
    middle = np.arctan2(np.mean(geometry[:, 1]), np.mean(geometry[:, 0]))
    angles = (np.arctan2(geometry[:, 1], geometry[:, 0]) - middle) % (2 * np.pi)
    return np.where(angles > np.pi, angles - 2 * np.pi, angles)


if __name__ == "__main__":
    run("patato", reconstruct)
