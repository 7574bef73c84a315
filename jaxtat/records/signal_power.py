"""Properties of a record before reconstruction: artefact, quiet part, sound, and band.

Powers are variances about a straight line in short pieces of the record, which offset and drift do
not enter. NumPy throughout: these are a few sums over one frame.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter

PIECES = 100  # of a record, in each of which its power is measured
FEWEST = 16  # samples of a piece
LOUD = 4.0  # times the power of the quietest piece, in which the artefact of the laser ends
STANDS_OUT = 3.0  # of the noise spectrum, by which a frequency with sound exceeds it
TOGETHER = 0.5  # of it, by which neighbouring frequencies with sound exceed it together
CHANCE = 12.0  # by which both differ by chance at most, for one channel and frequency
PARTS = 16  # of a spectrum, over each of which its median is taken
FADED = 0.1  # of the typical total, by which a channel's is too small
SPREAD = 0.02  # median deviation of totals over the median, up to which they are used
SURELY = 8.0  # times that, at least
LEVEL = 4.0  # times the typical step of totals, up to which they are level
MUTED = 1e-18  # share of the highest power that counts as none: what rounding leaves of it
FAINT = 1e-8  # share of the highest spectral power that counts as none


class RecordPower(NamedTuple):
    """Power of a record by detector and time.

    Attributes:
        times: middles of the pieces, (pieces,) [time].
        power: mean square about a straight line, (detectors, pieces) [unit of the record squared].
    """

    times: Float[np.ndarray, " pieces"]
    power: Float[np.ndarray, "detectors pieces"]

    @property
    def typical(self) -> Float[np.ndarray, " pieces"]:
        """Median over the detectors."""
        return np.median(self.power, axis=0)

    def after(self, time: float) -> "RecordPower":
        kept = self.times >= time
        return RecordPower(self.times[kept], self.power[:, kept])


def record_power(
    record: Float[np.ndarray, "detectors times"],
    times: Float[np.ndarray, " times"],
    detrend: bool,
    overlap: int = 1,
    pieces: int = PIECES,
) -> RecordPower:
    """Mean squares over windows of the record; ``detrend`` first subtracts a line from each.

    Args:
        overlap: how many times as many pieces of the same length, which overlap then.
        pieces: about how many without overlap; none has less than 16 samples.

    >>> mean = record_power(np.ones((2, 400)), np.arange(400.0), detrend=False)
    >>> mean.power.shape, float(mean.times[0]), float(mean.power.max())
    ((2, 25), 7.5, 1.0)
    """
    size = max(FEWEST, len(times) // pieces)
    starts = np.arange(0, len(times) - size + 1, max(size // overlap, 1))
    samples = starts[:, None] + np.arange(size)
    parts = np.asarray(record, float)[:, samples]
    if detrend:
        along = np.linspace(-1, 1, size)
        along /= np.linalg.norm(along)
        parts = parts - parts.mean(axis=-1, keepdims=True)
        parts = parts - (parts @ along)[..., None] * along
    return RecordPower(times[samples].mean(axis=-1), np.mean(parts**2, axis=-1))


def artefact_end(power: RecordPower, before: float) -> float:
    """When the laser's electrical artefact at the start of a record has died away; 0 without one.

    Args:
        power: of the record.
        before: the latest it can be, since sound from the middle arrives then [time].
    """
    early = power.times < before
    typical = power.typical[early]
    if not len(typical):
        return 0.0
    least = FAINT * power.typical[~early].max(initial=0.0)  # where there is no noise
    loud = typical > LOUD * max(typical.min(), least)
    if not loud[0] or loud.all():
        return 0.0
    piece = power.times[1] - power.times[0]
    return float(power.times[int(np.argmin(loud))] + piece / 2)  # one piece to spare


def totals(
    record: Float[np.ndarray, "detectors times"], times: Float[np.ndarray, " times"], model: str
) -> Float[np.ndarray, " detectors"]:
    """The integral of f, up to a factor, from the record of each detector: all should be equal.

    Circles about a detector cover the plane once, so that ∫ g dr = ∫ f dx for every detector. From
    the pressure up to a time T when all sound has passed, with c = 1, that is
    4 ∫ p √(T² - t²) dt for two-dimensional waves, since
    ∫_0^t p = (1/2π) ∫_0^t g (t² - r²)^(-1/2) dr, an Abel integral; and ∫ p (T² - t²)/2 dt for the
    in-plane model, where g = r ∫_0^r p.

    Args:
        record: from time 0, or from a quiet time on.
        times: of its samples, the last of them T.
        model: "2d" or "in-plane".
    """
    weight = np.maximum(times[-1] ** 2 - times**2, 0.0)
    return record @ (4 * np.sqrt(weight) if model == "2d" else weight / 2) * (times[1] - times[0])


def faded_channels(
    totals: Float[np.ndarray, " detectors"], working: Bool[np.ndarray, " detectors"]
) -> Bool[np.ndarray, " detectors"]:
    """Channels of too small a gain, by `totals` in order along the curve.

    A channel has faded if its total is a tenth too small, and by more than the others scatter; then
    also its neighbours, as long as totals rise from one to the next. None are found if totals
    scatter, as in a record without its slowest part or with sound from outside.

    Args:
        totals: of all channels.
        working: channels that are good otherwise.

    >>> gains = np.r_[np.ones(40), 0.97, 0.91, 0.7, 0.3, 0.1, np.zeros(5), np.ones(20)]
    >>> np.flatnonzero(faded_channels(gains + 1e-3 * np.sin(np.arange(70.0)), gains > 0.0)).tolist()
    [40, 41, 42, 43, 44]
    """
    none = np.zeros(len(totals), bool)
    typical = float(np.median(totals[working])) if working.any() else 0.0
    if typical == 0.0:
        return none
    gain = totals / typical
    spread = float(np.median(np.abs(gain[working] - 1)))
    if spread > SPREAD:
        return none
    too_small = working & (gain < 1 - max(FADED, SURELY * spread))
    rows = np.flatnonzero(working)
    steps = np.abs(np.diff(gain[rows]))
    level = max(LEVEL * float(np.median(steps)), 1e-3)
    for along in (rows, rows[::-1]):
        for before, here, after in zip(along, along[1:], along[2:], strict=False):
            too_small[here] |= too_small[before] and gain[after] - gain[here] > level
    return too_small


def muted_until(power: RecordPower) -> float:
    """End of the muted part at the start of a record; minus infinity if there is none.

    That is the end of the first piece that is not silent: the step in it, from zero to the offset
    of each detector, is no sound.

    >>> record = np.random.default_rng(0).standard_normal((2, 400))
    >>> record[:, :100] = 7.0
    >>> muted_until(record_power(record, np.arange(400.0), detrend=True))
    111.5
    """
    silent = power.typical <= MUTED * power.typical.max()
    if not silent[0] or silent.all():
        return -np.inf
    first, piece = int(np.argmin(silent)), power.times[1] - power.times[0]
    return float(power.times[first] + piece / 2)


def tail_share(record: Float[np.ndarray, "detectors times"]) -> float:
    """The integral of the pressure over all times, relative to its largest partial integral.

    Waves in the plane have a tail: ∫_0^T p dt = (1/2π) ∫ g (T² - r²)^(-1/2) dr, c = 1, falls off as
    1/T. Elements focused into the plane record d(g/r)/dr, whose integral is 0 once all sound
    has passed; so is that of any record whose slowest part is missing. Means over the detectors,
    since noise has no sign in common.
    """
    passed = np.cumsum(record.mean(axis=0))
    largest = np.abs(passed).max()
    return float(np.abs(passed[-1]) / largest) if largest > 0 else 0.0


def noise_before(power: RecordPower, arrival: float) -> float | None:
    """Noise power over signal power; None if the record has no time before the sound.

    Args:
        power: of the record, without an artefact at its start.
        arrival: of the first sound; before it there is noise alone [time].
    """
    quiet = power.times < arrival - (power.times[1] - power.times[0])
    if quiet.all() or not quiet.any():
        return None
    noise = float(np.median(power.power[:, quiet].mean(axis=1)))
    sound = float(np.median(power.power[:, ~quiet].mean(axis=1)))
    return noise / max(sound - noise, 0.01 * noise, 1e-300)


def highest_frequency(
    record: Float[np.ndarray, "detectors times"],
    times: Float[np.ndarray, " times"],
    quiet: slice,
) -> float:
    """Frequency up to which the record's spectrum exceeds that of its quiet part [cycles/time].

    In an image waves of all detectors add up, their noise does not. So what is half as strong as
    the noise of a detector counts too; with few detectors what cannot be chance.

    Args:
        record: all of it but the artefact.
        times: of its samples.
        quiet: samples without sound; an empty one counts as without noise.
    """
    step = times[1] - times[0]
    whole = _spectrum(record)
    frequencies = np.linspace(0, 0.5 / step, len(whole))
    signal = whole > FAINT * whole[1:].max()
    if quiet.stop - quiet.start >= 16:
        part = _spectrum(record[:, quiet])
        at, chance = np.linspace(0, 0.5 / step, len(part)), CHANCE / np.sqrt(len(record))
        noise = np.interp(frequencies, at, _median(part))
        alone = whole > (1 + max(STANDS_OUT, chance)) * noise
        chance /= np.sqrt(min(_width(part), _width(whole)))
        signal &= alone | (_median(whole) > (1 + max(TOGETHER, chance)) * noise)
    return (
        float(frequencies[np.flatnonzero(signal)[-1]]) if signal.any() else float(frequencies[-1])
    )


def _spectrum(record: Float[np.ndarray, "detectors times"]) -> Float[np.ndarray, " frequencies"]:
    """Median over the detectors of the power spectrum, which is the same for longer records."""
    window = np.hanning(record.shape[1] + 2)[1:-1]
    power = np.abs(np.fft.rfft((record - record.mean(axis=1, keepdims=True)) * window)) ** 2
    return np.median(power, axis=0) / np.sum(window**2)


def _median(spectrum: Float[np.ndarray, " frequencies"]) -> Float[np.ndarray, " frequencies"]:
    """Over neighbouring frequencies; of the first and last, whose power is that of a sum, none."""
    inner = median_filter(spectrum[1:-1], _width(spectrum))
    return np.pad(inner, 1, mode="edge")


def _width(spectrum: Float[np.ndarray, " frequencies"]) -> int:
    return 1 + 2 * (len(spectrum) // (2 * PARTS))
