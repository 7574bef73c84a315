"""The automatic choices for a scan in space, fewer than in the plane.

The region is a ball about the sphere's centre, or its part that the cap sees. Detectors without
data are left out where the others are on whole rings, or few enough to lie anywhere.
"""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from ..base.choice_table import GUESSED, LIKELY
from ..geometry import DetectorPoints, ball, uncovered
from ..io import Scan
from ..records import ranges, supported
from ..records.signal_power import highest_frequency, noise_before, record_power
from ..records.source_extent import sounding_disk
from ..spherical import cap_radii
from ..spherical.sizes import resolved_frequency
from .acquisition import typical_frame
from .choices import IN_SPACE, Choices, at_speed
from .found import (
    DEFAULT_SHARE,
    INTEGRALS_ALPHA,
    RIM,
    SHARES,
    Found,
    Limit,
    covered,
    least,
    radii_of,
    require_detail,
    require_end,
    require_scale,
    slowest,
    take_nominal_speed,
)
from .hearing import heard_after
from .opposite_detectors import speed_in_space
from .space import MOST_POINTS, FactsInSpace, facts_in_space

MARGIN = 1.4  # of the region beyond where sound comes from: sound from the rims of balls is weak
VOXELS = (17, 129)  # along an axis, if none are given
SHOWN = 8  # rows, at most, that a message names
LISTENED = 512  # detectors, at most, by which noise is judged
UNKNOWN_NOISE = 1e-3  # alpha of a record that starts with sound
_NOT_HERE = ("time_shift", "region_angle", "region_center", "region_size", "model")


def choices_in_space(scan: Scan, given: Mapping[str, Any]) -> Choices:
    """All choices for a scan in space; see `choosing.choose`."""
    for name in _NOT_HERE:
        if given.get(name) is not None:
            raise ValueError(
                f"--{name.replace('_', '-')}: the detectors lie in space, around a ball about "
                "their own centre; there is no choice."
            )
    facts, silent = _facts_with_sound(scan, given.get("use"))
    facts = facts._replace(units=facts.units.in_length(given.get("length_unit")))
    frame = typical_frame(scan)[facts.order]
    center = tuple(float(x) for x in np.asarray(facts.detectors.center))
    left_out = tuple(int(k) for k in silent)
    values: dict[str, Any] = {"order": (*(int(k) for k in facts.order), *left_out)}
    values["left_out"] = left_out
    values |= {"region_center": center, "region_angle": 0.0, "region_size": None}
    values["units"] = facts.units
    found = Found(given, values, {}, {}, set(), {})
    if left_out:
        why = f"{facts.arrangement}; left out: {ranges(silent)} recorded nothing, or NaN"
        found.explain("channels", why, LIKELY)
    else:
        found.explain("channels", facts.arrangement)
    _sound(scan, facts, found)
    _region(scan, facts, found, frame)
    record = None if facts.times is None else frame[:: -(-len(frame) // LISTENED)]
    _resolution(scan, facts, found, record)
    _radii(scan, facts, found)
    _noise(facts, found, record)
    found.take_laser_energy(scan)
    found.take("inversion", "fourier", "the faster way to the same image")
    found.require_body_speed(scan.kind)
    found.take_body()
    found.take_constraints(scan.kind)
    made = found.choices()
    return with_speed_in_space(scan, made) if "sound_speed" in found.to_estimate else made


def _facts_with_sound(scan: Scan, use: Any) -> tuple[FactsInSpace, np.ndarray]:
    """Facts of the detectors with data, and the rows of the others.

    Raises:
        ValueError: where the detectors with data are on no whole rings and too many to be anywhere.
    """
    facts = facts_in_space(scan, use)
    frame = typical_frame(scan)[facts.order]
    known = np.isfinite(frame)
    silent = ~known.all(axis=1) | (np.ptp(np.where(known, frame, 0.0), axis=1) == 0)
    if not silent.any():
        return facts, np.array([], int)
    rows = np.sort(facts.order[silent])
    try:
        return facts_in_space(scan, np.sort(facts.order[~silent])), rows
    except ValueError as error:
        shown = ", ".join(map(str, rows[:SHOWN])) + (", ..." if len(rows) > SHOWN else "")
        raise ValueError(
            f"{len(rows)} of {len(frame)} detectors recorded nothing, or NaN (rows {shown}), and "
            "the others are on no whole rings. Fill their rows by interpolation along their "
            "rings, or choose detectors without them with --use: whole rings, or any up to "
            f"{MOST_POINTS}."
        ) from error


def _sound(scan: Scan, facts: FactsInSpace, found: Found) -> None:
    if facts.times is None:
        found.values.update(model="none", sound_speed=1.0, time_shift=0.0, dead_time=0.0, band=None)
        found.values["impulse_response"] = False
        return
    found.take("model", IN_SPACE, "detectors in space, around a volume")
    take_nominal_speed(scan, found, facts.units)
    found.take("time_shift", 0.0, "as the file says")
    found.take("dead_time", 0.0, "the record is taken as it is", LIKELY)
    if found.given.get("band") == "none":
        found.values["band"] = None
        found.explain("band", "given")
    else:
        found.take("band", None, "the record is taken as it is", LIKELY)
    there = "impulse_response" in scan.known
    found.take("impulse_response", there, "in the file" if there else "none in the file")


def _region(scan: Scan, facts: FactsInSpace, found: Found, frame: np.ndarray) -> None:
    share, why, grade = (
        DEFAULT_SHARE * facts.radius,
        "three quarters of the detectors' sphere",
        GUESSED,
    )
    if facts.times is not None:
        path = float(facts.times[-1]) * found.values["sound_speed"]
        if found.given.get("region_radius") is None:
            require_scale(path, facts.radius, found.values["sound_speed"])
        reach = _sounding(scan, facts, found, frame)
        if reach is not None and MARGIN * reach < share:
            share, grade = max(MARGIN * reach, SHARES[0] * facts.radius), LIKELY
            length = facts.units.of_length
            why = f"sound comes from within {length(reach)}, and {MARGIN - 1:.0%} to spare"
        path *= slowest(found)
        if path - facts.radius < share:
            share, why, grade = path - facts.radius, "as much as the record covers", GUESSED
    share, why = covered(found, share, why, radii_of(scan, found), np.array([facts.radius]))
    radius = float(found.take("region_radius", share, why, grade))
    cut, why = radius, "all of the ball"
    if not isinstance(facts.detectors, DetectorPoints):
        top = facts.radius * float(np.cos(float(facts.detectors.half_opening)))
        if top < radius and found.given.get("region_radius") is None:
            cut, why = top, "what lies beyond the cap's rim is not seen"
    found.take("region_cut", cut, why)
    found.take("half_width", radius, "the region", grade)


def _sounding(scan: Scan, facts: FactsInSpace, found: Found, frame: np.ndarray) -> float | None:
    """Radius about the middle from which sound comes, by its times; None if unknown."""
    assert facts.times is not None
    quieted = frame - np.median(frame, axis=1, keepdims=True)
    arrival = facts.radius / found.values["sound_speed"]
    when = heard_after(-np.inf, quieted, facts.times, arrival, detrend=False)
    if not when.tells:
        return None
    points = np.asarray(scan.known["detectors"], float)[facts.order]
    center = np.asarray(facts.detectors.center)
    known = "sound_speed" not in found.to_estimate
    body = sounding_disk(points - center, when, found.values["sound_speed"], known)
    return body.reach


def with_speed_in_space(scan: Scan, choices: Choices) -> Choices:
    """Choices with the speed of sound at which opposite detectors agree, or water's."""
    found = speed_in_space(scan, choices)
    error = found.standard_error
    error = None if error is None else choices.sound_speed * error
    why = f"{found.why}; none in the file" if error is not None else f"water's: {found.why}"
    at = at_speed(choices, found.stretch)
    return at.with_reason("sound_speed", why, found.grade, error)


def _arrival(facts: FactsInSpace, found: Found) -> float:
    """When sound from the region first reaches a detector [time]."""
    return (facts.radius - found.values["region_radius"]) / found.values["sound_speed"]


def _resolution(scan: Scan, facts: FactsInSpace, found: Found, record: np.ndarray | None) -> None:
    """lambda_max by detectors, samples and voxels, whichever is least, and the voxels by it."""
    radius, half_width = found.values["region_radius"], found.values["half_width"]
    possible = resolved_frequency(facts.detectors, radius)
    limits = [Limit(float(possible), "the detectors' spacing")]
    if record is not None and facts.times is not None:
        quiet = slice(0, max(int(np.searchsorted(facts.times, _arrival(facts, found))), 0))
        highest = highest_frequency(record, facts.times, quiet)
        of_record = 2 * np.pi * highest / found.values["sound_speed"]
        limits.append(Limit(of_record, "what the record holds above its noise"))
    elif "radii" in scan.known:
        of_radii = np.pi / float(np.diff(scan.known["radii"]).max())
        limits.append(Limit(of_radii, "the radii's spacing"))
    asked = found.given.get("pixels")
    most, why = (asked, "the pixels given") if asked else (VOXELS[1], f"{VOXELS[1]} voxels")
    limit = least(*limits, Limit(np.pi * (most - 1) / (2 * half_width), why))
    highest = float(found.take("max_frequency", *limit))
    require_detail(found, highest, limit.why)
    across = int(np.ceil(2 * half_width * highest / np.pi - 1e-6))
    pixels = int(np.clip(2 * -(-across // 2) + 1, *VOXELS))
    found.take("pixels", pixels, f"details of {facts.units.of_length(np.pi / highest, 3)}")


def _radii(scan: Scan, facts: FactsInSpace, found: Found) -> None:
    """Radii of the file, or all that the record covers, half a voxel apart."""
    own, radius, cut = (
        radii_of(scan, found),
        found.values["region_radius"],
        found.values["region_cut"],
    )
    region = ball(radius, cut if cut < radius else None, center=facts.detectors.center)
    disk = facts.detectors.meridian, region.meridian
    if facts.times is not None:
        speed = found.values["sound_speed"]
        require_end(supported(*disk, facts.times, sound_speed=speed), speed)
    if own is None:
        step = float(found.values["half_width"]) / (int(found.values["pixels"]) - 1)
        end = np.inf
        if facts.times is not None:
            end = float(facts.times[-1]) * found.values["sound_speed"]
        reach = min(RIM * facts.radius, end - step - facts.radius)
        sources = ball(reach, center=region.center) if reach > 0 else None
        own = np.asarray(cap_radii(facts.detectors, region, step, sources=sources))
        own = own[own <= end]
    else:
        found.expect(uncovered(*disk, jax.device_put(own)))
    found.take_radii(own)


def _noise(facts: FactsInSpace, found: Found, record: np.ndarray | None) -> None:
    if record is None or facts.times is None:
        found.take(
            "alpha", INTEGRALS_ALPHA, "integrals over spheres are taken to be exact", GUESSED
        )
        found.take("low_pass", "none", "integrals over spheres are taken to be exact", GUESSED)
        return
    power = record_power(record, facts.times, detrend=False)
    begin = 2 * found.values["dead_time"] or -np.inf
    ratio = noise_before(power.after(begin), _arrival(facts, found))
    if ratio is None:
        how = "assumed: no silence in the record, by which it could be told"
        found.take_alpha(UNKNOWN_NOISE, how, GUESSED)
    else:
        found.take_alpha(ratio, "before sound from the region arrives")
        why = "all waves up to the highest stand out of the noise"
        found.take("low_pass", "none", why, LIKELY)
