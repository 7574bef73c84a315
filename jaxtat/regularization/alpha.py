"""Tikhonov's regularisation: how alpha of (A A^T + alpha) y = A G is chosen at each frequency.

One family for plans and for `solve`. A plan takes alpha as filter factors of singular components;
`solve` asks for `absolute`, with a look at the system and the data. A number is relative to
`table.alpha_unit` of the cylindrical waves at its frequency, or, on boundary traces, to 8/lambda²
(`seen_once`, squared). A new rule is a class with the methods `factors` and `absolute`.
"""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.checks import Numbers, real_array, require_positive
from .rules import Regularization, Truncation, not_negative, per_frequency, seen_once


class Problem(eqx.Module):
    """The data of one frequency that rules may use.

    Attributes:
        matrix: A A^T, (blocks, r, r); None where it is not formed.
        plane: mean of u_xi u_xi^H over all directions, (blocks, r, r); None likewise.
        diagonal: of A A^T, (blocks, r).
        unit_norm: N(lambda) of the full circle [1/length^(1/2)].
        data_power: of √w (G_J, G_Y), mean square over detectors and images.
        noise_power: the same for white noise of unit standard deviation in g.
        seen_once: singular value of a wave that the detectors see once and squarely, in the plane
            `rules.seen_once`, in space `spherical.alpha.seen_once`.
        unit: what a number as alpha is relative to.
        n_data: how many numbers √w (G_J, G_Y) are.
    """

    matrix: Float[Array, "blocks r r"] | None
    plane: Float[Array, "blocks r r"] | None
    diagonal: Float[Array, "blocks r"]
    unit_norm: Float[Array, ""]
    data_power: Float[Array, ""]
    noise_power: Float[Array, ""]
    seen_once: Float[Array, ""]
    unit: Float[Array, ""]
    n_data: int = eqx.field(static=True)


class TikhonovRule(Regularization):
    """phi = sigma² / (sigma² + alpha); arrays are scalars or have one entry per frequency."""

    needs_matrix: ClassVar[bool] = False  # whether `absolute` asks for matrix and plane

    @abstractmethod
    def absolute(self, problem: Problem) -> Float[Array, ""]:
        """alpha, in the unit of A A^T."""


class Tikhonov(TikhonovRule):
    """phi = sigma² / (sigma² + alpha).

    alpha is relative: in units of the strongest cylindrical wave at each frequency
    (`harmonic.table.alpha_unit`), or of 8 / lambda² in the basis of the boundary. 1e-12 suits exact
    data, 1e-3 noisy ones. A plain number as a rule means this rule. `filtered_solve` takes alpha in
    [length²].

    Source: Tikhonov; e.g. Hansen, Rank-Deficient and Discrete Ill-Posed Problems (SIAM 1998).
    """

    has_unit = True
    alpha: Float[Array, "*each"]

    def __init__(self, alpha: Numbers):
        self.alpha = not_negative("alpha", alpha)

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        square = sigma**2
        total = square + self.alpha
        shrunk = square / jnp.where(total > 0, total, 1.0)
        return jnp.broadcast_to(shrunk[:, None], size.shape)

    def slope(self, sigma: Array) -> Array:
        total = sigma**2 + self.alpha
        return jnp.where(total > 0, self.alpha / jnp.where(total > 0, total, 1.0) ** 2, 0.0)

    def in_units_of(self, square: Array, frequency: Array) -> "Tikhonov":
        return Tikhonov(self.alpha * square)

    def absolute(self, problem: Problem) -> Array:
        return self.alpha * problem.unit


class RelativeTikhonov(TikhonovRule):
    """`RelativeCutoff` without a step: phi = sigma² / (sigma² + 8 kappa² / lambda²)."""

    kappa: Float[Array, "*each"]

    def __init__(self, kappa: Numbers):
        self.kappa = not_negative("kappa", kappa)

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        raise ValueError("RelativeTikhonov needs the frequency: call in_units_of beforehand.")

    def in_units_of(self, square: Array, frequency: Array) -> "Tikhonov":
        return Tikhonov((self.kappa * seen_once(frequency)) ** 2)

    def absolute(self, problem: Problem) -> Array:
        return (self.kappa * problem.seen_once) ** 2


class NoiseLevel(TikhonovRule):
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

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        raise ValueError(
            "NoiseLevel looks at the data, which a plan has not seen: use solve(setup, g, "
            "NoiseLevel(sigma)), or build_plan with Tikhonov(found.report.relative_alpha) of it."
        )

    def absolute(self, problem: Problem) -> Array:
        noise = self.sigma**2 * problem.noise_power
        # where noise drowns the data a hundredth of it may still be signal
        signal = jnp.maximum(problem.data_power - noise, 0.01 * noise)
        return noise / signal * jnp.sum(problem.diagonal) / problem.n_data


class TikhonovNormBound(TikhonovRule):
    """`Tikhonov` with the alpha for which the root mean square of ||rho|| is K N(lambda).

    The mean is that over all directions: alpha is one number for each frequency.

    Source: the discrepancy principle's counterpart for the norm; Hansen, Rank-Deficient and
    Discrete Ill-Posed Problems (SIAM 1998), section 5.1.
    """

    needs_matrix = True
    K: Float[Array, "*each"]

    def __init__(self, K: Numbers):
        self.K = not_negative("K", K)

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        return self.chosen(sigma, size, unit_norm).factors(sigma, size, unit_norm)

    def chosen(
        self, sigma: Array, size: Array, unit_norm: Array, excess: Array | float = 0.0
    ) -> Tikhonov:
        weights = sigma**2 * jnp.mean(size**2, axis=-1)
        square = jnp.mean((self.K * unit_norm) ** 2) - excess
        return Tikhonov(alpha_of_norm(sigma**2, weights, square))

    def absolute(self, problem: Problem) -> Array:
        if problem.matrix is None or problem.plane is None:
            raise ValueError(
                "TikhonovNormBound needs the matrix of every frequency in cylindrical waves: use "
                "solver='cholesky' and a region that they reach, or build_plan, or take a number, "
                "NoiseLevel(sigma) or RelativeTikhonov(kappa)."
            )
        square = (self.K * problem.unit_norm) ** 2
        return _alpha_of_matrix(problem.matrix, problem.plane, square)


def tikhonov_rule(rule: Any, n_frequencies: int) -> TikhonovRule:
    """The rule for what a user gives to `solve`, with one entry per frequency in every array."""
    if isinstance(rule, Truncation):
        raise ValueError(
            f"{type(rule).__name__} keeps or drops singular components, which only a plan forms: "
            f"use build_plan(setup, {type(rule).__name__}(...)), or {rule.counterpart} here."
        )
    if not isinstance(rule, TikhonovRule):
        value = real_array("alpha", rule, None)
        require_positive("alpha", value)
        rule = Tikhonov(value)
    for name in ("alpha", "kappa"):
        if hasattr(rule, name):
            require_positive(name, getattr(rule, name))
    return per_frequency(rule, n_frequencies)


@jax.custom_jvp
def alpha_of_norm(
    eigenvalues: Float[Array, "*k"], weights: Float[Array, "*k"], square: Float[Array, ""]
) -> Float[Array, ""]:
    """alpha with Σ_j l_j w_j / (l_j + alpha)² = square, between 1e-15 and 1e6 times the largest l.

    Args:
        eigenvalues: l_j of A A^T.
        weights: w_j, mean squares of p_j·u.
        square: of the norm. Where it is not reached alpha is one of the two bounds.
    """
    largest = eigenvalues.max()
    largest = jnp.where(largest > 0, largest, 1.0)
    lower, upper = jnp.log(1e-15 * largest), jnp.log(1e6 * largest)

    def excess(log_alpha: Array, _: None) -> Array:
        alpha = jnp.exp(log_alpha)
        norm = jnp.sum(eigenvalues * weights / (eigenvalues + alpha) ** 2)
        # at the bounds the sign is given, so that a bound is found where the norm is never reached
        edge = jnp.where(log_alpha <= lower, 1.0, 0.0) - jnp.where(log_alpha >= upper, 1.0, 0.0)
        return jnp.where(edge == 0, jnp.log(norm / square), edge)

    import optimistix as optx  # slow to import

    solver = optx.Bisection(rtol=1e-12, atol=1e-12)
    options = {"lower": lower, "upper": upper}
    found = optx.root_find(
        excess, solver, (lower + upper) / 2, options=options, max_steps=64, throw=False
    )
    return jnp.exp(found.value)


@alpha_of_norm.defjvp
def _(primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]):
    # implicit differentiation of F(alpha, l, w) = square, but none at the bounds
    eigenvalues, weights, square = primals
    d_eigenvalues, d_weights, d_square = tangents
    alpha = alpha_of_norm(*primals)
    inverse = 1 / (eigenvalues + alpha)
    terms = eigenvalues * weights * inverse**2
    slope = -2 * jnp.sum(terms * inverse)
    change = jnp.sum((alpha - eigenvalues) * inverse**3 * weights * d_eigenvalues)
    change += jnp.sum(eigenvalues * inverse**2 * d_weights)
    reached = jnp.abs(jnp.sum(terms) - square) < 1e-6 * square
    slope = jnp.where(reached, slope, 1.0)
    return alpha, jnp.where(reached, (d_square - change) / slope, 0.0)


@jax.custom_jvp
def _alpha_of_matrix(matrix: Array, plane: Array, square: Array) -> Array:
    """alpha with tr(plane H^-1 matrix H^-1) = square, H = matrix + alpha.

    With matrix = V diag(l) V^T the trace is Σ_j l_j (V^T plane V)_jj / (l_j + alpha)².
    """
    eigenvalues, vectors = jnp.linalg.eigh(matrix)
    weights = jnp.einsum("bij,bik,bkj->bj", vectors, plane, vectors)
    return alpha_of_norm(jnp.maximum(eigenvalues, 0.0), weights, square)


@_alpha_of_matrix.defjvp
def _(primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]):
    # Implicit differentiation of F(alpha, matrix, plane) = square. With f(l) = l / (l + alpha)² the
    # derivative of f(matrix) is made of (f(l_i) - f(l_j)) / (l_i - l_j), which exists where
    # eigenvalues coincide (Daleckii and Krein; Bhatia, Matrix Analysis (1997), theorem V.3.3).
    matrix, plane, square = primals
    matrix_dot, plane_dot, square_dot = tangents
    alpha = _alpha_of_matrix(matrix, plane, square)
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
