"""Highest frequency, pixels and pass band, by what detectors, record and pixels hold."""

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.choice_table import LIKELY, SURE
from ..base.units import ROUNDING
from ..geometry import DetectorCurve, Region, detector_curve, keep_detectors, require_outside
from ..io import Scan
from ..records import Supported, supported
from ..records.signal_power import highest_frequency
from ..spherical.sizes import resolved_frequency
from ..steps import TooFewDetectors
from .acquisition import typical_frame
from .choices import Choices, plane_region
from .estimate import Estimate
from .medium import path_speed, slowest
from .parameters import Parameters
from .preprocess import Acquisition, AcquisitionInSpace
from .space import facts_in_space

PIXELS, VOXELS = (65, 1025), (17, 129)  # along an axis, if none are given
FITTED = 513  # pixels at most where there is no formula: half a minute's work
SAMPLED = 0.5  # share of the region's radius, within which the detectors sample all that is wanted
PIXELS_PER_DETAIL = 2.0  # in half the shortest wave
FEWEST_DETAILS = 8  # across a region, below which an image hardly shows anything
DRIFT = 5.0  # periods within the record; what is slower is drift
BAND_TO_SPARE = 2.0  # the filter's upper edge over the image's highest frequency
# times the lambda_max that the detectors' spacing tells, and pixels or voxels for that at most
FINER, FINER_PIXELS, FINER_VOXELS = 2.0, 257, 65
SPACING = "the detectors' spacing in the inner half of the region"
FINER_THAN_SPACING = f"{FINER:g} times what the detectors' spacing tells"
BY_RECORD = "what the record holds above its noise"

Where = tuple[DetectorCurve, Region]


def where_of(record: Acquisition, p: Parameters) -> Where:
    """Curve of the detectors that are used, and region."""
    curve, region = detector_curve(record.points), plane_region(p.values)
    if not record.good.all():
        curve = keep_detectors(curve, record.good)
    require_outside(curve.points, region)
    return curve, region


def first_arrival(record: Acquisition, p: Parameters) -> float:
    """When sound from the region first reaches a detector [time]."""
    offset = np.abs(record.points - np.array(p["region_center"]))
    off = np.hypot(*offset.T) - p["region_radius"]
    if p["region_size"] is not None:
        off = np.hypot(*np.maximum(offset - np.array(p["region_size"]) / 2, 0.0).T)
    return max(float(off.min()), 0.0) / path_speed(p)


def expecting(p: Parameters, missing: str) -> Parameters:
    """Images are fitted where data are missing, in words; "" for none."""
    if not missing:
        return p
    return p.replaced(model_based=Estimate(True, f"there is no formula: {missing}"))


def resolution_in_plane(record: Acquisition, p: Parameters) -> Parameters:
    """lambda_max by detectors, band and pixels, whichever is least, and the pixels by it."""
    speed = path_speed(p) * slowest(p)
    where = where_of(record, p)
    support = supported(*where, record.times, sound_speed=speed)
    require_record(support, speed, 0.5 * (float(support.end) - float(support.reach_of_end)))
    if support.ends_early:
        p = expecting(p, support.shortfalls[0])
    sampled = _of_inner_half(support)
    _warn_of_few_details(p, len(where[0].points), sampled)
    rounding = 1e-6 * (record.times[1] - record.times[0])  # the same samples in any unit
    start = int(np.searchsorted(record.times, record.begin - rounding))
    arrival = int(np.searchsorted(record.times, first_arrival(record, p) - rounding))
    quiet = max(arrival - start, 0)
    heard, times = record.heard[:, start:], record.times[start:]
    highest = highest_frequency(heard, times, slice(0, quiet))
    in_body = 2 * np.pi / float(p["sound_speed"])
    most, why = p.given.get("pixels"), "the pixels given"
    if most is None:
        most = FITTED if "model_based" in p.estimates else PIXELS[1]
        why = f"{most} pixels, the most that are taken"
    per_pixel = np.pi / (2 * float(p["half_width"]))
    limit = least(
        _of_spacing(sampled, per_pixel),
        Estimate(in_body * highest, BY_RECORD, LIKELY),
        Estimate(per_pixel * max(most - 1, 1), why, LIKELY),
    )
    p = _with_highest(p, limit)
    across = 2 * float(p["half_width"]) * p["max_frequency"] / np.pi * PIXELS_PER_DETAIL
    n = int(np.clip(2 * (int(np.ceil(across)) // 2) + 1, PIXELS[0], most))
    data = {"detail": np.pi / p["max_frequency"], "n": (n - 1) * PIXELS_PER_DETAIL / across}
    return p.with_(pixels=Estimate(n, "details of {detail:length 3} in {n:.2g} pixels", data=data))


def _of_inner_half(support: Supported) -> float:
    return float(support.frequency_of_detectors) / SAMPLED


def sampled_by_detectors(curve: DetectorCurve, region: Region, times: Any) -> float:
    """The highest frequency that the detectors' spacing samples [rad/length].

    Args:
        curve: of the detectors that are used.
        times: of the record [time].
    """
    return _of_inner_half(supported(curve, region, times, sound_speed=1.0))


def _of_spacing(sampled: float, per_pixel: float) -> Estimate:
    """What the detectors' spacing samples; twice that for images of few pixels [rad/length].

    Between detectors that are far apart the constraints of fits tell more than the spacing does,
    and errors of the formula hardly change.

    Args:
        sampled: up to where the detectors sample waves [rad/length].
        per_pixel: highest frequency that one more pixel would hold [rad/length].
    """
    twice = Estimate(FINER * sampled, FINER_THAN_SPACING)
    of_few = per_pixel * (FINER_PIXELS - 1) / PIXELS_PER_DETAIL
    finer = least(twice, Estimate(of_few, f"{FINER_PIXELS} pixels, for detectors so far apart"))
    return finer if finer.value > sampled else Estimate(sampled, SPACING)


def least(*limits: Estimate) -> Estimate:
    """The limit that decides [rad/length]."""
    return min(limits, key=lambda limit: limit.value)


def require_record(support: Supported, speed: float, end: float) -> None:
    """Raise ValueError for a record that ends before a radius of its integrals [length]."""
    if support.ends_early and float(support.end) < end:
        raise ValueError(
            f"{support.shortfalls[0]}. Check that positions, times and sound speed ({speed:.6g}) "
            "are in units that fit each other."
        )


def _warn_of_few_details(p: Parameters, n_detectors: int, highest: float) -> None:
    """Say that so few detectors show hardly anything of the region."""
    detail, size = np.pi / highest, 2 * float(p["region_radius"])
    if detail * FEWEST_DETAILS > size:
        length = p.units.of_length
        needed = int(np.ceil(n_detectors * detail * FEWEST_DETAILS / size))
        warnings.warn(
            f"{n_detectors} detectors show details of {length(detail, 3)} at best, and the region "
            f"is {length(size, 3)} across: too few for an image. About {needed} are needed for "
            f"{FEWEST_DETAILS} details across it.",
            TooFewDetectors,
            stacklevel=5,
        )


def _with_highest(p: Parameters, limit: Estimate) -> Parameters:
    """With lambda_max, by default what decides it; a given one above that is said to be so.

    Raises:
        ValueError: for waves longer than the region, unless they were asked for.
    """
    p = p.with_(max_frequency=limit)
    highest, size = p["max_frequency"], 2 * p["region_radius"]
    if math.pi / highest > size and not p.gives("max_frequency"):
        raise ValueError(
            f"with {limit.why} details are {math.pi / highest:.3g} (lambda {highest:.4g}), more "
            f"than the whole region, {size:.3g} across. Check that positions, times and sound "
            "speed are in units that fit each other, or give max_frequency."
        )
    if highest <= limit.value:
        return p
    why = f"; {limit.why} supports {{limit:wave_number}}"
    return p.replaced(max_frequency=p.estimates["max_frequency"].but(why, SURE, limit=limit.value))


def band(record: Acquisition, p: Parameters) -> Parameters:
    """Without drift and what is beyond the image."""
    if isinstance(p.given.get("band"), str):
        return p.replaced(band=Estimate(None, "given"))
    if p["model"] != "in-plane":
        why = "the slow tail of two-dimensional waves is signal"
        return p.with_(band=Estimate(None, why, LIKELY))
    why = "slower is drift, faster is beyond {spare:g} times what the image holds"
    times, fastest = record.times, p["max_frequency"] * path_speed(p) / (2 * np.pi)
    low = DRIFT / float(times[-1] - times[0])
    high = min(max(BAND_TO_SPARE * fastest, 2 * low), 0.45 / float(times[1] - times[0]))
    return p.with_(band=Estimate((low, high), why, LIKELY, data={"spare": BAND_TO_SPARE}))


def resolution_in_space(record: AcquisitionInSpace, p: Parameters) -> Parameters:
    """lambda_max by detectors, samples and voxels, whichever is least, and the voxels by it."""
    scan, facts = record.scan, record.facts
    possible = resolved_frequency(facts.detectors, p["region_radius"])
    limits = [Estimate(float(possible), "the detectors' spacing")]
    if facts.times is not None:
        limits.append(_of_record(record, p.values))
    elif "radii" in scan.known:
        of_radii = np.pi / float(np.diff(scan.known["radii"]).max())
        limits.append(Estimate(of_radii, "the radii's spacing"))
    asked = p.given.get("pixels")
    most, why = (asked, "the pixels given") if asked else (VOXELS[1], f"{VOXELS[1]} voxels")
    limit = least(*limits, Estimate(np.pi * (most - 1) / (2 * p["half_width"]), why))
    p = _with_highest(p, limit)
    highest = float(p["max_frequency"])
    data = {"detail": np.pi / highest}
    pixels = _voxels(p["half_width"], highest)
    return p.with_(pixels=Estimate(pixels, "details of {detail:length 3}", data=data))


def _of_record(record: AcquisitionInSpace, values: Mapping[str, Any]) -> Estimate:
    """Up to where the record holds more than noise, by values of choices [rad/length]."""
    assert record.listened is not None and record.facts.times is not None
    quiet = slice(0, int(np.searchsorted(record.facts.times, record.arrival(values))))
    highest = highest_frequency(record.listened, record.facts.times, quiet)
    return Estimate(2 * np.pi * highest / values["sound_speed"], BY_RECORD)


def _voxels(half_width: float, highest: float) -> int:
    """Voxels across, an odd number, for waves up to lambda_max."""
    across = int(np.ceil(2 * half_width * highest / np.pi - 1e-6))
    return int(np.clip(2 * -(-across // 2) + 1, *VOXELS))


def with_waves_of_fit(scan: Scan, choices: Choices) -> Choices:
    """A fit in space with shorter waves than the detectors' spacing samples.

    f >= 0 and total variation tell these, up to what the record and 65 voxels hold: all volumes
    of the benchmark are nearer to the truth with them (docs/automatic_choices.md).

    Args:
        scan, choices: of a pressure record; others than such fits stay as they are, and a given
            max_frequency.
    """
    if not choices.in_space or "max_frequency" in choices.user_set:
        return choices
    facts = facts_in_space(scan, choices.channels, choices.body_center)
    alone = float(resolved_frequency(facts.detectors, choices.region_radius))
    if choices.max_frequency < alone * (1 - ROUNDING):  # what the record or the voxels hold
        return choices
    record = AcquisitionInSpace(scan, facts, typical_frame(scan)[facts.order])
    given = "pixels" in choices.user_set
    most = choices.pixels if given else max(choices.pixels, FINER_VOXELS)
    limit = least(
        Estimate(FINER * alone, FINER_THAN_SPACING),
        _of_record(record, choices.settings()),
        Estimate(np.pi * (most - 1) / (2 * choices.half_width), f"{most} voxels"),
    )
    finer = replace(choices, max_frequency=max(limit.value, choices.max_frequency))
    finer = finer.with_reason("max_frequency", limit.why, LIKELY)
    return finer if given else _with_voxels(finer)


def _with_voxels(choices: Choices) -> Choices:
    """With the voxels of its waves, and radii as much finer."""
    pixels = _voxels(choices.half_width, choices.max_frequency)
    n = 1 + math.ceil((choices.n_radii - 1) * (pixels - 1) / (choices.pixels - 1))
    step = choices.radial_step * (choices.n_radii - 1) / (n - 1)
    detail = choices.units.of_length(math.pi / choices.max_frequency, 3)
    finer = replace(choices, pixels=pixels, n_radii=n, radial_step=step)
    return finer.with_reason("pixels", f"details of {detail}", choices.grade("pixels"))
