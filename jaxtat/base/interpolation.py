"""Interpolation on equispaced nodes: one table of polynomials per kernel.

The table of a cubic kernel is 4 x 4: row j + 1 gives, in powers of the fraction 0 <= t < 1 of the
way from node 0 to node 1, the weight of node j = -1, 0, 1, 2. That of a quintic one is 6 x 6, for
j = -2..3.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# Keys' cubic convolution, a = -1/2: interpolates, continuously differentiable, exact for
# parabolas, third order. Keys, IEEE Trans. ASSP 29 (1981) 1153-1160.
KEYS = np.array([[0, -1, 2, -1], [2, 0, -5, 3], [0, 1, 4, -3], [0, 0, -1, 1]]) / 2

# Straight lines between neighbours; 2 x 2, for nodes 0 and 1.
LINEAR = np.array([[1.0, -1.0], [0.0, 1.0]])

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


def cell_polynomials(kernel: np.ndarray, values: Float[Array, "*n nodes"]) -> list[Array]:
    """Interpolant between nodes j + 1 and j + 2, j = 0..nodes-4: four arrays, by powers of t.

    Many values are found faster from these than from weights: the four numbers of a cell are read
    at one index, and the compiler makes one loop of it.
    """
    cells = values.shape[-1] - 3
    shifted = [values[..., j : j + cells] for j in range(4)]
    return [jnp.stack(shifted, axis=-1) @ kernel[:, a] for a in range(4)]


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
