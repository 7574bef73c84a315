"""GAPAT on the processor: delay and sum of the elements' signals, weighted by solid angle."""

import numpy as np
from peer import run


def reconstruct(problem, method="das"):
    from gapat.algorithms import recon

    step = 2 * problem.half_width / (problem.pixels - 1)
    ranges = [[-problem.half_width, problem.half_width + step]] * 3
    inward = -problem.detectors / np.linalg.norm(problem.detectors, axis=1, keepdims=True)
    arrays = (np.float32(values) for values in (problem.record, problem.detectors, inward))
    known = step, problem.sound_speed, problem.sampling_rate
    return recon(*arrays, *ranges, *known, method=method, device="cpu")


if __name__ == "__main__":
    run("gapat", reconstruct)
