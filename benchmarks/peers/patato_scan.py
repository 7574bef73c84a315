"""What PATATO's three methods have in common: units, axes, preprocessing."""

import numpy as np
from scipy.signal import hilbert as analytic


def sizes(problem):
    """Pixels and field of view along x, y and z."""
    return (problem.pixels, problem.pixels, 1), (2 * problem.half_width,) * 2 + (0.0,)


def preprocessed(problem, hilbert):
    """The record (1, 1, detectors, samples), its rate, and positions in space.

    ``hilbert`` as its preprocessing does it: the imaginary part of the analytic signal.
    """
    record = problem.record
    if hilbert:
        record = np.imag(analytic(record, axis=1))
    geometry = np.insert(problem.detectors, 2, 0.0, axis=1)
    return record[None, None].astype(np.float32), problem.sampling_rate, geometry


def image_of(problem, method, record, rate, geometry):
    """As image[x, y] what a class of it makes, [.., y, x]."""
    pixels, field = sizes(problem)
    found = method(pixels, field).reconstruct(
        record, rate, geometry, pixels, field, problem.sound_speed
    )
    return np.asarray(found).reshape(problem.pixels, problem.pixels).T
