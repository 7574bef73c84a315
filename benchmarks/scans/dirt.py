"""What becomes of an exact record on its way into a file. Every function returns a new record."""

import numpy as np


def response(rate: float, middle: float, width: float) -> np.ndarray:
    """Impulse response of an element, time 0 in the middle: a band about a frequency [Hz].

    Args:
        width: of the band at half its height, over the middle.
    """
    n = 2 * int(2 * rate / middle) + 1
    t = (np.arange(n) - n // 2) / rate
    spread = 2 * np.sqrt(np.log(2)) / (np.pi * width * middle)
    pulse = np.cos(2 * np.pi * middle * t) * np.exp(-((t / spread) ** 2))
    spectrum = np.abs(np.fft.rfft(pulse, 4096))
    return pulse / spectrum.max()


def heard_by(record: np.ndarray, pulse: np.ndarray) -> np.ndarray:
    """Convolved with a response."""
    n = record.shape[1] + len(pulse)
    wide = np.fft.irfft(np.fft.rfft(record, n) * np.fft.rfft(pulse, n), n)
    return wide[:, len(pulse) // 2 : len(pulse) // 2 + record.shape[1]]


def heard_by_each(
    rng: np.random.Generator, record: np.ndarray, rate: float, middle: float
) -> np.ndarray:
    """Convolved with another response for every detector: of its own band and strength."""
    heard = [
        rng.uniform(0.7, 1.3)
        * heard_by(
            row[None], response(rate, middle * rng.uniform(0.85, 1.15), rng.uniform(0.7, 1.2))
        )
        for row in record
    ]
    return np.concatenate(heard)


def starting(record: np.ndarray, first: int, n: int) -> np.ndarray:
    """n samples from the first-th on, with silence where that is negative."""
    before = np.zeros((len(record), max(-first, 0)))
    return np.concatenate([before, record[:, max(first, 0) :]], axis=1)[:, :n]


def silent(record: np.ndarray, sound: np.ndarray) -> np.ndarray:
    """Exact zeros before the first sound at each detector, and after the last one."""
    heard = np.abs(sound) > 1e-6 * np.abs(sound).max()
    from_first = np.maximum.accumulate(heard, axis=1)
    to_last = np.maximum.accumulate(heard[:, ::-1], axis=1)[:, ::-1]
    return np.where(from_first & to_last, record, 0.0)


def noise(rng: np.random.Generator, record: np.ndarray, level: float, colour: str) -> np.ndarray:
    """Noise of a share of the sound's root mean square, over the quarter where it is loudest.

    Args:
        colour: "white", or "coloured": more at low frequencies, falling as 1/f above 0.02 of the
            sampling rate.
    """
    drawn = rng.standard_normal(record.shape)
    if colour == "coloured":
        f = np.fft.rfftfreq(record.shape[1])
        drawn = np.fft.irfft(np.fft.rfft(drawn) / np.maximum(f, 0.02), record.shape[1])
    power = np.sort(record**2, axis=1)[:, -record.shape[1] // 4 :]
    return record + level * np.sqrt(power.mean()) * drawn / drawn.std()


def artefact(record: np.ndarray, rate: float, strength: float, first: int = 0) -> np.ndarray:
    """The laser's: alike in all detectors, dying away within 1.5 us.

    Args:
        first: sample of the record, counted from the pulse of the laser.
    """
    t = (first + np.arange(record.shape[1])) / rate
    ring = np.cos(2 * np.pi * 1.2e6 * t) * np.exp(-((t / 0.7e-6) ** 2))
    return record + strength * np.abs(record).max() * np.where(t < 0, 0.0, ring)


def bad_channels(rng: np.random.Generator, record: np.ndarray, share: float) -> np.ndarray:
    """Half of a share dead, half noisy."""
    record = record.copy()
    rows = rng.permutation(len(record))[: max(2, int(share * len(record)))]
    dead, noisy = rows[::2], rows[1::2]
    record[dead] = 0.0
    record[noisy] += np.abs(record).max() * rng.standard_normal((len(noisy), record.shape[1]))
    return record


def counts(rng: np.random.Generator, record: np.ndarray, *, level: bool = False) -> np.ndarray:
    """Unsigned whole numbers with an offset and a drift in every detector, or ``level`` ones."""
    along = np.linspace(0, 1, record.shape[1])
    offset, drift = rng.normal(0, 200, (len(record), 1)), rng.normal(0, 100, (len(record), 1))
    found = 32768 + 6000 * record / np.abs(record).max()
    if not level:
        found = found + offset + drift * along
    return np.round(found).clip(0, 65535).astype(np.uint16)
