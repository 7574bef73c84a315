"""The automatic choices for a scan in the plane.

A function of the scan alone: nothing is remembered, nothing drawn by chance.
"""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ..base.choice_table import GUESSED, LIKELY, SURE
from ..geometry import (
    ArcFit,
    DetectorCurve,
    Region,
    data_radii,
    detector_curve,
    disk,
    keep_detectors,
    radial_step,
    require_outside,
    uncovered,
)
from ..io import Scan
from ..records import MODELS, channel_quality, ranges, supported
from ..records.signal_power import (
    RecordPower,
    artefact_end,
    faded_channels,
    highest_frequency,
    noise_before,
    record_power,
    tail_share,
    totals,
)
from ..steps import Contradiction, TooFewDetectors
from .acoustics import sound_within, tell_acoustics
from .acquisition import (
    FEWEST,
    SLOWEST,
    Facts,
    arc_through,
    begin_behind_gap,
    facts_of,
    nominal_water_speed,
    typical_frame,
)
from .arrival_times import early_or_late
from .choices import IN_SPACE, Choices, body_of, plane_region
from .found import (
    DEFAULT_SHARE,
    INTEGRALS_ALPHA,
    RIM,
    Found,
    Limit,
    covered,
    least,
    radii_of,
    require_detail,
    require_middle,
    require_scale,
    slowest,
    take_nominal_speed,
)
from .hearing import muted_start, noise_floor, power_after, sound_after, sound_begins
from .region_in_plane import (
    SUPPOSED,
    center_within,
    circle_without_detectors,
    cut_at_opening,
    distances_of,
    found_with_rectangle,
    largest_seen,
    region_of_sound,
    seen_region,
)
from .speed_from_one_side import with_speed_from_one_side

PIXELS = (65, 1025)
FITTED = 513  # pixels at most where there is no formula: half a minute's work
SAMPLED = 0.5  # share of the region's radius, within which the detectors sample all that is wanted
PIXELS_PER_DETAIL = 2.0  # in half the shortest wave
FEWEST_DETAILS = 8  # across a region, below which an image hardly shows anything
DRIFT = 5.0  # periods within the record; what is slower is drift
CUT_OFF = 5e-3  # share of samples with the highest or lowest value, which waves hardly reach
FEWEST_SAMPLES = 16  # in which sound passes, for sums over them
OFFSET = 3.0  # over the sound's deviation, of a converter's counts; waves are about zero
TAIL = 0.1  # of `tail_share`: less is no tail of two-dimensional waves
SPACING = "the detectors' spacing in the inner half of the region"
BAND_TO_SPARE = 2.0  # the filter's upper edge over the image's highest frequency


def choices_in_plane(scan: Scan, given: Mapping[str, Any]) -> Choices:
    """All choices for a scan in the plane; see `choosing.choose`."""
    if given.get("model") == IN_SPACE:
        raise ValueError(
            f"model is {IN_SPACE!r}, but the detectors lie in a plane: expected one of "
            f"{', '.join(MODELS)}."
        )
    facts = facts_of(scan, given.get("use"))
    facts = facts._replace(units=facts.units.in_length(given.get("length_unit")))
    values = {"order": tuple(int(k) for k in facts.order), "units": facts.units}
    found = found_with_rectangle(given, values)
    assumed = ""
    if scan.kind == "pressure":
        assumed = _from_record(scan, facts, found)
    else:
        _from_integrals(scan, facts, found)
        found.require_body_speed(scan.kind)
        found.take_body()
    found.take_laser_energy(scan)
    found.take("inversion", "fourier", "the faster way to the same image")
    found.take_constraints(scan.kind)
    made = found.choices()
    if "sound_speed" in found.to_estimate:
        return with_speed_from_one_side(scan, made)
    if scan.kind == "pressure" and made.model != assumed:
        return _by_other_model(scan, given, made)
    return made


def _by_other_model(scan: Scan, given: Mapping[str, Any], made: Choices) -> Choices:
    """All choices by the model that images tell, where the record alone spoke for another."""
    told = {name: getattr(made, name) for name in ("model", "sound_speed", "time_shift")}
    other = choices_in_plane(scan, told | {k: v for k, v in given.items() if v is not None})
    reasons, errors = dict(made.reasons), dict(made.standard_errors)
    for name in told:
        other = other.with_reason(name, reasons[name], made.grade(name), errors.get(name))
    return replace(other, user_set=made.user_set)


def _from_record(scan: Scan, facts: Facts, found: Found) -> str:
    """Choices for a pressure record; returns the model by which it was prepared."""
    assert facts.times is not None
    frame = typical_frame(scan)[facts.order]
    model = _model(facts, frame, found)
    speed = take_nominal_speed(scan, found, facts.units)
    found.require_body_speed(scan.kind)
    given = float(found.take("time_shift", 0.0, "as the file says"))
    facts = facts.later(given)
    times = facts.times
    assert times is not None
    detrend = model == "in-plane"
    whole = np.where(np.isfinite(frame), frame, 0.0)
    power = record_power(whole, times, detrend)
    middle = facts.arc.radius / speed if facts.arc else float(times[-1]) / 2
    end = _artefact_end(whole, times, detrend, middle)
    why = "the artefact at the start has died away" if end else "no artefact at the start"
    dead_time = float(found.take("dead_time", end, why, LIKELY))
    found.take(
        "impulse_response",
        "impulse_response" in scan.known,
        "in the file" if "impulse_response" in scan.known else "none in the file",
    )
    muted = muted_start(power, times)
    good, floor = _channels(frame, times, max(dead_time, muted), found)
    good = _without_faded(whole, facts, dead_time, found, good)
    _say_if_cut_off(whole[good][:, times >= dead_time], found)
    if facts.arc is not None and facts.arc.closed and not good.all():
        start = begin_behind_gap(facts.order, facts.points, good)
        facts = facts._replace(order=np.roll(facts.order, -start))
        whole, good = np.roll(whole, -start, axis=0), np.roll(good, -start)
        power = RecordPower(power.times, np.roll(power.power, -start, axis=0))
        found.values["order"] = tuple(int(k) for k in facts.order)
    if facts.arc is not None:
        facts = facts._replace(arc=arc_through(facts.points[facts.order[good]]))
    begin = sound_begins(float(times[0]), dead_time, muted, floor)
    if facts.arc is not None and found.given.get("region_radius") is None:
        require_scale(float(times[-1]) * speed, facts.arc.radius, speed)
    # whatever model and dead time are: sound is judged, not what the laser does to the amplifiers
    end = end if detrend else _artefact_end(whole, times, True, middle)
    if not _say_if_early_or_late(facts, found, good, whole[good], max(begin, end)):
        _tell_acoustics(scan, facts, found, whole, good, begin)
    speed, shift = _one_speed(facts, found), float(found.values["time_shift"]) - given
    facts, times, begin = facts.later(shift), times + shift, begin + shift
    power = RecordPower(power.times + shift, power.power).after(begin)
    sound = sound_after(begin, whole[good], times, middle)
    region_of_sound(scan, facts, found, sound, speed, good)
    found.take_body()
    speed = float(found.values["water_speed"] or speed)  # by which times are radii
    start = int(np.searchsorted(times, begin))
    arrival = _first_arrival(facts, found, speed)
    quiet = slice(0, max(int(np.searchsorted(times, arrival)) - start, 0))
    highest = highest_frequency(whole[good][:, start:], times[start:], quiet)
    where = _where(facts, found, good)
    _resolution(where, times, found, speed, highest)
    _band(found, times, speed, highest)
    _radii(where, facts, found, float(times[-1]) * speed)
    _noise(found, RecordPower(power.times, power.power[good]), arrival, floor)
    return model


def _say_if_early_or_late(
    facts: Facts, found: Found, good: np.ndarray, record: np.ndarray, begin: float
) -> bool:
    """Warn of sound at times that the positions contradict; nothing can be told by it then."""
    if facts.arc is None:
        return False
    assert facts.times is not None
    kept, arc = facts.times >= begin, facts.arc
    power = power_after(begin, record[:, kept], facts.times[kept], detrend=True)
    points = facts.points[facts.order][good] - np.array(arc.center)
    said = early_or_late(power, points, arc.radius, float(found.values["sound_speed"]))
    if said:
        warnings.warn(f"{said}.", Contradiction, stacklevel=5)
        found.settle_all(said)
        found.doubt()
    return bool(said)


def _tell_acoustics(
    scan: Scan, facts: Facts, found: Found, record: np.ndarray, good: np.ndarray, begin: float
) -> None:
    """Speed, model and start, by the best image of all that may sound within the detectors.

    Of records of a scanner's size: of others nothing is estimated.
    """
    if nominal_water_speed(facts.units) is None:
        return
    assert facts.times is not None
    times, points = facts.times, facts.points[facts.order]
    arc, speed = facts.arc or _free_circle(facts, found), _one_speed(facts, found)
    sound = sound_within(arc, points, record, times, good, begin, speed)
    if sound is None:
        found.settle_all("the record is too short to tell it")
        return
    known = found.given.get("time_shift") is not None or "times" in scan.known
    tell_acoustics(sound, arc, found, speed, known)


def _one_speed(facts: Facts, found: Found) -> float:
    """The speed of sound; of two the single one by which sound from the middle takes as long."""
    speed, water = float(found.values["sound_speed"]), found.given.get("water_speed")
    if water is None:
        return speed
    radius = found.given.get("body_radius")
    share = SUPPOSED if radius is None or facts.arc is None else float(radius) / facts.arc.radius
    return 1 / (share / speed + (1 - share) / float(water))


def _free_circle(facts: Facts, found: Found) -> ArcFit:
    """Of detectors on no circle: the largest without any about what they see, or the region."""
    center, radius = (found.given.get(name) for name in ("region_center", "region_radius"))
    if center is not None and radius is not None:
        arc = circle_without_detectors(facts.points[facts.order], center)
        return arc._replace(radius=min(arc.radius, 2 * float(radius)))
    return circle_without_detectors(facts.points[facts.order], largest_seen(facts, center)[0])


def _artefact_end(
    record: Float[np.ndarray, "detectors times"], times: np.ndarray, detrend: bool, middle: float
) -> float:
    """`artefact_end` of the record from when the laser fires."""
    fired = int(np.searchsorted(times, 0.0))
    return artefact_end(record_power(record[:, fired:], times[fired:], detrend), middle)


def _model(facts: Facts, frame: Float[np.ndarray, "detectors times"], found: Found) -> str:
    """Take the acoustic model by size, sampling rate, counts and tail, or leave it to images."""
    if nominal_water_speed(facts.units) is None:
        why = "sizes are not a scanner's: two-dimensional waves"
        return found.take("model", "2d", why, LIKELY)
    if facts.in_space:
        why = "detectors in space, of a scanner's size: focused into the plane"
        return found.take("model", "in-plane", why, LIKELY)
    known = np.where(np.isfinite(frame), frame, 0.0)
    offset = np.median(np.abs(np.median(known, axis=1)))
    if (known == np.round(known)).all() or offset > OFFSET * np.median(known.std(axis=1)):
        why = "a scanner's size, rate and counts: focused into the plane"
        return found.take("model", "in-plane", why, LIKELY)
    found.estimate_later("model")  # images tell better, see `model`
    if tail_share(known) < TAIL:
        why = "a scanner's size and rate, and no tail of two-dimensional waves"
        return found.take("model", "in-plane", why, GUESSED)
    why = "a scanner's size and rate, but neither counts nor an offset, and a slow tail"
    return found.take("model", "2d", why, GUESSED)


def _channels(
    frame: Float[np.ndarray, "detectors times"],
    times: Float[np.ndarray, " times"],
    dead_time: float,
    found: Found,
) -> tuple[np.ndarray, float]:
    """Which rows of the frame are used, and the power of their noise over that of their signal."""
    order = np.array(found.values["order"])
    blank = np.any(~np.isfinite(frame), axis=1, keepdims=True)
    quality = channel_quality(np.where(blank, 0.0, frame), times, dead_time=dead_time)
    good = np.logical_and(quality.good, ~blank[:, 0])
    named = _left_out(quality, blank[:, 0], order)
    why, grade = "all of them are good" if good.all() else named, LIKELY
    if found.given.get("use") is not None:
        good, why, grade = np.ones(len(order), bool), "given", SURE
    if good.sum() < FEWEST:
        raise ValueError(
            f"{good.sum()} of {len(good)} detectors are good, expected {FEWEST}: {why}."
        )
    found.values["left_out"] = tuple(sorted(int(k) for k in np.compress(~good, order)))
    found.explain("channels", why, grade)
    return good, noise_floor(quality, good)


def _without_faded(
    record: Float[np.ndarray, "detectors times"],
    facts: Facts,
    dead_time: float,
    found: Found,
    good: np.ndarray,
) -> np.ndarray:
    """Channels of too small a gain are left out too, where the record shows gains."""
    assert facts.times is not None
    if facts.arc is None or found.given.get("use") is not None:
        return good
    least = found.values["sound_speed"] * SLOWEST
    times = facts.times[facts.times <= 2 * facts.arc.radius / least]
    if least * facts.times[-1] < (1 + RIM) * facts.arc.radius or len(times) < FEWEST_SAMPLES:
        return good  # not all that sounds within the circle has passed, or hardly sampled
    if found.values["model"] == "in-plane":  # counts have an offset, waves in the plane a slow tail
        record = record - np.median(record, axis=1, keepdims=True)
    heard = np.where(times >= 2 * dead_time, record[:, : len(times)], 0.0)
    few = faded_channels(totals(heard, times, found.values["model"]), good)
    if few.any():
        order = np.array(found.values["order"])
        left_out = *found.values["left_out"], *(int(k) for k in order[few])
        found.values["left_out"] = tuple(sorted(left_out))
        before = found.reasons["channels"] + "; " if not good.all() else "left out: "
        found.explain("channels", f"{before}faded {ranges(np.sort(order[few]))}", LIKELY)
    return good & ~few


def _say_if_cut_off(record: Float[np.ndarray, "detectors times"], found: Found) -> None:
    """Where a converter was overdriven, in all channels, none is worse than the others."""
    ends, silent = (record.min(), record.max()), np.median(record)
    share = sum(float(np.mean(record == end)) for end in ends if end != silent)
    if share > CUT_OFF:
        why = f"{share:.1%} of all samples have the highest or lowest value, as if cut off there"
        found.explain("channels", f"{found.reasons['channels']}; {why}", GUESSED)


def _left_out(quality: Any, blank: np.ndarray, order: np.ndarray) -> str:
    """Bad channels by kind; those with NaN or infinity are of no other."""
    kinds = {"NaN or infinite": blank}
    kinds |= {
        name: np.asarray(getattr(quality, name)) & ~blank for name in ("dead", "saturated", "noisy")
    }
    named = [f"{name} {ranges(np.sort(order[k]))}" for name, k in kinds.items() if k.any()]
    return "left out: " + "; ".join(named)


def _first_arrival(facts: Facts, found: Found, speed: float) -> float:
    """When sound from the region first reaches a detector [time]."""
    offset = np.abs(facts.points[facts.order] - np.array(found.values["region_center"]))
    size, radius = found.values["region_size"], found.values["region_radius"]
    off = np.hypot(*offset.T) - radius
    if size is not None:
        off = np.hypot(*np.maximum(offset - np.array(size) / 2, 0.0).T)
    return max(float(off.min()), 0.0) / speed


_Where = tuple[DetectorCurve, Region]


def _where(facts: Facts, found: Found, good: np.ndarray | None = None) -> _Where:
    """Curve of the detectors that are used, and region."""
    curve, region = detector_curve(facts.points[facts.order]), plane_region(found.values)
    if good is not None and not good.all():
        curve = keep_detectors(curve, good)
    require_outside(curve, region)
    return curve, region


def _resolution(
    where: _Where, times: np.ndarray, found: Found, speed: float, highest: float
) -> None:
    """lambda_max by detectors, band and pixels, whichever is least, and the pixels by it."""
    speed_at_least = speed * slowest(found)
    support = supported(*where, times, sound_speed=speed_at_least)
    require_middle(support, speed_at_least)
    if support.ends_early:
        found.expect(support.shortfalls[0])
    of_detectors = float(support.frequency_of_detectors) / SAMPLED
    _warn_of_few_details(found, len(where[0].points), of_detectors)
    in_body = 2 * np.pi / float(found.values["sound_speed"])
    _frequency_and_pixels(
        found,
        Limit(of_detectors, SPACING, SURE),
        Limit(in_body * highest, "what the record holds above its noise", LIKELY),
    )


def _warn_of_few_details(found: Found, n_detectors: int, highest: float) -> None:
    """Say that so few detectors show hardly anything of the region."""
    detail, size = np.pi / highest, 2 * float(found.values["region_radius"])
    if detail * FEWEST_DETAILS > size:
        length = found.values["units"].of_length
        needed = int(np.ceil(n_detectors * detail * FEWEST_DETAILS / size))
        warnings.warn(
            f"{n_detectors} detectors show details of {length(detail, 3)} at best, and the region "
            f"is {length(size, 3)} across: too few for an image. About {needed} are needed for "
            f"{FEWEST_DETAILS} details across it.",
            TooFewDetectors,
            stacklevel=6,
        )


def _frequency_and_pixels(found: Found, *limits: Limit) -> None:
    half_width, units = float(found.values["half_width"]), found.values["units"]
    most, pixels = found.given.get("pixels"), "the pixels given"
    if most is None:
        most = FITTED if found.values.get("model_based") else PIXELS[1]
        pixels = f"{most} pixels, the most that are taken"
    limit = least(*limits, Limit(np.pi * max(most - 1, 1) / (2 * half_width), pixels, LIKELY))
    highest = found.take("max_frequency", *limit)
    if highest > limit.frequency:
        supports = units.of_wave_number(limit.frequency)
        found.reasons["max_frequency"] = f"given; {limit.why} supports {supports}"
    require_detail(found, highest, limit.why)
    across = 2 * half_width * highest / np.pi * PIXELS_PER_DETAIL
    n = int(np.clip(2 * (int(np.ceil(across)) // 2) + 1, PIXELS[0], most))
    per_detail = (n - 1) * PIXELS_PER_DETAIL / across
    why = f"details of {units.of_length(np.pi / highest, 3)} in {per_detail:.2g} pixels"
    found.take("pixels", n, why)


def _band(found: Found, times: np.ndarray, speed: float, highest: float) -> None:
    if isinstance(found.given.get("band"), str):
        found.values["band"] = None
        found.explain("band", "given")
        return
    if found.values["model"] != "in-plane":
        found.take("band", None, "the slow tail of two-dimensional waves is signal", LIKELY)
        return
    band = pass_band(times, found.values["max_frequency"], speed)
    why = f"slower is drift, faster is beyond {BAND_TO_SPARE:g} times what the image holds"
    found.take("band", band, why, LIKELY)


def pass_band(
    times: Float[np.ndarray, " times"], max_frequency: float, speed: float
) -> tuple[float, float]:
    """The band of an in-plane record that is neither drift nor beyond the image [cycles/time]."""
    low = DRIFT / float(times[-1] - times[0])
    needed = BAND_TO_SPARE * max_frequency * speed / (2 * np.pi)
    return low, min(max(needed, 2 * low), 0.45 / float(times[1] - times[0]))


def _radii(where: _Where, facts: Facts, found: Found, end: float) -> None:
    """All radii that the record covers: sources outside the region are recorded too.

    Their circles must not be cut, which would falsify the image inside.
    """
    if found.given.get("radii") is not None:
        found.take_radii(np.asarray(found.given["radii"]))
        return
    spacing = 2 * float(found.values["half_width"]) / (int(found.values["pixels"]) - 1)
    step = float(radial_step(spacing, body_of(found.values)))
    arc = facts.arc or circle_without_detectors(
        facts.points[facts.order], found.values["region_center"]
    )
    # the last radius may lie a step beyond the farthest source
    reach = min(RIM * arc.radius, end - step - arc.radius)
    sources = disk(reach, center=np.array(arc.center)) if reach > 0 else None
    radii = np.asarray(data_radii(*where, step, sources=sources))
    found.take_radii(radii[radii <= end])


def _noise(found: Found, power: RecordPower, arrival: float, floor: float) -> None:
    """alpha: power of the noise over that of the sound, as in Wiener's filter.

    Args:
        power: of the good detectors, without what is silenced.
        arrival: of the first sound from the region; before it there is noise alone [time].
        floor: noise over signal power by the differences of samples, which measure fast noise.
    """
    ratio, how, grade = noise_before(power, arrival), "before sound from the region arrives", LIKELY
    if ratio is None:
        ratio, how, grade = floor, "by differences of samples", GUESSED
    found.take_alpha(ratio, how, grade)


def _from_integrals(scan: Scan, facts: Facts, found: Found) -> None:
    """Circular integrals, as simulated: there is little to choose."""
    for name, value in (
        ("model", "none"),
        ("sound_speed", 1.0),
        ("time_shift", 0.0),
        ("dead_time", 0.0),
    ):
        found.values[name] = value
    found.values.update(band=None, impulse_response=False, left_out=())
    found.explain("channels", "all", LIKELY)
    arc = facts.arc
    if arc is None:
        seen_region(facts, found, radii_of(scan, found))
    else:
        center_within(arc, found)
        share, why = DEFAULT_SHARE * arc.radius, "three quarters of the detectors' circle"
        share, why = covered(found, share, why, radii_of(scan, found), distances_of(facts, found))
        radius = float(found.take("region_radius", share, why, GUESSED))
        cut_at_opening(arc, found, radius)
        found.take("half_width", radius, "the region", GUESSED)
    _own_radii(scan, facts, found)
    found.take("alpha", INTEGRALS_ALPHA, "circular integrals are taken to be exact", GUESSED)
    found.take("low_pass", "none", "circular integrals are taken to be exact", GUESSED)


def _own_radii(scan: Scan, facts: Facts, found: Found) -> None:
    """Radii of the file, or those that go with pixels; pixels that go with them."""
    half_width, where = float(found.values["half_width"]), _where(facts, found)
    own = radii_of(scan, found)
    pixels, why = 129, "as many as the paper's"
    if own is not None:
        step = float(np.diff(own).mean())
        pixels, why = round(2 * half_width / step) + 1, "as far apart as the radii"
    pixels = max(int(found.take("pixels", int(np.clip(pixels, *PIXELS)), why)), 2)
    step = 2 * half_width / (pixels - 1)
    if own is not None:
        found.expect(uncovered(*where, jax.device_put(own)))
    radii = np.asarray(data_radii(*where, step)) if own is None else own
    support = supported(*where, np.arange(8.0))  # times are not asked for
    of_step = np.pi / max(step, float(np.diff(radii).max()))
    of_detectors = float(support.frequency_of_detectors) / SAMPLED
    limit = least(Limit(of_step, "pixel and radial step"), Limit(of_detectors, SPACING))
    found.take("max_frequency", *limit)
    found.take_radii(radii)
