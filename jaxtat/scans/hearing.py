"""First and last sound at the detectors of a scan in the plane, and the speed that follows."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..io import Scan
from ..records import channel_quality
from ..records.channels import ChannelQuality
from ..records.extent import Heard, heard, sounding_disk
from ..records.power import RecordPower, muted_until, record_power
from .choices import Choices
from .facts import FASTEST, SLOWEST, facts_of, typical_frame

EXACT = 1e-8  # noise over signal power, below which a record is simulated, not muted
LEFT_TO_JUDGE = 128  # samples after a muted start, by which channels and noise are judged
PAUSE = 0.3  # of the way from the middle to the detectors: what sounds after it is an echo
FINELY = 4  # times as many pieces of the record as its power is measured in otherwise
CLEAR = 0.6  # of a piece: later ones hold nothing of what is before them


def muted_start(power: RecordPower, times: Float[np.ndarray, " times"]) -> float:
    """End of a muted start; 0 where too little of the record would be left to judge by."""
    muted = muted_until(power)
    return muted if np.count_nonzero(times >= muted) >= LEFT_TO_JUDGE else 0.0


def noise_floor(quality: ChannelQuality, good: Bool[np.ndarray, " detectors"]) -> float:
    """Power of the noise over that of the signal, by differences of samples."""
    noise, signal = np.asarray(quality.noise)[good], np.asarray(quality.signal)[good]
    return float(np.median((noise / np.maximum(signal, 1e-300)) ** 2))


def sound_begins(dead_time: float, muted: float, floor: float) -> float:
    """Earliest time of sound: the record is faded in over as long again as the dead time.

    In a record without noise a silent start is no mute.
    """
    return max(2 * dead_time, muted if floor > EXACT else 0.0)


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
    power = record_power(record, times, detrend, FINELY)
    clear = begin + CLEAR * FINELY * (power.times[1] - power.times[0])
    return heard(power.after(clear), PAUSE * middle)


def speed_heard(scan: Scan, choices: Choices) -> float | None:
    """The speed of sound by the times of first and last sound, over the speed of the choices.

    Sound of a body of radius a about m arrives at distances |y - m| ∓ a. The speed is the one at
    which the middle of these times fits the distances |y - m|. On simulated arcs of 125 degrees and
    more it was 1 to 2 % off; on those of 90 degrees it was hardly better than water's. None if the
    record does not show both times.

    Args:
        scan, choices: in the plane, of pressure.
    """
    facts = facts_of(scan)
    assert facts.times is not None
    record = jnp.asarray(typical_frame(scan)[list(choices.channels)])
    power = record_power(np.asarray(record), facts.times, detrend=True)
    muted = muted_start(power, facts.times)
    quality = channel_quality(record, facts.times, dead_time=max(choices.dead_time, muted))
    floor = noise_floor(quality, np.ones(len(record), bool))
    begin = sound_begins(choices.dead_time, muted, floor)
    points = facts.points[list(choices.channels)] - np.array(choices.region_center)
    middle = float(np.median(np.hypot(*points.T))) / choices.sound_speed
    when = heard_after(begin, np.asarray(record), facts.times, middle, detrend=True)
    if not (when.begins.mean() > 0.5 and when.ceases.mean() > 0.5):
        return None
    speed = sounding_disk(points, when, choices.sound_speed, False).speed
    return float(np.clip(speed, SLOWEST, FASTEST))
