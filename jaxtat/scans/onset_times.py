"""First and last sound at the detectors, and the disk from which it comes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..records.signal_power import RecordPower, record_power
from ..records.source_extent import (
    Heard,
    SoundingDisk,
    arriving_from,
    heard,
    sounding_disk,
    sounding_place,
)
from .preprocess import Acquisition

PAUSE = 0.3  # of the way from the middle to the detectors: what sounds after it is an echo
PIECES = 60  # of the record in which sound is heard: shorter ones hold little of smooth bodies
FINELY = 4  # times as many, which overlap
BADLY = 0.015  # over the detectors' radius: deviation of times that a disk does not explain
SMALLER = 0.75  # times as large as with all sound: then that of other things is left out
CLEAR = 0.6  # of a piece: later ones hold nothing of what is before them


def power_after(
    begin: float,
    record: Float[np.ndarray, "detectors times"],
    times: Float[np.ndarray, " times"],
    detrend: bool,
) -> RecordPower:
    """Power in short windows after a time.

    Args:
        begin: earliest time of sound, or minus infinity.
        detrend: without offset, drift and slow tails.
    """
    power = record_power(record, times, detrend, FINELY, PIECES)
    return power.after(begin + CLEAR * FINELY * (power.times[1] - power.times[0]))


class BodyOnsets(NamedTuple):
    """A disk from which sound comes, and the first and last times by which that is known."""

    disk: SoundingDisk
    when: Heard


def body_onsets(
    acquired: Acquisition, points: Float[np.ndarray, "detectors 2"], speed: float, speed_known: bool
) -> BodyOnsets:
    """The body from which sound comes: the disk that explains when detectors record it.

    If that explains the times badly, something else sounds, such as a wall, which may be louder
    than a smooth body. Then only sound counts that may come from the largest place from which most
    detectors record any, if that gives a much smaller disk. The integral over time is taken for
    that: means of bodies over circles are slow, thin walls are heard in fast waves.

    Args:
        acquired: the record.
        points: of the good detectors, from the middle of the array [length].
        speed: assumed [length/time].
        speed_known: whether it is exact.
    """
    size = float(np.median(np.linalg.norm(points, axis=1)))
    pause, begin = PAUSE * acquired.middle, acquired.begin
    record, times = acquired.heard, acquired.times
    when = heard(power_after(begin, record, times, detrend=True), pause)
    body = BodyOnsets(sounding_disk(points, when, speed, speed_known), when)
    if when.tells and body.disk.deviation < BADLY * size:
        return body
    integral = np.cumsum(record - np.median(record, axis=1, keepdims=True), axis=1)
    slow = power_after(begin, integral, times, detrend=True)
    place = sounding_place(points, slow, speed)
    if place is None:
        return body
    when = heard(slow, pause, arriving_from(place, points, slow.times, speed))
    smaller = sounding_disk(points, when, speed, speed_known)
    much = smaller.reach < SMALLER * body.disk.reach or not body.when.tells
    return BodyOnsets(smaller, when) if when.tells and much else body
