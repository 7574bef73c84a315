"""Regular series: the rate of equispaced times, and the period of wavelengths."""

import numpy as np

from .scan import Scan


def rate_of(scan: Scan, format: str) -> float:
    """The sampling rate [1/time], which files of a format demand."""
    if "sampling_rate" in scan.known:
        return float(scan.known["sampling_rate"])
    times = scan.known.get("times", np.zeros(1))
    steps = np.diff(times)
    if not steps.size or steps.min() <= 0 or np.ptp(steps) > 1e-6 * steps.mean():
        raise ValueError(f"{format} files need a sampling_rate, or times at equal steps.")
    return float((len(times) - 1) / (times[-1] - times[0]))


def period(values: np.ndarray) -> int:
    """The least p that divides the length and after which all values repeat.

    >>> period(np.array([700, 800, 700, 800])), period(np.array([700, 800, 800]))
    (2, 3)
    """
    n = len(values)
    return next(
        p for p in range(1, n + 1) if n % p == 0 and (values.reshape(-1, p) == values[:p]).all()
    )
