"""PATATO: the Fourier-Hankel method for circles, absent detectors being zero."""

import numpy as np
from patato_scan import image_of, preprocessed
from peer import NotForThis, run


def reconstruct(problem):
    from patato.recon.fourier_transform_rec import FFTReconstruction

    distances = np.linalg.norm(problem.detectors, axis=1)
    if np.ptp(distances) > 1e-3 * distances.mean():
        raise NotForThis("for circles only")
    record, rate, geometry = preprocessed(problem, hilbert=False)
    return image_of(problem, FFTReconstruction, record, rate, geometry)


if __name__ == "__main__":
    run("patato", reconstruct)
