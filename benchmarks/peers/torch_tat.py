"""torch-TAT, from a clone that TORCH_TAT names: its inverse for a circle, absent detectors zero.

Written after its README and demonstrations (`torch_adj_inv`), detectors equispaced on the circle
from the angle 0, the image on the square around it, negative values kept. Lengths are in units of
the circle's radius, and times accordingly: it compares a radius given with pixels from -1 to 1.
"""

import os
import sys

import numpy as np
from full_circle import on_full_circle, on_image
from peer import run


def reconstruct(problem):
    import torch
    from torch_TAT import torch_adj_inv

    record, radius, duration = on_full_circle(problem)
    n_times, n_detectors = record.shape
    data = torch.from_numpy(record.astype(np.float32))
    duration *= problem.sound_speed / radius
    known = ("cpu", n_detectors, n_times, 257, data, duration, 1.0, 1.0)
    found = torch_adj_inv(*known, "inverse", True, 1.0)
    return on_image(problem, found.numpy(), radius)


if __name__ == "__main__":
    sys.path.insert(0, os.environ["TORCH_TAT"])
    run("torch", reconstruct)
