"""Records as methods for sound in space want them.

Of a line of sources, the wave in a plane has in the far field the half integral over time of the
wave that its points make in space. So its half derivative is what a detector in space would have
recorded, up to a factor. Without it such methods give the low frequencies too much weight, and
their images have several times the error.
"""

from dataclasses import replace

import numpy as np

STEEPNESS = 4  # order of the low-pass


def in_space(problem):
    """The problem with the record of sound in space, up to the highest frequency of the pixels.

    Such a low-pass, a Butterworth's without its delay, is part of the presets of PATATO.
    """
    n = 2 * problem.record.shape[1]
    frequencies = np.fft.rfftfreq(n, 1 / problem.sampling_rate)
    highest = problem.sound_speed * (problem.pixels - 1) / (4 * problem.half_width)
    factor = 1 / np.sqrt(1 + (frequencies / highest) ** (2 * STEEPNESS))
    half_derivative = np.sqrt(2j * np.pi * frequencies)
    spectra = np.fft.rfft(problem.record, n, axis=1) * factor * half_derivative
    return replace(problem, record=np.fft.irfft(spectra, n, axis=1)[:, : n // 2])
