"""When the laser fires, by its artefact in a record that begins before that.

All channels record the pulse of the laser at the same time: as an electrical artefact, or as sound
of what it warms at the detectors' own faces. So where all are quiet at first and then louder than
sound, at once and alike, time is 0. A record that starts late has lost this, one that starts on
time begins with it. Of detectors about an arc alone: all those of a line are as far from a skin.
"""

import numpy as np
from jaxtyping import Float

from ..base.choice_table import LIKELY
from .estimate import Estimate, Source

LATEST = 0.1  # of the time in which sound comes from the middle: it is soon after the first sample
QUIET_SAMPLES = 3  # at least, before it
QUIET, LOUD = 0.1, 0.5  # of its height: until the sample before it, and from it on
LASTING = 4  # samples, in which channels are compared
UNLIKE = 0.3  # mean difference between a channel and all, over that height, at most
SOUND = 1.0  # height at least, over the greatest sound of a typical channel
GONE = 0.5  # of its height, to which it falls before twice the latest time


def start_by_laser(
    record: Float[np.ndarray, "detectors samples"],
    times: Float[np.ndarray, " samples"],
    middle: float,
) -> Estimate | None:
    """What is added to the times, t_0 = -(time of the first loud sample), so that it is at 0.

    Args:
        record: of pressure, finite.
        times: as nobody knows any better, from 0 on [time].
        middle: how long sound takes from the middle [time].

    Returns:
        Likely, with half a sample as its standard error; None where no artefact begins in it.

    >>> times, sound = np.arange(400) / 40, np.random.default_rng(0).normal(size=(30, 400))
    >>> sound[:, 12:30] += 100 * np.cos(np.arange(18) / 4)
    >>> start_by_laser(sound, times, middle=26.0).value
    -0.3
    """
    centred = record - np.median(record, axis=1, keepdims=True)
    alike = np.median(centred, axis=0)
    first = int(np.searchsorted(times, times[0] + LATEST * middle))
    height = float(np.abs(alike[:first]).max(initial=0.0))
    if height == 0.0:
        return None
    begins = int(np.argmax(np.abs(alike[:first]) >= LOUD * height))
    if begins < QUIET_SAMPLES or np.abs(alike[:begins]).max() > QUIET * height:
        return None
    if height < SOUND * float(np.median(np.abs(centred[:, first:]).max(axis=1, initial=0.0))):
        return None
    burst = slice(begins, begins + LASTING)
    unlike = float(np.mean(np.abs(centred[:, burst] - alike[burst])))
    left = np.abs(alike[2 * first : 3 * first])
    if unlike > UNLIKE * height or left.max(initial=0.0) > GONE * height:
        return None
    gone = float(times[begins])
    why = "recording began {gone:time} before the laser fired, as its artefact shows"
    data = {"gone": gone}
    error = float(times[1] - times[0]) / 2
    return Estimate(-gone, why, LIKELY, Source.ESTIMATE, error, data)
