"""PATATO: the Fourier-Hankel method, without the fading of its images towards two corners.

Its Fourier transform of an odd number of pixels, 3 n, is shifted by one, which multiplies the pixel
(i, j) from the middle by cos(2 pi (i - j) / (3 n)). Here it is divided by that.
"""

import numpy as np
from patato_fft import reconstruct
from peer import run

LEAST = 0.1  # what fades more is nothing but noise


def mended(image):
    place = np.arange(len(image)) - len(image) // 2
    fading = np.cos(2 * np.pi * (place[:, None] - place) / (3 * len(image)))
    return np.where(fading > LEAST, image / np.maximum(fading, LEAST), 0.0)


if __name__ == "__main__":
    run("patato", lambda problem: reconstruct(problem, mended))
