"""A scan's images under constraints, fitted to what was recorded.

A pressure record is not made into integrals: the model goes through what the record went through,
since an image that may not be negative has the low frequencies that a band-pass took from it.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import real_array
from ..constraints import (
    ModelBased,
    NoPenalty,
    Ridge,
    SecondOrderVariation,
    TotalVariation,
    Wavelets,
    model_based,
)
from ..geometry import data_radii
from ..io import Scan
from ..reconstruction import Setup
from ..records import apply_impulse_response, condition_record
from .choices import Choices
from .facts import times_of
from .frames import integrals

PENALTIES = {
    "tv": TotalVariation,
    "second-order": SecondOrderVariation,
    "wavelets": Wavelets,
    "ridge": Ridge,
    "none": NoPenalty,
}
TOLERANCE = 5e-4  # measured records hold no more


def fitted(
    scan: Scan, choices: Choices, setup: Setup, frames: np.ndarray, *, progress: bool = False
) -> ModelBased:
    """Images of frames, each fitted by itself.

    Args:
        scan, choices: what the frames belong to.
        setup: of `setup_of`.
        frames: (..., detectors, samples), rows as in the file.
        progress: show a progress bar.
    """
    options: dict[str, Any] = {
        "penalty": PENALTIES[choices.penalty](),
        "nonnegative": choices.nonnegative,
        "weight": choices.weight,
        "tolerance": TOLERANCE,
        "dtype": jnp.float32,
        "progress": progress,
    }
    times = times_of(scan)
    if times is None or choices.in_space:
        return model_based(setup, integrals(scan, choices, setup, frames), **options)
    record = real_array(scan.kind, frames[..., list(choices.channels), :], None)
    radii = data_radii(setup.curve, setup.region, setup.grid.spacing.max())
    reaching = Setup(
        setup.curve, setup.region, setup.grid, radii, max_frequency=choices.max_frequency
    )
    path = choices.sound_speed * np.asarray(times)
    window = np.flatnonzero((path >= float(radii[0])) & (path <= float(radii[-1])))
    in_plane = choices.model == "in-plane"  # the slow tail of 2-D waves is signal

    def conditioned(record: Array, baseline: bool) -> Float[Array, "*batch detectors samples"]:
        if choices.band is not None or choices.dead_time:
            record = condition_record(
                record, times, dead_time=choices.dead_time, band=choices.band, baseline=baseline
            )
        return record[..., window]

    def as_recorded(pressure: Array) -> Array:
        if choices.impulse_response:
            response = scan.known["impulse_response"]  # its time 0 is in the middle
            pressure = apply_impulse_response(pressure, response, origin=len(response) // 2)
        return conditioned(pressure, baseline=False)

    return model_based(
        reaching,
        conditioned(record, baseline=in_plane),
        times=times,
        sound_speed=choices.sound_speed,
        model=choices.model,
        conditioning=as_recorded,
        **options,
    )
