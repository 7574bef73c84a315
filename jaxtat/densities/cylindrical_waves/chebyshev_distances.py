"""Waves at many distances from those at few: polynomials in the distance.

From the middle m of an interval m ± h, Graf's theorem along a line,

    H_n(lambda (m + s)) = Σ_k H_{n-k}(lambda m) J_k(lambda s),  |s| <= h < m,

holds as many terms as the waves of a disk of radius h have at the distance m, and polynomials of
that degree hold the function. Chebyshev's places in the interval give them.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from .orders import highest_orders

TO_SPARE = 2  # places beyond the number of terms: then the error is a third of rounding, or less


def few_distances(
    distances: Float[np.ndarray, " distances"], highest: float, dtype: Any
) -> tuple[Float[np.ndarray, " places"], Float[np.ndarray, "places distances"] | None]:
    """Distances at which waves are enough, and the matrix to the wanted ones.

    Args:
        distances: r > 0 [length].
        highest: frequency of the waves in r [rad/length].
        dtype: whose rounding is the accuracy.

    Returns:
        The places, and L with f(distances) = f(places) L; all distances and None where places are
        not fewer.

    >>> distances = np.linspace(1.2, 1.4, 100)
    >>> places, matrix = few_distances(distances, 30.0, np.float32)
    >>> error = np.abs(np.cos(30 * places) @ matrix - np.cos(30 * distances)).max()
    >>> len(places), bool(error < 1e-8)
    (16, True)
    """
    low, high = float(distances.min()), float(distances.max())
    middle, half = (low + high) / 2, max((high - low) / 2, 1e-6 * high)
    rounding = float(np.finfo(dtype).eps)
    terms = highest_orders(np.array([highest]), half, middle, rounding)
    n = int(terms[0]) + TO_SPARE
    if n >= len(distances):
        return distances, None
    angles = (np.arange(n) + 0.5) * np.pi / n
    nodes = np.cos(angles)
    # the polynomials T_k by their values at the nodes, where they are orthogonal
    k = np.arange(n)
    at = np.arccos(np.clip((distances - middle) / half, -1, 1))
    values = np.cos(k * angles[:, None]) * np.where(k == 0, 1, 2) / n
    return middle + half * nodes, values @ np.cos(k[:, None] * at)
