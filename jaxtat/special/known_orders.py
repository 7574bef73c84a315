"""The sequences of `sequences` for known arguments, order by order, by numpy: nothing is compiled.

Scales, directions of the recurrences and names are as there. Where each order is used once and no
derivative is asked for, this takes a tenth of the time of a compiled scan, and no memory.
"""

from collections.abc import Iterator

import numpy as np
import scipy.special
from jaxtyping import Float, Int

from .sequences import enough_orders, evanescent_orders

_LARGEST = 1e150  # where Y saturates


def known_decay_steps(
    n_max: int, x: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "orders points"]:
    """`decay_steps`: delta_n = J_n(x) / J_{n-1}(x) for n > x, and 1 for n <= x, n = 0..n_max."""
    order = np.arange(n_max + 1)[:, None]
    return np.where(order > x, _ratios(n_max, x), 1.0)


def hankel_rows(
    x: Float[np.ndarray, "points places"],
    steps: Float[np.ndarray, "orders points"],
    needed: Int[np.ndarray, " points"] | None = None,
) -> Iterator[tuple[Float[np.ndarray, "last places"], Float[np.ndarray, "last places"]]]:
    """J_n(x) / Delta_n and Delta_n Y_n(x), n = 0, 1, ..., as `scaled_hankel_sequence` has them.

    Args:
        x: positive.
        steps: delta_n of `known_decay_steps`, for each row of x.
        needed: the highest order of each row, not decreasing; by default all. Rows that need no
            more are left out, the first ones.

    >>> x = np.array([[1.0, 1.3]])
    >>> *_, (j, y) = hankel_rows(x, known_decay_steps(400, x[:, 0]))
    >>> print(f"{j[0, 0] * y[0, 1] * 400 * np.pi * 1.3**400:.4f}")
    -1.0004
    """
    n_max = len(steps) - 1
    needed = np.full(len(x), n_max) if needed is None else needed
    # rows beyond these need orders that are stable upward at all places
    decaying = int((needed > x.min(axis=1)).nonzero()[0].max(initial=-1)) + 1
    high = _ratios(int(needed[:decaying].max(initial=0)), x[:decaying])
    j, y = scipy.special.j0(x), scipy.special.y0(x)
    j_next, y_next = scipy.special.j1(x), scipy.special.y1(x)
    twice_over, first = 2 / x, 0
    for n, step in enumerate(steps[1:, :, None], 1):
        yield j, y
        done = int(np.searchsorted(needed, n)) - first
        if done:
            j, y, j_next, y_next, twice_over = (
                part[done:] for part in (j, y, j_next, y_next, twice_over)
            )
            first += done
        few = max(decaying - first, 0)
        if few:
            upward = n <= x[first:decaying]
            j_next[:few] = np.where(upward, j_next[:few], high[n, first:] * j[:few])
        if not (step[first:] == 1).all():
            j, j_next = j / step[first:], j_next / step[first:]
            y, y_next = y * step[first:], np.maximum(y_next * step[first:], -_LARGEST)
        factor = n * twice_over
        # J_{n+1} / Delta_n and Delta_n Y_{n+1}
        after = factor * j_next - j, factor * y_next - y
        j, y, (j_next, y_next) = j_next, y_next, after
    yield j, y


def known_circle_norm(
    frequency: Float[np.ndarray, " frequencies"], radius: float, n_orders: int | None = None
) -> Float[np.ndarray, " frequencies"]:
    """`full_circle_norm` of known numbers above zero.

    >>> print(f"{known_circle_norm(np.array([64 * np.pi]), 1.3)[0]:.6f}")
    143.933091
    """
    x = frequency * radius
    n_orders = enough_orders(float(x.max(initial=0.0))) if n_orders is None else n_orders
    steps = known_decay_steps(n_orders, x)
    scale, total = np.cumprod(steps, axis=0), np.zeros_like(x)
    for n, (j, y) in enumerate(hankel_rows(x[:, None], steps)):
        # 1 / |H_n|² of J_n / Delta_n and Delta_n Y_n, which do not overflow
        term = scale[n] ** 2 / ((j[:, 0] * scale[n] ** 2) ** 2 + y[:, 0] ** 2)
        total += term if n == 0 else 2 * term
    return np.sqrt(total / (2 * np.pi * radius))


def _ratios(n_max: int, x: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "orders *shape"]:
    """R_n = J_n / J_{n-1} = 1 / (2 n / x - R_{n+1}), n = 1..n_max, of use for n > x; R_0 = 1."""
    found = np.ones((n_max + 1, *x.shape))
    ratio, twice_over = np.zeros_like(x), 2 / x
    for n in range(n_max + evanescent_orders(n_max), 0, -1):
        ratio = 1 / (n * twice_over - ratio)
        if n <= n_max:
            found[n] = ratio
    return found
