"""PATATO: least squares with its Laplacian penalty, as its authors used it; its matrix included.

Of its defaults one is changed: 50 iterations instead of 10, after which images are far from done.
"""

import numpy as np
from patato_scan import preprocessed, sizes
from peer import NotForThis, run
from sound_in_space import in_space

ITERATIONS = 50
ASIDE = 1e-7  # over half the image: a detector just level with pixels makes its matrix NaN


def reconstruct(problem):
    from patato.recon.model_based.model_based import ModelBasedReconstruction

    if np.linalg.norm(problem.detectors, axis=1).min() < np.sqrt(2) * problem.half_width:
        raise NotForThis("its matrix wants all detectors outside of the square of the image")
    record, rate, geometry = preprocessed(in_space(problem), hilbert=False)
    geometry[:, :2] += ASIDE * problem.half_width
    known = {
        "geometry": geometry,
        "fs": rate,
        "nt": record.shape[-1],
        "c": problem.sound_speed,
    }
    pixels, field = sizes(problem)
    method = ModelBasedReconstruction(
        pixels, field, known, regulariser="laplacian", iter_lim=ITERATIONS
    )
    found = method.reconstruct(record, rate, geometry, pixels, field, problem.sound_speed)
    return found.reshape(problem.pixels, problem.pixels).T


if __name__ == "__main__":
    run("patato", reconstruct, compiles=False)
