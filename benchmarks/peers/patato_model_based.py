"""PATATO: least squares with its Laplacian penalty, as its authors used it; its matrix included."""

from patato_scan import preprocessed, sizes
from peer import run


def reconstruct(problem):
    from patato.recon.model_based.model_based import ModelBasedReconstruction

    record, rate, geometry = preprocessed(problem, hilbert=False)
    known = {
        "geometry": geometry,
        "fs": rate,
        "nt": record.shape[-1],
        "c": problem.sound_speed,
    }
    pixels, field = sizes(problem)
    method = ModelBasedReconstruction(pixels, field, known, regulariser="laplacian")
    found = method.reconstruct(record, rate, geometry, pixels, field, problem.sound_speed)
    return found.reshape(problem.pixels, problem.pixels).T


if __name__ == "__main__":
    run("patato", reconstruct, compiles=False)
