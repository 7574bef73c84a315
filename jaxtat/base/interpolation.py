"""Interpolation on equispaced nodes by quintic B-splines.

Row j + 2 of the table gives, in powers of the fraction 0 <= t < 1 of the way from node 0 to node 1,
the weight of node j = -2..3.
"""

import numpy as np
from jaxtyping import Array, Float

# Quintic B-spline: four times continuously differentiable, sixth order; takes coefficients, which
# follow from values by `quintic_prefilter`. Unser, IEEE Signal Process. Mag. 16(6) (1999) 22-38.
QUINTIC = (
    np.array(
        [
            [1, -5, 10, -10, 5, -1],
            [26, -50, 20, 20, -20, 5],
            [66, 0, -60, 0, 30, -10],
            [26, 50, 20, -20, -20, 10],
            [1, 5, 10, 10, 5, -5],
            [0, 0, 0, 0, 0, 1],
        ]
    )
    / 120
)


def polynomial(coefficients: list, t: Array) -> Array:
    """Σ_a c_a t^a, by Horner's rule."""
    total = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        total = total * t + c
    return total


def quintic_prefilter(phase: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Transfer function 60 / (33 + 26 cos(phase) + cos(2 phase)) from values to coefficients.

    Args:
        phase: angular frequency times the distance between nodes [rad].
    """
    return 60 / (33 + 26 * np.cos(phase) + np.cos(2 * phase))
