"""Parts of `WaveTable` of known places by numpy, order by order: no program for each new size."""

import numpy as np
from jaxtyping import Float

from ...special import hankel_rows


def known_at_detectors(
    x: Float[np.ndarray, " f"], steps: Float[np.ndarray, "orders f"]
) -> Float[np.ndarray, "2 fewer f"]:
    """`waves.at_detectors` of detectors on a circle, x = lambda R_g."""
    steps = steps[:-1]
    rows = zip(*hankel_rows(x[:, None], steps), strict=True)
    j, y = (np.concatenate(kind, axis=1).T for kind in rows)
    scale = np.cumprod(steps, axis=0)
    return known_twice(len(steps))[:, None] * np.stack([j * scale**2, y])


def known_disk_norms(
    x: Float[np.ndarray, " f"], radius: float, steps: Float[np.ndarray, "more f"]
) -> Float[np.ndarray, "orders f"]:
    """`waves.disk_norms` of the cosines, x = lambda R."""
    j = np.stack([value[:, 0] for value, _ in hankel_rows(x[:, None], steps)])
    before = np.concatenate([-j[1:2] * steps[1], j[:-2] / steps[1:-1]])  # J_{-1} = -J_1
    slope = (before - j[1:] * steps[1:]) / 2
    norm = np.sqrt(np.pi * radius * (j[:-1] ** 2 + slope**2))
    norm[0] *= np.sqrt(2)
    return norm


def known_twice(n: int) -> Float[np.ndarray, " orders"]:
    """eps_n of n orders: 1 for order 0, else 2."""
    return np.where(np.arange(n) == 0, 1.0, 2.0)
