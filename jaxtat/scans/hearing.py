"""First and last sound at the detectors of a scan in the plane, and the speed that follows."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..records.channels import ChannelQuality
from ..records.signal_power import RecordPower, muted_until, record_power
from ..records.source_extent import (
    Heard,
    SoundingDisk,
    arriving_from,
    heard,
    sounding_disk,
    sounding_place,
)

EXACT = 1e-8  # noise over signal power, below which a record is simulated, not muted
LEFT_TO_JUDGE = 128  # samples after a muted start, by which channels and noise are judged
PAUSE = 0.3  # of the way from the middle to the detectors: what sounds after it is an echo
PIECES = 60  # of the record in which sound is heard: shorter ones hold little of smooth bodies
FINELY = 4  # times as many, which overlap
BADLY = 0.015  # over the detectors' radius: deviation of times that a disk does not explain
SMALLER = 0.75  # times as large as with all sound: then that of other things is left out
CLEAR = 0.6  # of a piece: later ones hold nothing of what is before them


def muted_start(power: RecordPower, times: Float[np.ndarray, " times"]) -> float:
    """End of a muted start; minus infinity where too little of the record would be left."""
    muted = muted_until(power)
    return muted if np.count_nonzero(times >= muted) >= LEFT_TO_JUDGE else -np.inf


def noise_floor(quality: ChannelQuality, good: Bool[np.ndarray, " detectors"]) -> float:
    """Power of the noise over that of the signal, by differences of samples."""
    noise, signal = np.asarray(quality.noise)[good], np.asarray(quality.signal)[good]
    return float(np.median((noise / np.maximum(signal, 1e-300)) ** 2))


def sound_begins(first: float, dead_time: float, muted: float, floor: float) -> float:
    """Earliest time of sound: the record is faded in over as long again as the dead time.

    In a record without noise a silent start is no mute.

    Args:
        first: time of the first sample.
        dead_time, muted: ends of the artefact, 0 without one, and of a muted start [time].
        floor: power of the noise over that of the signal.
    """
    return max(first, 2 * dead_time or first, muted if floor > EXACT else first)


def heard_after(
    begin: float,
    record: Float[np.ndarray, "detectors times"],
    times: Float[np.ndarray, " times"],
    middle: float,
    detrend: bool,
) -> Heard:
    """First and last sound after a time.

    Args:
        begin: from `sound_begins`, or minus infinity.
        middle: when sound from the middle arrives [time].
        detrend: without offset, drift and slow tails.
    """
    return heard(power_after(begin, record, times, detrend), PAUSE * middle)


def power_after(
    begin: float,
    record: Float[np.ndarray, "detectors times"],
    times: Float[np.ndarray, " times"],
    detrend: bool,
) -> RecordPower:
    """Power in short windows after a time; arguments as of `heard_after`."""
    power = record_power(record, times, detrend, FINELY, PIECES)
    return power.after(begin + CLEAR * FINELY * (power.times[1] - power.times[0]))


class Sound(NamedTuple):
    """What detectors in the plane hear, in order along the curve.

    Attributes:
        power: of the record.
        when: first and last sound.
        slow: power of the record's integral over time, in which slow sound is louder. Means of
            bodies over circles are slow, thin walls are heard in fast waves.
        pause: the shortest that separates an echo [time].
    """

    power: RecordPower
    when: Heard
    slow: RecordPower
    pause: float


def sound_after(
    begin: float,
    record: Float[np.ndarray, "detectors times"],
    times: Float[np.ndarray, " times"],
    middle: float,
) -> Sound:
    """Sound after a time; arguments as of `heard_after`."""
    power = power_after(begin, record, times, detrend=True)
    integral = np.cumsum(record - np.median(record, axis=1, keepdims=True), axis=1)
    slow = power_after(begin, integral, times, detrend=True)
    return Sound(power, heard(power, PAUSE * middle), slow, PAUSE * middle)


class Body(NamedTuple):
    """A disk from which sound comes, and by which times that is known."""

    disk: SoundingDisk
    when: Heard


def body_heard(
    sound: Sound, points: Float[np.ndarray, "detectors 2"], speed: float, speed_known: bool
) -> Body:
    """The body from which sound comes: the disk that explains when detectors hear it.

    If that explains the times badly, something else sounds, such as a wall, which may be louder
    than a smooth body. Then only sound counts that may come from the largest place from which most
    detectors hear any, if that gives a much smaller disk.

    Args:
        sound: of the detectors.
        points: of the detectors, from the middle of the array [length].
        speed: assumed [length/time].
        speed_known: whether it is exact.
    """
    body = Body(sounding_disk(points, sound.when, speed, speed_known), sound.when)
    size = float(np.median(np.linalg.norm(points, axis=1)))
    if sound.when.tells and body.disk.deviation < BADLY * size:
        return body
    place = sounding_place(points, sound.slow, speed)
    if place is None:
        return body
    within = arriving_from(place, points, sound.slow.times, speed)
    when = heard(sound.slow, sound.pause, within)
    smaller = sounding_disk(points, when, speed, speed_known)
    much = smaller.reach < SMALLER * body.disk.reach or not sound.when.tells
    return Body(smaller, when) if when.tells and much else body


def near_side_heard(
    body: Body, points: Float[np.ndarray, "detectors 2"], speed: float
) -> SoundingDisk:
    """The disk by first times alone, for a record that ends before sound from the far side."""
    begins = body.when._replace(ceases=np.zeros_like(body.when.ceases))
    return sounding_disk(points, begins, speed, True)
