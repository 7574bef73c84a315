"""jaxtat, direct, with all frequencies of the pixels asked, as all other packages make images.

Its own choice ends them where noise exceeds what the record holds.
"""

import numpy as np
from jaxtat_choices import image_of
from peer import Problem, run

from jaxtat.scans import integrals
from jaxtat.scans.images import formula_images


def direct(scan, choices, setup):
    return formula_images(setup, integrals(scan, choices, setup, scan.data), choices, None)


def reconstruct(problem: Problem) -> np.ndarray:
    highest = np.pi * (problem.pixels - 1) / (2 * problem.half_width)
    return image_of(problem, direct, max_frequency=highest, model_based=False)


if __name__ == "__main__":
    run("jaxtat", reconstruct)
