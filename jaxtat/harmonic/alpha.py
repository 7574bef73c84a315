"""How much to regularise: alpha of (A A^T + alpha) y = A G, for each frequency.

A number is relative to `table.alpha_unit` of the cylindrical waves at its frequency,
or, on boundary traces, to 8 / lambda² (`seen_once`, squared). A new rule is a class with a method
`absolute`.
"""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..checks import Numbers, real_array, require_positive
from ..regularization import (
    NormBound,
    Regularization,
    RelativeCutoff,
    RelativeTikhonov,
    alpha_of_norm,
    per_frequency,
    seen_once,
)


class Problem(eqx.Module):
    """What rules may look at, at one frequency.

    Attributes:
        matrix: A A^T, (blocks, r, r); None where it is not formed.
        plane: mean of u_xi u_xi^H over all directions, (blocks, r, r); None likewise.
        diagonal: of A A^T, (blocks, r).
        unit_norm: N(lambda) of the full circle [1/length^(1/2)].
        data_power: of √w (G_J, G_Y), mean square over detectors and images.
        noise_power: the same for white noise of unit standard deviation in g.
        frequency: lambda [rad/length].
        unit: what a number as alpha is relative to.
        n_data: how many numbers √w (G_J, G_Y) are.
    """

    matrix: Float[Array, "blocks r r"] | None
    plane: Float[Array, "blocks r r"] | None
    diagonal: Float[Array, "blocks r"]
    unit_norm: Float[Array, ""]
    data_power: Float[Array, ""]
    noise_power: Float[Array, ""]
    frequency: Float[Array, ""]
    unit: Float[Array, ""]
    n_data: int = eqx.field(static=True)


class AlphaRule(eqx.Module):
    """Arrays are scalars or have one entry per frequency."""

    needs_matrix: ClassVar[bool] = False  # whether `absolute` asks for matrix and plane

    @abstractmethod
    def absolute(self, problem: Problem) -> Float[Array, ""]:
        """alpha, in the unit of A A^T."""


class RelativeAlpha(AlphaRule):
    """alpha times the problem's unit."""

    alpha: Float[Array, "*frequencies"]

    def absolute(self, problem: Problem) -> Array:
        return self.alpha * problem.unit


class SeenShare(AlphaRule):
    """alpha = 8 kappa² / lambda², see `RelativeCutoff`."""

    kappa: Float[Array, "*frequencies"]

    def absolute(self, problem: Problem) -> Array:
        return (self.kappa * seen_once(problem.frequency)) ** 2


class NoiseLevel(AlphaRule):
    """alpha = noise power / signal power: the mean square error is least for a random image.

    If the coefficients x of the image in the basis of A have variance tau² each, G = A^T x + noise,
    the best linear estimate is (A A^T + sigma_G² / tau²)^-1 A G. sigma_G² follows from the noise
    sigma of every sample of g, tau² from |G|² = tau² tr(A A^T) + |noise|² of the data themselves.

    Source: the Wiener filter; e.g. Tarantola, Inverse Problem Theory (SIAM 2005), section 3.2.
    """

    sigma: Float[Array, "*frequencies"]

    def __init__(self, sigma: Numbers):
        """sigma: standard deviation of the white noise of g, in the unit of g, above zero."""
        self.sigma = real_array("sigma", sigma, None)
        require_positive("sigma", self.sigma)

    def absolute(self, problem: Problem) -> Array:
        noise = self.sigma**2 * problem.noise_power
        # where noise drowns the data a hundredth of it may still be signal
        signal = jnp.maximum(problem.data_power - noise, 0.01 * noise)
        return noise / signal * jnp.sum(problem.diagonal) / problem.n_data


class MeanNorm(AlphaRule):
    """alpha for which the root mean square of ||rho|| over all directions is K N(lambda)."""

    needs_matrix = True
    K: Float[Array, "*frequencies"]

    def absolute(self, problem: Problem) -> Array:
        if problem.matrix is None or problem.plane is None:
            raise ValueError(
                "alpha from a norm bound needs the matrix of every frequency in cylindrical waves: "
                "use solver='cholesky' and a region that they reach, or build_plan, or give alpha "
                "as a number, a NoiseLevel or a RelativeCutoff."
            )
        return _alpha_of_norm(problem.matrix, problem.plane, (self.K * problem.unit_norm) ** 2)


def alpha_rule(alpha: Any, n_frequencies: int) -> AlphaRule:
    """The rule for what a user gives as alpha, with one entry per frequency in every array."""
    if isinstance(alpha, NormBound):
        rule: AlphaRule = MeanNorm(alpha.K)
    elif isinstance(alpha, RelativeCutoff | RelativeTikhonov):
        require_positive("kappa", alpha.kappa)
        rule = SeenShare(alpha.kappa)
    elif isinstance(alpha, AlphaRule):
        rule = alpha
    elif isinstance(alpha, Regularization):
        raise ValueError(
            f"alpha is a {type(alpha).__name__}, expected a number, RelativeCutoff(kappa), "
            "RelativeTikhonov(kappa), NoiseLevel(sigma) or NormBound(K); other rules are for plans."
        )
    else:
        value = real_array("alpha", alpha, None)
        require_positive("alpha", value)
        rule = RelativeAlpha(value)
    return per_frequency(rule, n_frequencies)


@jax.custom_jvp
def _alpha_of_norm(matrix: Array, plane: Array, square: Array) -> Array:
    """alpha with tr(plane H^-1 matrix H^-1) = square, H = matrix + alpha.

    With matrix = V diag(l) V^T the trace is Σ_j l_j (V^T plane V)_jj / (l_j + alpha)².
    """
    eigenvalues, vectors = jnp.linalg.eigh(matrix)
    weights = jnp.einsum("bij,bik,bkj->bj", vectors, plane, vectors)
    return alpha_of_norm(jnp.maximum(eigenvalues, 0.0), weights, square)


@_alpha_of_norm.defjvp
def _(primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]):
    # Implicit differentiation of F(alpha, matrix, plane) = square. With f(l) = l / (l + alpha)² the
    # derivative of f(matrix) is made of (f(l_i) - f(l_j)) / (l_i - l_j), which exists where
    # eigenvalues coincide (Daleckii and Krein; Bhatia, Matrix Analysis (1997), theorem V.3.3).
    matrix, plane, square = primals
    matrix_dot, plane_dot, square_dot = tangents
    alpha = _alpha_of_norm(matrix, plane, square)
    eigenvalues, vectors = jnp.linalg.eigh(matrix)

    def turned(matrix: Array) -> Array:
        return jnp.swapaxes(vectors, -1, -2) @ matrix @ vectors

    eigenvalues = jnp.maximum(eigenvalues, 0.0)
    inverse = 1 / (eigenvalues + alpha)
    turned_plane = turned(plane)
    terms = eigenvalues * inverse**2 * jnp.diagonal(turned_plane, axis1=-2, axis2=-1)
    slope = -2 * jnp.sum(terms * inverse)
    product = eigenvalues[:, :, None] * eigenvalues[:, None, :]
    divided = (alpha**2 - product) * (inverse[:, :, None] * inverse[:, None, :]) ** 2
    change = jnp.sum(divided * turned_plane * turned(matrix_dot))
    change += jnp.sum(
        eigenvalues * inverse**2 * jnp.diagonal(turned(plane_dot), axis1=-2, axis2=-1)
    )
    reached = jnp.abs(jnp.sum(terms) / square - 1) < 1e-6
    return alpha, jnp.where(reached, (square_dot - change) / slope, 0.0)
