"""Standard deviations of the pixels of a scan's images, from random records of its noise.

A direct reconstruction is linear, so that records of nothing but noise give images of nothing but
noise. Their root mean square is the standard deviation, whatever colour the noise has and whatever
is done to the record; from n of them it is known to 1/√(2n).
"""

import warnings

import jax
import numpy as np
from jaxtyping import Array, Float, Real

from ..io import Scan
from ..reconstruction import ReconstructionPlan, Setup
from ..records import LEAST_SAMPLES, RecordNoise, noise_of_record
from ..steps import AccuracyWarning
from .choices import Choices
from .frames import integrals, lit_frames, setup_of, shifted_times
from .images import formula_images, frames_together, without_blank_frames

DRAWN = 32  # records: standard deviations are good to 13 %


def standard_deviations(
    scan: Scan, choices: Choices, *, plan: ReconstructionPlan | None = None
) -> Float[np.ndarray, "frames x1 x2"] | None:
    """√Var f of every pixel and frame, from the noise of the record before sound arrives.

    Noise is taken to be of one colour, and spread alike over the detectors, in all frames; its size
    is that of each frame, over the energy of its pulse if that is divided out. So few images are
    made, whatever the number of frames.

    Args:
        scan, choices, plan: as in `scans.reconstruct`.

    Returns:
        As the images of frames that are good [their unit]; None where a record has no quiet part,
        of circular integrals, in space, and of images under constraints, which are not linear.
    """
    if choices.in_space or choices.model_based:
        return None
    setup = setup_of(scan, choices) if plan is None else plan.setup
    with warnings.catch_warnings():  # warned of where images are made
        warnings.simplefilter("ignore", AccuracyWarning)
        scan = without_blank_frames(scan, choices)
    found: list[RecordNoise] = []
    for k in range(scan.n_frames):
        noise = quiet_noise(scan, choices, setup, lit_frames(scan, choices, k, k + 1)[0])
        if noise is None:
            return None
        found.append(noise)
    sigmas = np.stack([np.asarray(noise.sigma) for noise in found])
    sizes = np.sqrt(np.mean(sigmas**2, axis=1))
    sigma = np.sqrt(np.mean((sigmas / sizes[:, None]) ** 2, axis=0))
    spectrum = np.mean([np.asarray(noise.spectrum) for noise in found], axis=0)
    common = RecordNoise(*jax.device_put((sigma, spectrum)))
    return sizes[:, None, None] * _of_unit_noise(scan, choices, setup, plan, common)


def quiet_noise(
    scan: Scan, choices: Choices, setup: Setup, frame: Real[np.ndarray, "detectors samples"]
) -> RecordNoise | None:
    """The noise of a frame before sound from the region arrives, of the detectors that are used.

    None for circular integrals, where no part of the record is quiet, and where that holds nothing.
    """
    times = shifted_times(scan, choices)
    if times is None:
        return None
    start = 2 * choices.dead_time or float(
        times[0]
    )  # what is silenced is faded in over as long again
    points, center = np.asarray(setup.curve.points), np.asarray(setup.region.center)
    nearest = np.linalg.norm(points - center, axis=1).min()
    arrival = float(nearest - setup.region.reach) / choices.path_speed
    if np.count_nonzero((times >= start) & (times < arrival)) < LEAST_SAMPLES:
        return None
    quiet = frame[list(choices.channels)].astype(float)
    noise = noise_of_record(quiet, times, until=arrival, dead_time=start)
    return noise if float(noise.sigma.max()) > 0 else None


def draw(
    scan: Scan, choices: Choices, noise: RecordNoise, key: Array
) -> Float[np.ndarray, "detectors samples"]:
    """A record of such noise, rows as in the file; zero where detectors are not used."""
    drawn = np.zeros((scan.n_detectors, scan.n_samples))
    drawn[list(choices.channels)] = noise.sample(key, scan.n_samples)
    return drawn


def _of_unit_noise(
    scan: Scan,
    choices: Choices,
    setup: Setup,
    plan: ReconstructionPlan | None,
    noise: RecordNoise,
) -> Float[np.ndarray, "x1 x2"]:
    """The root mean square of `DRAWN` images."""
    keys = jax.random.split(jax.random.key(0), DRAWN)
    total = np.zeros(setup.grid.shape)
    with warnings.catch_warnings():  # noise holds finer detail than any image
        warnings.simplefilter("ignore", AccuracyWarning)
        for start, size in frames_together(scan, DRAWN):
            records = np.stack(
                [draw(scan, choices, noise, key) for key in keys[start : start + size]]
            )
            g = integrals(scan, choices, setup, records)
            images = np.asarray(formula_images(setup, g, choices, plan))
            total += (images**2).sum(axis=0)
    return np.sqrt(total / DRAWN)
