"""A scan's images under constraints, fitted to what was recorded.

A pressure record is not made into integrals: the model goes through what the record went through,
since an image that may not be negative has the low frequencies that a band-pass took from it.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import real_array
from ..fitting import (
    Comparison,
    ModelBased,
    NoPenalty,
    Ridge,
    SecondOrderVariation,
    TotalVariation,
    compare_fits,
    model_based,
)
from ..geometry import data_radii
from ..io import Scan
from ..reconstruction import Setup
from ..records import apply_impulse_response
from .choices import Choices
from .facts import times_of
from .frames import has_baseline, in_band, integrals

PENALTIES = {
    "tv": TotalVariation,
    "second-order": SecondOrderVariation,
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
    recorded = _recorded(scan, choices, setup, frames)
    return model_based(
        recorded.setup,
        recorded.data,
        penalty=PENALTIES[choices.penalty](),
        nonnegative=choices.nonnegative,
        weight=choices.weight,
        tolerance=TOLERANCE,
        dtype=jnp.float32,
        progress=progress,
        **recorded.model,
    )


def compared(
    scan: Scan, choices: Choices, setup: Setup, frame: np.ndarray, first: Array, second: Array
) -> Comparison:
    """How well two images fit a frame, as `fitted` does it."""
    recorded = _recorded(scan, choices, setup, frame)
    return compare_fits(recorded.setup, recorded.data, first, second, **recorded.model)


class _Recorded(NamedTuple):
    """The data of a fit, and the other arguments of `model_based`."""

    setup: Setup
    data: Array
    model: dict[str, Any]


def _recorded(scan: Scan, choices: Choices, setup: Setup, frames: np.ndarray) -> _Recorded:
    times = times_of(scan)
    if times is None or choices.in_space:
        return _Recorded(setup, integrals(scan, choices, setup, frames), {})
    record = real_array(scan.kind, frames[..., list(choices.channels), :], None)
    radii = data_radii(setup.curve, setup.region, setup.grid.spacing.max())
    reaching = Setup(
        setup.curve, setup.region, setup.grid, radii, max_frequency=choices.max_frequency
    )
    path = choices.sound_speed * np.asarray(times)
    within = np.flatnonzero((path >= float(radii[0])) & (path <= float(radii[-1])))
    window = slice(*(within[[0, -1]] + [0, 1])) if within.size else slice(0)

    def windowed(record: Array, baseline: bool) -> Float[Array, "*batch detectors samples"]:
        return in_band(choices, record, times, baseline=baseline)[..., window]

    def as_recorded(pressure: Array) -> Array:
        if choices.impulse_response:
            response = scan.known["impulse_response"]  # its time 0 is in the middle
            pressure = apply_impulse_response(pressure, response, origin=len(response) // 2)
        return windowed(pressure, baseline=False)

    model = {
        "times": times,
        "sound_speed": choices.sound_speed,
        "model": choices.model,
        "conditioning": as_recorded,
    }
    return _Recorded(reaching, windowed(record, baseline=has_baseline(choices)), model)
