"""What a record and the positions of its detectors cannot both be.

*Times.* Sound from x reaches the detector y_k at |y_k - x|/c. Let t_k be the time before which half
of the sound's power has arrived, or its mean. Sound of a body about x then has t_k of about
|y_k - x|/c, so that

    min over x and c of median_k | |y_k - x| - c t_k | / R,

x within the circle of the detectors, R its radius, c within 10 % of the nominal speed, is small. It
is not where units, the sampling rate or the start of the record are wrong. Detectors on one side
may also hear what is far away; but not from near the other side of their circle, where there is no
body, so that median_k c t_k / R has a bound.

*Order.* Detectors beside each other hear nearly the same. Where rows of the data are in another
order than the positions, they are as different as any two, though each has others like it: the mean
correlation of neighbours is then about 0, in the waves and in their power over time.

The bounds were set on the scans of `benchmarks/scans` of which rules are made, numbers below 300.
"""

import numpy as np
from jaxtyping import Float

from ..records.signal_power import RecordPower
from .facts import FASTEST, SLOWEST
from .hearing import FINELY

MISFIT = 0.12  # of times over R; whole scans had up to 0.096
SCATTER = 0.2  # of the times of neighbours, over themselves: those of noise scatter more
FARTHEST = 1.4  # of half of the detectors' paths over R; whole scans had up to 1.17
ALIKE = 0.12  # mean correlation of neighbours, at least; whole scans had 0.15 and more
LIKE_ANOTHER = 0.5  # correlation, that most detectors have with some other
CHANCE = 4.0  # over the square root of the number of samples: noise is not as like as that
FEWEST = 16  # detectors, of which the order can be told
ACROSS = 25  # points across the circle, from which sound may come
RIM = 0.95  # of its radius, up to which it may
QUIET = 0.25  # share of a record, of whose power twice the largest is not sound
WAVES = 150  # samples of a record, by which the order is told


def contradiction(
    record: Float[np.ndarray, "detectors times"],
    power: RecordPower,
    points: Float[np.ndarray, "detectors 2"],
    radius: float | None,
    speed: float,
) -> str:
    """What a record contradicts, and what to check, in a sentence; "" for nothing.

    Args:
        record: of the detectors in order along the curve, from where sound may begin.
        power: of the same.
        points: of the detectors, from the middle of their circle [length].
        radius: of that circle; None of another curve, of which only the order is judged [length].
        speed: of sound, to about 10 % [length/time].
    """
    if out_of_order(record, power):
        return (
            "detectors beside each other hear sound that is no more alike than that of any two: "
            "check that the rows of the data are in the order of the positions, and that angles of "
            "detectors are in radians"
        )
    if radius is None:
        return ""
    misfit, path = misfit_of_times(power, points / radius, speed / radius)
    if misfit < MISFIT and path < FARTHEST:
        return ""
    when = "later" if path > 1 else "earlier"
    return (
        f"sound arrives {when} than the geometry allows: after a path of {path:.3g} times the "
        f"radius of the detectors' circle, at a sound speed of {speed:.6g}. Check the units of "
        "positions and times, the sampling rate, and the start time of the record"
    )


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
    sound = np.maximum(power.power - 2 * _quiet(power), 0.0)
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


def out_of_order(record: Float[np.ndarray, "detectors times"], power: RecordPower) -> bool:
    """Whether neighbours are no more alike than others, though each is like some other.

    >>> theta, t = np.linspace(0.0, 5.0, 60), np.arange(0.0, 40.0, 0.1)
    >>> waves = np.sin(3 * (t - np.cos(theta)[:, None])) * np.exp(-((t - 20) ** 2) / 50)
    >>> other = np.random.default_rng(0).permutation(60)
    >>> [out_of_order(rows, RecordPower(t, rows**2)) for rows in (waves, waves[other])]
    [False, True]
    """
    if len(record) < FEWEST:
        return False
    pooled = max(record.shape[1] // WAVES, 1)
    waves = record[:, : record.shape[1] // pooled * pooled]
    waves = waves.reshape(len(record), -1, pooled).mean(axis=-1)
    waves = waves - np.median(waves, axis=1, keepdims=True)
    loudness = np.sqrt(power.power)
    alike = [_correlations(waves - waves.mean(axis=0))]
    loudness = loudness - loudness.mean(axis=0)
    alike.append(_correlations(loudness - loudness.mean(axis=1, keepdims=True)))
    beside = max(float(np.diag(of, 1).mean()) for of in alike)
    others = [(of - 2 * np.eye(len(of))).max(axis=1) for of in alike]
    n_samples = waves.shape[1], loudness.shape[1] / FINELY  # pieces overlap
    least = [max(LIKE_ANOTHER, CHANCE / np.sqrt(n)) for n in n_samples]
    has_like = max(np.mean(of > bound) for of, bound in zip(others, least, strict=True))
    return bool(beside < ALIKE and has_like > 0.5)


def _correlations(
    signals: Float[np.ndarray, "detectors times"],
) -> Float[np.ndarray, "detectors detectors"]:
    size = np.linalg.norm(signals, axis=1, keepdims=True)
    unit = signals / np.maximum(size, 1e-300)
    return unit @ unit.T


def _quiet(power: RecordPower) -> Float[np.ndarray, "detectors 1"]:
    return np.quantile(power.power, QUIET, axis=1, keepdims=True)
