"""The sequences of `sequences` for known arguments, order by order, by numpy: nothing is compiled.

Scales, directions of the recurrences and names are as there. Where each order is used once and no
derivative is asked for, this takes a tenth of the time of a compiled scan, and no memory.
"""

from collections.abc import Iterator

import numpy as np
import scipy.special
from jaxtyping import Float

from .sequences import evanescent_orders

_LARGEST = 1e150  # where Y saturates


def known_decay_steps(
    n_max: int, x: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "orders points"]:
    """`decay_steps`: delta_n = J_n(x) / J_{n-1}(x) for n > x, and 1 for n <= x, n = 0..n_max."""
    order = np.arange(n_max + 1)[:, None]
    return np.where(order > x, _ratios(n_max, x), 1.0)


def hankel_rows(
    x: Float[np.ndarray, "points places"], steps: Float[np.ndarray, "orders points"]
) -> Iterator[tuple[Float[np.ndarray, "points places"], Float[np.ndarray, "points places"]]]:
    """J_n(x) / Delta_n and Delta_n Y_n(x), n = 0, 1, ..., as `scaled_hankel_sequence` has them.

    Args:
        x: positive.
        steps: delta_n of `known_decay_steps`, for each row of x.

    >>> x = np.array([[1.0, 1.3]])
    >>> *_, (j, y) = hankel_rows(x, known_decay_steps(400, x[:, 0]))
    >>> print(f"{j[0, 0] * y[0, 1] * 400 * np.pi * 1.3**400:.4f}")
    -1.0004
    """
    n_max = len(steps) - 1
    upward = int(x.min())  # orders up to which J is stable upward at all places
    high = _ratios(n_max, x) if n_max > upward else None
    j, y = scipy.special.j0(x), scipy.special.y0(x)
    j_next, y_next = scipy.special.j1(x), scipy.special.y1(x)
    twice_over = 2 / x
    for n, step in enumerate(steps[1:, :, None], 1):
        yield j, y
        if high is not None and n > upward:
            j_next = np.where(n <= x, j_next, high[n] * j)
        if not (step == 1).all():
            j, j_next = j / step, j_next / step
            y, y_next = y * step, np.maximum(y_next * step, -_LARGEST)
        factor = n * twice_over
        # J_{n+1} / Delta_n and Delta_n Y_{n+1}
        after = factor * j_next - j, factor * y_next - y
        j, y, (j_next, y_next) = j_next, y_next, after
    yield j, y


def _ratios(n_max: int, x: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "orders *shape"]:
    """R_n = J_n / J_{n-1} = 1 / (2 n / x - R_{n+1}), n = 1..n_max, of use for n > x; R_0 = 1."""
    found = np.ones((n_max + 1, *x.shape))
    ratio, twice_over = np.zeros_like(x), 2 / x
    for n in range(n_max + evanescent_orders(n_max), 0, -1):
        ratio = 1 / (n * twice_over - ratio)
        if n <= n_max:
            found[n] = ratio
    return found
