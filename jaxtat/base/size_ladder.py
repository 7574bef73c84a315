"""Sizes on a ladder: arrays of nearly the same size take one compiled program.

Every shape of an array is a program of its own for XLA. Sizes that come from data are therefore
rounded up to numbers of four binary digits, 8 to 15 times a power of two, at most an eighth more.
What is added is zero, or weighted by zero, so that results are those of the exact sizes.
"""

from typing import Any

import jax
import numpy as np

from .checks import is_concrete


def rung(n: int) -> int:
    """The least number of four binary digits that is n at least.

    >>> [rung(n) for n in (1, 15, 17, 100, 256, 257, 2030)]
    [1, 15, 18, 104, 256, 288, 2048]
    """
    unit = 1 << max(n.bit_length() - 4, 0)
    return -(-n // unit) * unit


def filled_up(values: Any, shape: tuple[int, ...], *, by: str = "zeros") -> np.ndarray:
    """Known values at the front of an array of a larger shape, by NumPy: no program is needed.

    Args:
        values: (n_1, n_2, ...).
        shape: none smaller.
        by: "zeros", or "last": the last value along each axis again.

    >>> filled_up(np.ones((1, 2)), (2, 3)).tolist(), filled_up([1.0, 2.0], (4,), by="last").tolist()
    ([[1.0, 1.0, 0.0], [0.0, 0.0, 0.0]], [1.0, 2.0, 2.0, 2.0])
    """
    known = np.asarray(values)
    more = [(0, new - old) for new, old in zip(shape, known.shape, strict=True)]
    return np.pad(known, more, mode="edge" if by == "last" else "constant")


def reshaped(values: Any, shape: tuple[int, ...]) -> Any:
    """``values.reshape(shape)``, without a program where they are known, on one device."""
    if not is_concrete(values) or (isinstance(values, jax.Array) and len(values.devices()) > 1):
        return values.reshape(shape)
    return jax.device_put(np.asarray(values).reshape(shape))
