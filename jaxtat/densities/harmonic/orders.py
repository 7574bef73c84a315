"""How many cylindrical waves a frequency needs, and frequencies in groups of alike need.

Order n enters the potentials through J_n(lambda |x|) H_n(lambda |z|), which falls like
(|x|/|z|)^n / (π n) once n exceeds lambda |x|. Orders are kept until that is below `TOLERANCE`.
"""

from itertools import pairwise

import numpy as np

TOLERANCE = 1e-12  # of the potential of one detector, relative to its largest order
WORTH_A_GROUP = 1.5e8  # Σ N³: what the paper's size has six times, compiled in a second or two


def highest_orders(frequencies: np.ndarray, reach: float, distance: float) -> np.ndarray:
    """N(lambda): |J_n(lambda reach) H_n(lambda distance)| < TOLERANCE of its maximum for n > N.

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
    """Neighbouring frequencies in at most ``most`` groups, each with the orders of its last.

    With g groups, padding to the last N costs (1 + 1/g)² times the work of every frequency having
    its own, if that is like the cube of N; but every group is compiled by itself, which small
    problems do not repay.
    """
    n_groups = min(most, len(orders), 1 + int(np.sum(orders**3.0) / WORTH_A_GROUP))
    bounds = np.linspace(0, len(orders), n_groups + 1).round().astype(int)
    return [(slice(int(a), int(b)), int(orders[a:b].max())) for a, b in pairwise(bounds)]


def _exponent(n: np.ndarray, x: np.ndarray) -> np.ndarray:
    """n (a - tanh a), n sech a = x, for n > x: minus the logarithm of J_n(x); 0 for n <= x."""
    ratio = np.minimum(x / n, 1.0)
    tanh = np.sqrt(1 - ratio**2)
    return n * (np.arctanh(np.minimum(tanh, 1 - 1e-16)) - tanh)
