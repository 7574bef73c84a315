"""The number of cylindrical waves that each frequency needs, and groups of frequencies.

Order n enters the potentials through J_n(lambda |x|) H_n(lambda |z|), which falls like
(|x|/|z|)^n / (π n) once n exceeds lambda |x|. Orders are kept until that is below `TOLERANCE`.
"""

from itertools import pairwise

import numpy as np

TOLERANCE = 1e-12  # of the potential of one detector, relative to its largest order
WORTH_A_GROUP = 1.5e8  # Σ N³: what the paper's size has six times, compiled in a second or two


def highest_orders(frequencies: np.ndarray, reach: float, distance: float) -> np.ndarray:
    """N(lambda): |J_n(lambda reach) H_n(lambda distance)| < 1e-12 of its maximum for n > N.

    From Debye's expansions (DLMF 10.19.3), J_n(n sech a) ~ exp(n (tanh a - a)) / sqrt(2 π n tanh a)
    and |Y_n| alike with the other sign: the term is exp(-decay) / (π n). The largest of
    all is about (2/π) / sqrt(lambda reach · lambda distance), or 1/π where these are small.

    Args:
        frequencies: lambda > 0 [rad/length].
        reach: largest |x| in the region [length].
        distance: least |z| of a detector, above ``reach`` [length].

    >>> highest_orders(np.array([1.57, 201.0]), 1.0, 1.3)
    array([ 93, 258])
    """
    last = int(1.2 * frequencies.max() * reach) + 200
    while True:
        n = np.arange(1, last + 1)[:, None]
        decay = _exponent(n, frequencies * reach) - _exponent(n, frequencies * distance)
        largest = np.maximum(1.0, frequencies * np.sqrt(reach * distance) / 2)
        # a factor of three covers what the expansions leave open around the turning points
        needed = decay + np.log(n / largest) < np.log(3 / TOLERANCE)
        if not needed[-1].any():
            return needed.sum(axis=0) + 1
        last *= 2


def frequency_groups(orders: np.ndarray, most: int) -> list[tuple[slice, int]]:
    """Neighbouring frequencies in at most ``most`` groups, each with its largest order.

    The work grows with N³, and every group is compiled by itself, which is not worth while for
    small problems. The bounds minimise the work Σ (b - a) N³ by dynamic programming: the least for
    all frequencies below b is that for those below some a < b, and one group more.
    """
    n = len(orders)
    n_groups = min(most, n, 1 + int(np.sum(orders**3.0) / WORTH_A_GROUP))
    work, starts = np.array([0.0, *[np.inf] * n]), []  # of the frequencies below each
    for _ in range(n_groups):
        before, work, start = work, np.full(n + 1, np.inf), np.zeros(n + 1, int)
        for b in range(1, n + 1):
            needed = np.maximum.accumulate(orders[b - 1 :: -1])[::-1]  # from each a < b to b
            each = before[:b] + np.arange(b, 0, -1) * needed**3.0
            start[b] = each.argmin()
            work[b] = each[start[b]]
        starts.append(start)
    bounds = [n]
    for start in reversed(starts):
        bounds.append(int(start[bounds[-1]]))
    return [(slice(a, b), int(orders[a:b].max())) for a, b in pairwise(reversed(bounds))]


def _exponent(n: np.ndarray, x: np.ndarray) -> np.ndarray:
    """n (a - tanh a), n sech a = x, for n > x: minus the logarithm of J_n(x); 0 for n <= x."""
    ratio = np.minimum(x / n, 1.0)
    tanh = np.sqrt(1 - ratio**2)
    return n * (np.arctanh(np.minimum(tanh, 1 - 1e-16)) - tanh)
