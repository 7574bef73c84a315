"""The settings of live images, from a setup of circular integrals or a scan and its choices."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ..base.checks import Numbers, real_array, require_positive
from ..geometry import Region
from ..io import Scan
from ..reconstruction import ReconstructionPlan, Setup
from ..reconstruction.setup import plane_of, require_complete
from ..scans import Choices, choose, setup_of
from ..scans.acquisition import times_of
from ..scans.frames import conditioned, has_baseline, in_band
from .moving_region import N_GROUPS, setup_within_reach
from .samples import Pressure, pressure_of, record_end


class LiveSettings(NamedTuple):
    """Settings of a `Live`, with the names of its attributes."""

    setup: Setup
    region: Region
    rule: Any
    low_pass: Any
    frame_shape: tuple[int, int]
    sound_speed: float = 1.0
    energy: float = 1.0
    rows: tuple[int, ...] | None = None
    time_shift: float = 0.0
    pressure: Pressure | None = None
    pressure_at: Callable[[float], Pressure] | None = None
    leveled: bool = False


def of_setup(setup: Setup, rule: Any, low_pass: Any, reach: Numbers | None) -> LiveSettings:
    _, region, _, _ = plane_of(setup)  # not in space
    require_complete(setup)
    n_detectors, n_radii = setup.data_shape
    if reach is not None:
        setup = setup_within_reach(setup, reach, None)
    return LiveSettings(setup, region, rule, low_pass, (int(n_detectors), int(n_radii)))


def of_scan(
    scan: Scan, choices: Choices | None, plan: ReconstructionPlan | None, reach: Numbers | None
) -> LiveSettings:
    choices = choose(scan) if choices is None else choices
    _require_formula(choices)
    _require_elements_alike(scan, choices)
    setup = setup_of(scan, choices, n_groups=N_GROUPS) if plan is None else plan.setup
    require_complete(setup)
    pressure_at = _pressure_at(scan, choices)
    pressure = None if pressure_at is None else pressure_at(choices.time_shift).multiplied()
    speed, region = speed_of(choices.path_speed), setup.region
    if reach is not None:
        setup = setup_within_reach(setup, reach, record_end(pressure, speed))
    return LiveSettings(
        setup=setup,
        region=region,
        rule=choices.alpha,
        low_pass=choices.low_pass,
        frame_shape=(scan.n_detectors, scan.n_samples),
        sound_speed=speed,
        energy=float(np.mean(scan.known["laser_energy"])) if choices.laser_energy else 1.0,
        rows=_rows_of(choices, scan.n_detectors),
        time_shift=float(choices.time_shift),
        pressure=pressure,
        pressure_at=pressure_at,
        leveled=pressure is not None and has_baseline(choices),
    )


def speed_of(speed: Numbers) -> float:
    value = real_array("sound_speed", speed, ())
    require_positive("sound_speed", value)
    return float(value)


def _pressure_at(scan: Scan, choices: Choices) -> Callable[[float], Pressure] | None:
    """The conditioning of a record by what is added to its times; None for circular integrals.

    Of it only what silences the start depends on that.
    """
    times = times_of(scan)
    if times is None:
        return None
    heard, silenced = replace(choices, dead_time=0.0), replace(choices, band=None)
    filtered = conditioned(scan, heard, jnp.eye(len(times)), times, baseline=False)

    def at(time_shift: float) -> Pressure:
        later = jnp.asarray(times + time_shift)
        mute = in_band(silenced, jnp.ones((1, len(times))), later, baseline=False)[0]
        return pressure_of(later, choices.model, filtered, mute)

    return at


def _require_elements_alike(scan: Scan, choices: Choices) -> None:
    if choices.impulse_response and np.ndim(scan.known.get("impulse_response", 0)) == 2:
        raise ValueError(
            "every element has a response of its own, and live images take one of all: take them "
            "out of the record (records.remove_impulse_response), or let reconstruct fit it."
        )


def _rows_of(choices: Choices, n_detectors: int) -> tuple[int, ...] | None:
    rows = choices.channels
    return None if rows == tuple(range(n_detectors)) else rows


def _require_formula(choices: Choices) -> None:
    if choices.in_space:
        raise ValueError("the scan is in space, and live images are in the plane.")
    if choices.model_based:
        raise ValueError(
            "the choices ask for a fit under constraints, which takes its time: live images are by "
            "the formula."
        )
