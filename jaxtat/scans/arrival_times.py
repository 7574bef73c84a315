"""Whether sound arrives when the positions of the detectors allow it.

Let t_k be the time before which half of the sound's power has arrived, or its mean. Sound of a body
about x then has t_k of about |y_k - x|/c, so that

    min over x and c of median_k | |y_k - x| - c t_k | / R,

x within the circle of the detectors, R its radius, c within 10 % of the nominal speed, is small. It
is not where units, the sampling rate or the start of the record are wrong: by sources close to the
detectors an image explains such a record all the same. Detectors on one side may also hear what is
far away; but not from near the other side of their circle, where there is no body, so that median_k
c t_k / R has a bound.

The bounds were set on the scans of `benchmarks/scans` of which rules are made, numbers below 300.
"""

import numpy as np
from jaxtyping import Float

from ..records.signal_power import RecordPower
from .acquisition import FASTEST, SLOWEST
from .onset_times import power_after
from .preprocess import RIM, Acquisition, artefact_ends

MISFIT = 0.12  # of times over R; whole scans had up to 0.096
SCATTER = 0.2  # of the times of neighbours, over themselves: those of noise scatter more
FARTHEST = 1.4  # of half of the detectors' paths over R; whole scans had up to 1.17
ACROSS = 25  # points across the circle, from which sound may come
MISTAKES = {"half": 2.0, "twice": 0.5}  # the sampling rate, and what times are multiplied by
QUIET = 0.25  # share of a record, of whose power twice the largest is not sound


def early_or_late(record: Acquisition, speed: float) -> str:
    """That sound arrives too early or too late, and what to check, in a sentence; "" if not.

    Args:
        record: its sound is judged, not what the laser does to the amplifiers, whatever model and
            dead time are.
        speed: of sound, to about 10 % [length/time].
    """
    arc = record.facts.arc
    if arc is None:
        return ""
    begin = max(record.begin, artefact_ends(record.frame, record.times, record.middle, True))
    kept = record.times >= begin
    power = power_after(begin, record.heard[:, kept], record.times[kept], detrend=True)
    points = (record.points[record.good] - np.array(arc.center)) / arc.radius

    def of_times(stretch: float) -> tuple[bool, float]:
        stretched = power._replace(times=stretch * power.times)
        misfit, path = misfit_of_times(stretched, points, speed / arc.radius)
        return misfit < MISFIT and path < FARTHEST, path

    allowed, path = of_times(1.0)
    if allowed:
        return ""
    when = "later" if path > 1 else "earlier"
    said = (
        f"sound arrives {when} than the geometry allows: after a path of {path:.3g} times the "
        f"radius of the detectors' circle, at a sound speed of {speed:.6g}. Check the units of "
        "positions and times, the sampling rate, and the start time of the record"
    )
    for name, stretch in MISTAKES.items():
        if of_times(stretch)[0]:
            return f"{said}: with {name} the sampling rate it is when that allows"
    return said


def misfit_of_times(
    power: RecordPower, points: Float[np.ndarray, "detectors 2"], speed: float
) -> tuple[float, float]:
    """The misfit above, and the median path of sound; lengths are over R. Both 0 of noise alone.

    >>> theta = np.linspace(0.0, 5.0, 60)
    >>> y, times = np.stack([np.cos(theta), np.sin(theta)], axis=1), np.arange(0.0, 2.0, 0.01)
    >>> d = np.linalg.norm(y - [0.3, 0.1], axis=1)
    >>> heard = RecordPower(times, 1.0 * (abs(times - d[:, None]) < 0.2))
    >>> [[round(x, 1) for x in misfit_of_times(heard, y, speed)] for speed in (1.0, 2.0)]
    [[0.0, 1.1], [0.4, 2.3]]
    """
    quiet = np.quantile(power.power, QUIET, axis=1, keepdims=True)
    sound = np.maximum(power.power - 2 * quiet, 0.0)
    total = np.maximum(sound.sum(axis=1), 1e-300)
    mean = sound @ power.times / total
    half = power.times[np.argmax(sound.cumsum(axis=1) >= 0.5 * total[:, None], axis=1)]
    if np.median(np.abs(np.diff(mean))) > SCATTER * np.median(mean):
        return 0.0, 0.0
    line = np.linspace(-RIM, RIM, ACROSS)
    where = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    where = where[np.hypot(*where.T) <= RIM]
    distances = np.linalg.norm(points[:, None] - where, axis=-1)
    best = mean @ distances / max(float(mean @ mean), 1e-300)
    fitted = np.clip(best, speed * SLOWEST, speed * FASTEST)
    misfits = np.median(np.abs(distances - fitted * mean[:, None]), axis=0)
    return float(misfits.min()), float(speed * np.median(half))
