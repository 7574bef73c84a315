"""A scan's problem, and the integrals over circles or spheres that its frames are made into."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Num

from ..base.checks import is_concrete, real_array
from ..io import Scan
from ..reconstruction import OnLadder, Setup, on_ladder
from ..records import (
    apply_impulse_response,
    condition_record,
    pressure_to_circular_integrals,
    remove_impulse_response,
)
from ..records.pressure import without_mute
from ..spherical import pressure_to_spherical_integrals
from ..steps import TooFewDetectors
from .acquisition import facts_of, times_of
from .choices import IN_SPACE, Choices
from .space import facts_in_space

GROUPS = 2  # of frequencies, at most: for few images, compiling is what takes time


@contextmanager
def bounded_as_said(choices: Choices) -> Iterator[None]:
    """No warning of undersampled waves, unless they were asked for.

    The table says what bounds them.
    """
    with warnings.catch_warnings():
        if "max_frequency" not in choices.user_set:
            warnings.simplefilter("ignore", TooFewDetectors)
        yield


def setup_of(scan: Scan, choices: Choices, *, n_groups: int = GROUPS) -> Setup:
    """Detectors, region, pixels and radii, the same for all frames; in the plane or in space.

    Circular integrals keep the radii of their file. More ``n_groups`` of frequencies, see `Setup`,
    pay for many images.

    Raises, warns:
        As `Setup`.
    """
    own = scan.known.get("radii") if scan.kind == "circular_integrals" else None
    radii = choices.radii if own is None else real_array("radii", own, ("radii",))
    if choices.in_space:
        curve = facts_in_space(scan, choices.channels, choices.body_center).detectors
    else:
        curve = choices.curve(facts_of(scan).points)
    with bounded_as_said(choices):
        return Setup(
            curve,
            choices.region,
            choices.grid,
            radii,
            max_frequency=choices.max_frequency,
            medium=choices.medium,
            _n_groups=n_groups,
        )


def problem_of(scan: Scan, choices: Choices, *, n_groups: int = 1) -> OnLadder:
    """`setup_of` a scan in the plane in sizes that scans of its scanner share."""
    return on_ladder(setup_of(scan, choices), len(choices.order), n_groups=n_groups)


def lit_frames(
    scan: Scan, choices: Choices, start: int, stop: int
) -> Num[np.ndarray, "frames detectors samples"]:
    """Frames from ``start`` to ``stop`` - 1, over the energy of their pulses if that is chosen."""
    frames = np.asarray(scan.data[start:stop] if scan.data.ndim == 3 else scan.data[None])
    return per_energy(scan, choices, frames, slice(start, stop))


def per_energy(
    scan: Scan, choices: Choices, frames: np.ndarray, numbers: int | slice
) -> Num[np.ndarray, "*frames detectors samples"]:
    """Frames of these numbers, over the energy of their pulses if that is chosen.

    Light of twice the energy makes twice the pressure, so that images of several wavelengths can be
    compared only per energy.
    """
    if not choices.laser_energy:
        return frames
    return frames / scan.known["laser_energy"][numbers, None, None]


def shifted_times(scan: Scan, choices: Choices) -> Float[np.ndarray, " times"] | None:
    """Times of the samples of a pressure record, with the shift that was chosen."""
    times = times_of(scan)
    return None if times is None else times + choices.time_shift


def integrals(
    scan: Scan, choices: Choices, setup: Setup, frames: np.ndarray
) -> Float[Array, "..."]:
    """Integrals of frames over circles, or spheres, about the detectors that are used.

    Args:
        scan, choices: what the frames belong to.
        setup: of `setup_of`, or of a plan.
        frames: (..., detectors, samples), rows as in the file.

    Returns:
        (..., *setup.data_shape).
    """
    found = _integrals(scan, choices, setup.radii, frames)
    return found.reshape(*found.shape[:-2], *setup.data_shape)


def _integrals(scan: Scan, choices: Choices, radii: Array, frames: np.ndarray) -> Array:
    part = real_array(scan.kind, frames[..., list(choices.channels), :], None)
    times = shifted_times(scan, choices)
    if times is None:
        require_radii(part.shape[-1], radii.shape[0])
        return part
    part = conditioned(scan, choices, part, times, baseline=has_baseline(choices))
    speed = choices.path_speed
    if choices.model == IN_SPACE:
        return pressure_to_spherical_integrals(part, times, radii, sound_speed=speed)
    return pressure_to_circular_integrals(
        part, times, radii, sound_speed=speed, model=choices.model
    )


def conditioned(
    scan: Scan, choices: Choices, record: Array, times: Any, *, baseline: bool
) -> Array:
    """A pressure record with start, band and response as chosen; linear but for baselines."""
    record = in_band(choices, record, times, baseline=baseline)
    if choices.impulse_response:
        response, origin = element_responses(scan, choices)
        record = remove_impulse_response(record, times, response, origin=origin)
    return record


def through_elements(scan: Scan, choices: Choices, pressure: Array) -> Array:
    """Pressure as the elements record it, with their response if that is chosen."""
    if not choices.impulse_response:
        return pressure
    response, origin = element_responses(scan, choices)
    return apply_impulse_response(pressure, response, origin=origin)


def element_responses(scan: Scan, choices: Choices) -> tuple[np.ndarray, int]:
    """The impulse response of the file, or those of the channels, whose time 0 is in the middle."""
    response = scan.known.get("impulse_response")
    if response is None:
        raise ValueError(
            "the settings divide a response of the elements out, and the scan has none: give it "
            "(--element-band, --impulse-response; element_band or element_response of with_facts)."
        )
    response = response if response.ndim == 1 else response[list(choices.channels)]
    return response, response.shape[-1] // 2


def in_band(choices: Choices, record: Array, times: Any, *, baseline: bool) -> Array:
    """The record without its start and what is out of band, if that is chosen."""
    if not _is_conditioned(choices):
        return record
    if baseline and is_concrete(record):
        record = jax.device_put(without_mute(np.asarray(record)))
    return condition_record(
        record, times, dead_time=choices.dead_time, band=choices.band, baseline=baseline
    )


def has_baseline(choices: Choices) -> bool:
    """Whether offset and drift are taken off: the slow tail of 2-D waves is signal."""
    return _is_conditioned(choices) and choices.model == "in-plane"


def _is_conditioned(choices: Choices) -> bool:
    return choices.band is not None or bool(choices.dead_time)


def require_radii(of_data: int, of_setup: int) -> None:
    """Raise ValueError for integrals over more or fewer circles than a setup has."""
    if of_data != of_setup:
        raise ValueError(
            f"the data have {of_data} radii, the geometry has {of_setup}: name radii in the file, "
            "or choose --region-radius, --pixels and --half-width to match."
        )
