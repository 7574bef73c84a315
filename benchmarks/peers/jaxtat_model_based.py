"""jaxtat, an image f >= 0 of small total variation, fitted to the record."""

import numpy as np
from jaxtat_choices import image_of
from peer import run

from jaxtat.scans.constrained import fitted


def fit(scan, choices, setup):
    return fitted(scan, choices, setup, np.asarray(scan.data)).image


if __name__ == "__main__":
    run("jaxtat", lambda problem: image_of(problem, fit, model_based=True))
