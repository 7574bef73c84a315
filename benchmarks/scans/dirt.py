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


def artefact(record: np.ndarray, rate: float, strength: float) -> np.ndarray:
    """The laser's: alike in all detectors, dying away within 1.5 us."""
    t = np.arange(record.shape[1]) / rate
    ring = np.cos(2 * np.pi * 1.2e6 * t) * np.exp(-((t / 0.7e-6) ** 2))
    return record + strength * np.abs(record).max() * ring


def bad_channels(rng: np.random.Generator, record: np.ndarray, share: float) -> np.ndarray:
    """Half of a share dead, half noisy."""
    record = record.copy()
    rows = rng.permutation(len(record))[: max(2, int(share * len(record)))]
    dead, noisy = rows[::2], rows[1::2]
    record[dead] = 0.0
    record[noisy] += np.abs(record).max() * rng.standard_normal((len(noisy), record.shape[1]))
    return record


def counts(rng: np.random.Generator, record: np.ndarray) -> np.ndarray:
    """Unsigned whole numbers with an offset and a drift in every detector."""
    along = np.linspace(0, 1, record.shape[1])
    offset, drift = rng.normal(0, 200, (len(record), 1)), rng.normal(0, 100, (len(record), 1))
    found = 32768 + 6000 * record / np.abs(record).max() + offset + drift * along
    return np.round(found).clip(0, 65535).astype(np.uint16)
