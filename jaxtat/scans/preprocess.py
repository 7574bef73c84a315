"""What of a record counts: which channels, and from when on.

The artefact of the laser ends where the power falls to that of the quietest piece. Bad channels are
those of `channel_quality`, with NaN, or of too small a gain.
"""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from ..base.choice_table import GUESSED, LIKELY, SURE
from ..geometry import require_radii
from ..io import Scan
from ..records import channel_quality, ranges
from ..records.signal_power import (
    RecordPower,
    artefact_end,
    faded_channels,
    muted_until,
    record_power,
    totals,
)
from ..steps import AccuracyWarning
from .acquisition import (
    FEWEST,
    SLOWEST,
    Facts,
    arc_through,
    begin_behind_gap,
    typical_frame,
)
from .estimate import Estimate
from .parameters import Parameters
from .space import MOST_POINTS, FactsInSpace, facts_in_space

RIM = 0.95  # of the detectors' radius, up to which sources are reckoned with
CUT_OFF = 5e-3  # share of samples with the highest or lowest value, which waves hardly reach
FEWEST_SAMPLES = 16  # in which sound passes, for sums over them
EXACT = 1e-8  # noise over signal power, below which a record is simulated, not muted
OFFSET = 0.1  # of a channel's range, by which its median is off zero
LISTENED = 512  # detectors in space, at most, by which noise is judged
LEFT_TO_JUDGE = 128  # samples after a muted start, by which channels and noise are judged


class Acquisition(NamedTuple):
    """A typical frame of a scan in the plane, and what of it counts.

    Attributes:
        scan: of which it is.
        facts: with times as they were chosen, and the arc of the good detectors.
        frame: of the detectors in order along the curve, (detectors, samples).
        power: of it.
        good: detectors that count.
        begin: earliest time of sound [time].
        middle: when sound from the middle arrives, by the speed known before images [time].
        floor: noise over signal power by the differences of samples, which measure fast noise.
    """

    scan: Scan
    facts: Facts
    frame: Float[np.ndarray, "detectors samples"]
    power: RecordPower
    good: Bool[np.ndarray, " detectors"]
    begin: float
    middle: float
    floor: float

    @property
    def times(self) -> Float[np.ndarray, " samples"]:
        assert self.facts.times is not None
        return self.facts.times

    @property
    def heard(self) -> Float[np.ndarray, "good samples"]:
        """Rows of the good detectors."""
        return self.frame[self.good]

    @property
    def points(self) -> Float[np.ndarray, "detectors 2"]:
        """Positions, in the order of the rows."""
        return self.facts.points[self.facts.order]


def preprocess_in_plane(
    scan: Scan, facts: Facts, frame: Float[np.ndarray, "detectors samples"], p: Parameters
) -> tuple[Acquisition, Parameters]:
    """The record with the model, the speed and the start of the parameters.

    Args:
        scan, facts: with times as in the file.
        frame: typical, in order along the curve.
        p: with model, speed and start.

    Returns:
        The record, and the parameters with dead time and channels.
    """
    facts = facts.later(p["time_shift"])
    assert facts.times is not None
    times, whole = facts.times, np.where(np.isfinite(frame), frame, 0.0)
    power = record_power(whole, times, p["model"] == "in-plane")
    middle = facts.arc.radius / p["sound_speed"] if facts.arc else float(times[-1]) / 2
    end = artefact_ends(whole, times, middle, p["model"] == "in-plane")
    why = "the artefact at the start has died away" if end else "no artefact at the start"
    p = p.with_(dead_time=Estimate(end, why, LIKELY))
    muted = muted_until(power)
    if np.count_nonzero(times >= muted) < LEFT_TO_JUDGE:
        muted = -np.inf
    good, floor, p = _channels(facts, frame, max(p["dead_time"], muted), p)
    good, p = _without_faded(facts, whole, good, p)
    p = _with_cut_off(whole[good][:, times >= p["dead_time"]], p)
    if facts.arc is not None and facts.arc.closed and not good.all():
        start = begin_behind_gap(facts.order, facts.points, good)
        facts = facts._replace(order=np.roll(facts.order, -start))
        whole, good = np.roll(whole, -start, axis=0), np.roll(good, -start)
        power = RecordPower(power.times, np.roll(power.power, -start, axis=0))
    if facts.arc is not None:
        facts = facts._replace(arc=arc_through(facts.points[facts.order[good]]))
    # the record is faded in over as long again as the dead time; without noise silence is no mute
    first = float(times[0])
    begin = max(first, 2 * p["dead_time"] or first, muted if floor > EXACT else first)
    p = p.fixed(order=tuple(int(k) for k in facts.order))
    return Acquisition(scan, facts, whole, power, good, begin, middle, floor), p


def artefact_ends(record: np.ndarray, times: np.ndarray, middle: float, detrend: bool) -> float:
    """`artefact_end` of the record from when the laser fires; 0 without one [time]."""
    fired = int(np.searchsorted(times, 0.0))
    return artefact_end(record_power(record[:, fired:], times[fired:], detrend), middle)


def _channels(
    facts: Facts, frame: np.ndarray, dead_time: float, p: Parameters
) -> tuple[np.ndarray, float, Parameters]:
    """Which rows of the frame are used, and the power of their noise over that of their signal."""
    assert facts.times is not None
    blank = np.any(~np.isfinite(frame), axis=1, keepdims=True)
    quality = channel_quality(np.where(blank, 0.0, frame), facts.times, dead_time=dead_time)
    good = np.logical_and(quality.good, ~blank[:, 0])
    why, grade = "all of them are good", LIKELY
    if not good.all():
        why = _left_out(quality, blank[:, 0], facts.order)
    if p.gives("use"):
        good, why, grade = np.ones(len(good), bool), "given", SURE
    if good.sum() < FEWEST:
        raise ValueError(
            f"{good.sum()} of {len(good)} detectors are good, expected {FEWEST}: {why}."
        )
    noise, signal = np.asarray(quality.noise)[good], np.asarray(quality.signal)[good]
    floor = float(np.median((noise / np.maximum(signal, 1e-300)) ** 2))
    return good, floor, _with_left_out(p, facts.order[~good], Estimate(None, why, grade))


def _with_left_out(p: Parameters, rows: np.ndarray, channels: Estimate) -> Parameters:
    left_out = tuple(sorted(int(k) for k in rows))
    return p.fixed(left_out=left_out).replaced(channels=channels)


def _left_out(quality: Any, blank: np.ndarray, order: np.ndarray) -> str:
    """Bad channels by kind; those with NaN or infinity are of no other."""
    kinds = {"NaN or infinite": blank}
    kinds |= {
        name: np.asarray(getattr(quality, name)) & ~blank for name in ("dead", "saturated", "noisy")
    }
    named = [f"{name} {ranges(np.sort(order[k]))}" for name, k in kinds.items() if k.any()]
    return "left out: " + "; ".join(named)


def _without_faded(
    facts: Facts, record: np.ndarray, good: np.ndarray, p: Parameters
) -> tuple[np.ndarray, Parameters]:
    """Channels of too small a gain are left out too, where the record shows gains."""
    assert facts.times is not None
    if facts.arc is None or p.gives("use"):
        return good, p
    least = p["sound_speed"] * SLOWEST
    times = facts.times[facts.times <= 2 * facts.arc.radius / least]
    if least * facts.times[-1] < (1 + RIM) * facts.arc.radius or len(times) < FEWEST_SAMPLES:
        return good, p  # not all that sounds within the circle has passed, or hardly sampled
    if p["model"] == "in-plane":  # counts have an offset, waves in the plane a slow tail
        record = record - np.median(record, axis=1, keepdims=True)
    heard = np.where(times >= 2 * p["dead_time"], record[:, : len(times)], 0.0)
    few = faded_channels(totals(heard, times, p["model"]), good)
    if not few.any():
        return good, p
    before = "left out: " if good.all() else f"{p.estimates['channels'].why}; "
    why = f"{before}faded {ranges(np.sort(facts.order[few]))}"
    return good & ~few, _with_left_out(p, facts.order[few | ~good], Estimate(None, why, LIKELY))


def _with_cut_off(record: Float[np.ndarray, "detectors times"], p: Parameters) -> Parameters:
    """Where a converter was overdriven, in all channels, none is worse than the others."""
    ends, silent = (record.min(), record.max()), np.median(record)
    share = sum(float(np.mean(record == end)) for end in ends if end != silent)
    if share <= CUT_OFF:
        return p
    why = "; {cut_off:.1%} of all samples have the highest or lowest value, as if cut off there"
    return p.replaced(channels=p.estimates["channels"].but(why, GUESSED, cut_off=share))


class AcquisitionInSpace(NamedTuple):
    """A typical frame of a scan in space.

    Attributes:
        scan: of which it is.
        facts: of the detectors with data.
        frame: of these, (detectors, samples).
    """

    scan: Scan
    facts: FactsInSpace
    frame: Float[np.ndarray, "detectors samples"]

    @property
    def listened(self) -> Float[np.ndarray, "some samples"] | None:
        """Some rows, by which noise is judged; None of integrals."""
        step = -(-len(self.frame) // LISTENED)
        return None if self.facts.times is None else self.frame[::step]

    def arrival(self, values: Mapping[str, Any]) -> float:
        """When sound from the region first reaches a detector, by values of choices [time]."""
        return (self.facts.radius - values["region_radius"]) / values["sound_speed"]


def preprocess_in_space(scan: Scan, p: Parameters) -> tuple[AcquisitionInSpace, Parameters]:
    """The detectors with data, and the parameters with units and channels.

    Raises:
        ValueError: where these are on no whole rings and too many to be anywhere.
    """
    use = p.given.get("use")
    facts, rows = facts_in_space(scan, use), ()
    frame = typical_frame(scan)
    loud = float(p.given.get("dead_time") or 0.0)
    bad = _bad_in_space(frame[facts.order], facts.times, loud, every=use is not None)
    left_out = np.logical_or.reduce(tuple(bad.values()))
    if facts.times is not None:
        _warn_of_offset(frame[facts.order][~left_out])
    why = "; ".join(
        f"{ranges(np.sort(facts.order[of]))} {what}" for what, of in bad.items() if of.any()
    )
    if left_out.all():
        raise ValueError(
            f"all {len(left_out)} detectors are left out: rows {why}. Check the file's data."
        )
    if left_out.any():
        rows = tuple(int(k) for k in np.sort(facts.order[left_out]))
        facts = _facts_without(scan, facts, rows, why)
    facts = facts._replace(units=facts.units.in_length(p.given.get("length_unit")))
    channels = Estimate(None, facts.arrangement)
    if rows:
        channels = channels.but(f"; left out: {why}", LIKELY)
    order = (*(int(k) for k in facts.order), *rows)
    p = replace(p, units=facts.units).fixed(order=order, left_out=rows)
    return AcquisitionInSpace(scan, facts, frame[facts.order]), p.replaced(channels=channels)


def _bad_in_space(
    record: Float[np.ndarray, "detectors samples"],
    times: Float[np.ndarray, " samples"] | None,
    dead_time: float,
    *,
    every: bool,
) -> dict[str, Bool[np.ndarray, " detectors"]]:
    """Rows that do not count, by what is wrong with them.

    Args:
        times: of a pressure record; None of integrals.
        dead_time: until when the laser's artefact may saturate all [time].
        every: whether rows were chosen, so that noise is no reason to leave one out.
    """
    known = np.isfinite(record)
    silent = np.ptp(np.where(known, record, 0.0), axis=1) == 0
    silent = np.logical_or(silent, ~known.all(axis=1))
    bad = {"recorded nothing, or NaN": silent}
    heard = record[~silent]
    if every or times is None or len(heard) < FEWEST:
        return bad
    begin = max(float(times[0]), dead_time)
    if np.count_nonzero(times >= begin) < LEFT_TO_JUDGE:
        return bad
    quality = channel_quality(heard, times, dead_time=begin)
    for what in ("saturated", "noisy"):
        bad[what] = np.zeros(len(record), bool)
        bad[what][~silent] = getattr(quality, what)
    return bad


def _warn_of_offset(known: Float[np.ndarray, "detectors samples"]) -> None:
    """Say that channels have an offset: waves in space leave none, and none is taken off there."""
    if known.size == 0:
        return
    middle, low, high = np.median(known, axis=1), known.min(axis=1), known.max(axis=1)
    if np.median(np.abs(middle) / (high - low)) > OFFSET:
        k = int(np.argsort(middle)[len(middle) // 2])
        warnings.warn(
            f"the record has an offset: samples of a channel are about {middle[k]:.4g}, from "
            f"{low[k]:.4g} to {high[k]:.4g}. In space records are taken as they are: subtract its "
            "mean from every channel first.",
            AccuracyWarning,
            stacklevel=2,
        )


def _facts_without(
    scan: Scan, facts: FactsInSpace, rows: tuple[int, ...], why: str
) -> FactsInSpace:
    try:
        return facts_in_space(scan, np.setdiff1d(facts.order, rows))
    except ValueError as error:
        raise ValueError(
            f"{len(rows)} of {len(facts.order)} detectors are left out (rows {why}), and the "
            "others are on no whole rings. Fill their rows by interpolation along their rings, or "
            f"choose detectors without them with --use: whole rings, or any up to {MOST_POINTS}."
        ) from error


def known_radii(scan: Scan, p: Parameters) -> np.ndarray | None:
    """Radii that are given, or those of integrals in the file; refused if they do not increase."""
    own = p.given.get("radii")
    if own is None and scan.kind == "circular_integrals":
        own = scan.known.get("radii")
    if own is None:
        return None
    own = np.asarray(own, float)
    require_radii(jax.device_put(own))
    return own
