"""Back-projection with the delays of straight rays through a body of another speed of sound.

The common practice where there are two speeds. It is told both, and the body itself, of an ellipse
the disk of its area.
"""

import jax
import numpy as np
from peer import run
from scipy.signal import hilbert
from sound_in_space import in_space

from jaxtat import DiskBody, __version__
from jaxtat.geometry.bodies import lag

jax.config.update("jax_enable_x64", True)


def reconstruct(problem):
    """The record's Hilbert transform, as PATATO's, by the angle under which a detector is seen."""
    terms, times = np.imag(hilbert(in_space(problem).record, axis=1)), problem.times
    points = np.stack(np.meshgrid(problem.axis, problem.axis, indexing="ij"), -1).reshape(-1, 2)
    x, y, radius, speed = problem.body
    body = DiskBody((x, y), radius, speed, problem.water_speed)
    late = np.asarray(lag(body, problem.detectors, points))
    image = angles = np.zeros(len(points))
    for position, values, more in zip(problem.detectors, terms, late, strict=True):
        offset = points - position
        distance = np.linalg.norm(offset, axis=1)
        angle = np.abs(offset @ position) / distance**2
        image = image + angle * np.interp((distance + more) / problem.water_speed, times, values)
        angles = angles + angle
    return (image / angles).reshape(problem.pixels, problem.pixels)


if __name__ == "__main__":
    run("jaxtat", reconstruct, version=__version__, compiles=False)
