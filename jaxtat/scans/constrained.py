"""A scan's images under constraints, fitted to what was recorded.

A pressure record is not made into integrals: the model goes through what the record went through,
since an image that may not be negative has the low frequencies that a band-pass took from it.
"""

import warnings
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..base.checks import real_array
from ..base.size_ladder import filled_up, rung
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
from ..geometry import BallBody, data_radii, radial_step
from ..io import Scan
from ..reconstruction import Setup
from ..reconstruction.laddered import around, middle, setup_to_fit
from ..records import ranges
from ..spherical import cap_radii
from ..steps import AccuracyWarning
from .choices import Choices
from .frames import (
    bounded_as_said,
    element_responses,
    has_baseline,
    in_band,
    integrals,
    shifted_times,
    through_elements,
)

PENALTIES = {
    "tv": TotalVariation,
    "second-order": SecondOrderVariation,
    "ridge": Ridge,
    "none": NoPenalty,
}
HARDLY_ANY = 0.9  # share of a record that is unexplained, from which images show nothing of it
TOLERANCE, TOLERANCE_IN_SPACE = 2e-2, 2.5e-2  # measured records hold no more
TOLERANCE_OF_SHORT = 2e-3  # what a record does not hold is found slowly, from the constraints


def fitted(
    scan: Scan,
    choices: Choices,
    setup: Setup,
    frames: np.ndarray,
    *,
    initial: Array | None = None,
    tolerance: float | None = None,
    max_steps: int = 500,
    progress: bool = False,
) -> ModelBased:
    """Images of frames, each fitted by itself.

    Args:
        scan, choices: what the frames belong to.
        setup: of `setup_of`.
        frames: (..., detectors, samples), rows as in the file.
        initial: volumes to start from, as in `model_based`.
        tolerance, max_steps: as in `model_based`; 2e-2, in space 2.5e-2, of records that end early
            2e-3.
        progress: show a progress bar.
    """
    recorded = _recorded(scan, choices, setup, frames)
    if tolerance is None:
        usual = TOLERANCE_IN_SPACE if choices.in_space else TOLERANCE
        tolerance = usual if recorded.whole else TOLERANCE_OF_SHORT
    found = model_based(
        recorded.setup,
        recorded.data,
        penalty=PENALTIES[choices.penalty](),
        nonnegative=choices.nonnegative,
        weight=choices.weight,
        max_frequency=float(choices.max_frequency) if "times" in recorded.model else None,
        tolerance=tolerance,
        max_steps=max_steps,
        initial=initial,
        dtype=jnp.float32,
        progress=progress,
        **recorded.model,
    )
    if choices.in_space:
        return found
    image = jax.device_put(middle(found.image, setup.grid.shape))
    return eqx.tree_at(lambda found: found.image, found, image)


def warn_of_hardly_any(
    left: Float[np.ndarray, " frames"], numbers: Int[np.ndarray, " frames"]
) -> None:
    """Warn whoever called the caller of fitted images with hardly anything of what was recorded.

    Args:
        left: share of each record that its image leaves unexplained.
        numbers: of these frames in the file.
    """
    empty = np.asarray(left) > HARDLY_ANY
    if not empty.any():
        return
    several = len(empty) > 1
    which = f"images of frames {ranges(numbers[empty])} leave" if several else "image leaves"
    warnings.warn(
        f"the fitted {which} {float(np.max(left)):.0%} of the record unexplained: nearly all of it "
        "is noise, or the weight of the penalty is too large for it. Compare with the formula's "
        "image (--direct), or give a smaller --weight.",
        AccuracyWarning,
        stacklevel=3,
    )


def compared(
    scan: Scan, choices: Choices, setup: Setup, frame: np.ndarray, first: Array, second: Array
) -> Comparison:
    """How well two images fit a frame, as `fitted` does it."""
    recorded = _recorded(scan, choices, setup, frame)
    both = first, second
    if not choices.in_space:
        both = (around(image, recorded.setup.grid.shape) for image in both)
    return compare_fits(recorded.setup, recorded.data, *both, **recorded.model)


class _Recorded(NamedTuple):
    """The data of a fit, the other arguments of `model_based`, and whether all sound is in them."""

    setup: Setup
    data: Array
    model: dict[str, Any]
    whole: bool


def of_all_sound(setup: Setup, choices: Choices) -> Setup:
    """The same with the radii of all sound from the region, whatever the record holds of it."""
    medium = setup.medium
    step = radial_step(np.asarray(setup.grid.spacing).max(), medium)
    radii = data_radii(setup.curve, setup.region, step, medium=medium)
    where = setup.curve, setup.region, setup.grid
    with bounded_as_said(choices):
        return Setup(*where, radii, max_frequency=choices.max_frequency, medium=medium)


def _recorded(scan: Scan, choices: Choices, setup: Setup, frames: np.ndarray) -> _Recorded:
    times = shifted_times(scan, choices)
    if choices.in_space and times is not None:
        return _recorded_in_space(scan, choices, setup, frames, times)
    if choices.in_space:
        return _Recorded(setup, integrals(scan, choices, setup, frames), {}, setup.complete)
    n_detectors = len(choices.order)
    if times is None:
        larger = setup_to_fit(setup, n_detectors)
        g = integrals(scan, choices, setup, frames)
        return _Recorded(larger, *_masked(g, larger.data_shape), setup.complete)
    record = real_array(scan.kind, frames[..., list(choices.channels), :], None)
    reaching = of_all_sound(setup, choices)
    radii = np.asarray(reaching.radii)
    larger, n_radii = setup_to_fit(reaching, n_detectors), len(radii)
    path = choices.path_speed * np.asarray(times)
    within = np.flatnonzero((path >= radii[0]) & (path <= radii[-1]))
    window = slice(int(within[0]), int(within[-1]) + 1) if within.size else slice(0, 0)
    n_samples = rung(window.stop - window.start)

    def windowed(record: Any, baseline: bool) -> Float[np.ndarray, "*batch detectors samples"]:
        return np.asarray(in_band(choices, record, times, baseline=baseline))[..., window]

    responses = _of_each(scan, choices, larger.curve.n_detectors)

    def as_recorded(pressure: Array) -> Array:
        if responses is None:  # a row for each radius, of which the last only fill up
            pressure = through_elements(scan, choices, pressure)
        n_rows = n_radii if responses is None else None
        kept = windowed(pressure, baseline=False)[:n_rows]
        return jax.device_put(filled_up(kept, (pressure.shape[0], n_samples)))

    model = {
        "times": times,
        "sound_speed": choices.sound_speed if setup.medium is None else 1.0,  # else the body's
        "model": choices.model,
        "conditioning": as_recorded,
        "element_responses": responses,
    }
    recorded = windowed(record, baseline=has_baseline(choices))
    data, mask = _masked(recorded, (larger.curve.n_detectors, n_samples))
    whole = bool(path[-1] >= radii[-1])
    return _Recorded(larger, data, model | mask, whole)


def _recorded_in_space(
    scan: Scan, choices: Choices, setup: Setup, frames: np.ndarray, times: np.ndarray
) -> _Recorded:
    """Samples in which sound from the region arrives, means of as many as resolve half a voxel."""
    path = choices.path_speed * times
    distance, reach = np.asarray(setup.curve.distance), choices.region_radius
    first, last = float(distance.min()) - reach, float(distance.max()) + reach
    half_voxel, medium = float(setup.grid.spacing.max()) / 2, setup.medium
    if isinstance(medium, BallBody):
        first, last = cap_radii(setup.curve, setup.region, half_voxel, medium)[jnp.array([0, -1])]
    within = np.flatnonzero((path >= first) & (path <= last))
    together = max(1, int(half_voxel * (len(path) - 1) / (path[-1] - path[0])))
    n = within.size // together

    def means(record: Any) -> Array:
        record = in_band(choices, record, times, baseline=False)
        part = jnp.asarray(record)[..., within[: n * together]]
        return part.reshape(*part.shape[:-1], n, together).mean(axis=-1)

    record = real_array(scan.kind, frames[..., list(choices.channels), :], None)
    data = means(record)
    data = data.reshape(*data.shape[:-2], *setup.detectors_shape, n)
    speed = choices.sound_speed if medium is None else 1.0  # else the body's
    model = {"times": times, "sound_speed": speed, "conditioning": means}
    if choices.impulse_response:
        response, _ = element_responses(scan, choices)
        shape = *setup.detectors_shape, response.shape[-1]
        each = np.broadcast_to(response, (len(choices.channels), shape[-1]))
        model["element_responses"] = each.reshape(shape)
    return _Recorded(setup, data, model, bool(path[-1] >= last))


def _of_each(scan: Scan, choices: Choices, n_detectors: int) -> np.ndarray | None:
    """Responses of elements in the plane if each has its own, filled up with zeros."""
    if not choices.impulse_response:
        return None
    response, _ = element_responses(scan, choices)
    return None if response.ndim == 1 else filled_up(response, (n_detectors, response.shape[-1]))


def _masked(data: Any, shape: tuple[int, ...]) -> tuple[Array, dict[str, Any]]:
    """Data filled up to a larger shape, and the mask that leaves out what is not theirs."""
    known = np.asarray(data)
    mask = filled_up(np.ones(known.shape[-2:], bool), shape)
    larger = filled_up(known, (*known.shape[:-2], *shape))
    return jax.device_put(larger), {"mask": mask}
