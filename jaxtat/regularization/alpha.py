"""Tikhonov's regularisation: how alpha of (A A^T + alpha) y = A G is chosen at each frequency.

One family for plans and for `solve`. A plan takes alpha as filter factors of singular components;
`solve` asks for `absolute`, with a look at the system and the data. A number is relative to
`table.alpha_unit` of the cylindrical waves at its frequency, or, on boundary traces, to 8/lambda²
(`single_crossing`, squared). A new rule is a class with the methods `factors` and `absolute`.
"""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_number, named, real_array, require_positive
from .rules import Regularization, Truncation, not_negative, per_frequency, single_crossing
from .solutions import spectrum

_HALVINGS = 60  # of an interval of 48, for the logarithm of alpha


class FrequencyData(eqx.Module):
    """The data of one frequency that rules may use.

    Attributes:
        matrix: A A^T, (blocks, r, r); None where it is not formed.
        plane: mean of u_xi u_xi^H over all directions, (blocks, r, r); None likewise.
        diagonal: of A A^T, (blocks, r).
        unit_norm: N(lambda) of the full circle [1/length^(1/2)].
        data_power: of √w (G_J, G_Y), mean square over detectors and images.
        noise_power: the same for white noise of unit standard deviation in g.
        single_crossing: singular value of a wave that crosses the detectors once and squarely, by
            `rules.single_crossing`, in space by `spherical.alpha.single_crossing_in_space`.
        unit: what a number as alpha is relative to.
        n_data: how many numbers √w (G_J, G_Y) are.
    """

    matrix: Float[Array, "blocks r r"] | None
    plane: Float[Array, "blocks r r"] | None
    diagonal: Float[Array, "blocks r"]
    unit_norm: Float[Array, ""]
    data_power: Float[Array, ""]
    noise_power: Float[Array, ""]
    single_crossing: Float[Array, ""]
    unit: Float[Array, ""]
    n_data: int = eqx.field(static=True)


class TikhonovRule(Regularization):
    """phi = sigma² / (sigma² + alpha); arrays are scalars or have one entry per frequency."""

    needs_matrix: ClassVar[bool] = False  # whether `absolute` asks for matrix and plane
    needs_noise: ClassVar[bool] = True  # whether it asks for the power of data or noise

    @abstractmethod
    def absolute(self, data: FrequencyData) -> Float[Array, ""]:
        """alpha, in the unit of A A^T."""


class Tikhonov(TikhonovRule):
    """phi = sigma² / (sigma² + alpha).

    alpha is relative: in units of the strongest cylindrical wave at each frequency
    (`cylindrical_waves.table.alpha_unit`), or of 8 / lambda² in the basis of the boundary. 1e-12
    suits exact data, 1e-3 noisy ones. A plain number as a rule means this rule. `filtered_solve`
    takes alpha in [length²].

    Source: Tikhonov; e.g. Hansen, Rank-Deficient and Discrete Ill-Posed Problems (SIAM 1998).
    """

    has_unit = True
    needs_noise = False
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

    def absolute(self, data: FrequencyData) -> Array:
        return self.alpha * data.unit


class RelativeTikhonov(TikhonovRule):
    """`RelativeCutoff` without a step: phi = sigma² / (sigma² + 8 kappa² / lambda²)."""

    needs_noise = False
    kappa: Float[Array, "*each"]

    def __init__(self, kappa: Numbers):
        self.kappa = not_negative("kappa", kappa)

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        raise ValueError("RelativeTikhonov needs the frequency: call in_units_of beforehand.")

    def in_units_of(self, square: Array, frequency: Array) -> "Tikhonov":
        return Tikhonov((self.kappa * single_crossing(frequency)) ** 2)

    def absolute(self, data: FrequencyData) -> Array:
        return (self.kappa * data.single_crossing) ** 2


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
            "NoiseLevel(sigma)), or build_plan with Tikhonov(solution.report.relative_alpha) of it."
        )

    def absolute(self, data: FrequencyData) -> Array:
        noise = self.sigma**2 * data.noise_power
        # where noise drowns the data a hundredth of it may still be signal
        signal = jnp.maximum(data.data_power - noise, 0.01 * noise)
        return noise / signal * jnp.sum(data.diagonal) / data.n_data


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

    def absolute(self, data: FrequencyData) -> Array:
        if data.matrix is None or data.plane is None:
            raise ValueError(
                "TikhonovNormBound needs the matrix of every frequency in cylindrical waves: use a "
                "region that they reach, or build_plan, or take a number, NoiseLevel(sigma) or "
                "RelativeTikhonov(kappa)."
            )
        return _alpha_of_matrix(data.matrix, data.plane, (self.K * data.unit_norm) ** 2)


def tikhonov_rule(rule: Any, n_frequencies: int) -> TikhonovRule:
    """The rule for what a user gives to `solve`, with one entry per frequency in every array."""
    if isinstance(rule, Truncation):
        raise ValueError(
            f"{type(rule).__name__} keeps or drops singular components, which only a plan forms: "
            f"use build_plan(setup, {type(rule).__name__}(...)), or {rule.counterpart} here."
        )
    if isinstance(rule, Regularization) and not isinstance(rule, TikhonovRule):
        raise ValueError(
            f"{type(rule).__name__} is a rule for plans: reconstruct(build_plan(setup, rule), g). "
            "Without a plan a rule is a TikhonovRule, with `absolute`."
        )
    if not isinstance(rule, TikhonovRule) and not is_number(rule):
        raise ValueError(
            f"rule is {named(rule)}, expected alpha, a number or one for each frequency, or a rule "
            "such as NoiseLevel(sigma) or RelativeTikhonov(0.1)."
        )
    if not isinstance(rule, TikhonovRule):
        value = real_array("alpha", rule, None)
        require_positive("alpha", value)
        rule = Tikhonov(value)
    for name in ("alpha", "kappa"):
        if hasattr(rule, name):
            require_positive(name, getattr(rule, name))
    return per_frequency(rule, n_frequencies)


def _norm(s: Array, alpha: Array) -> Array:
    """f(s, alpha), of which ||A^T (A A^T + alpha)^-1 u||² = Σ_j f(s_j, alpha) (p_j·u)²."""
    return s / (s + alpha) ** 2


def _divided(s: Array, t: Array, alpha: Array) -> Array:
    """(f(s, alpha) - f(t, alpha)) / (s - t); df / ds where s = t."""
    return (alpha**2 - s * t) / ((s + alpha) * (t + alpha)) ** 2


@jax.custom_jvp
def alpha_of_norm(
    eigenvalues: Float[Array, "*k"], weights: Float[Array, "*k"], square: Float[Array, ""]
) -> Float[Array, ""]:
    """alpha with Σ_j f(s_j, alpha) w_j = square, between 1e-15 and 1e6 times the largest s.

    Args:
        eigenvalues: s_j of A A^T.
        weights: w_j, mean squares of p_j·u.
        square: of the norm. Where it is not reached alpha is one of the two bounds.
    """
    largest = eigenvalues.max()
    largest = jnp.where(largest > 0, largest, 1.0)
    lower, upper = jnp.log(1e-15 * largest), jnp.log(1e6 * largest)
    aim = jnp.maximum(square, jnp.finfo(square.dtype).tiny)

    def halved(_: Array, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        below, above = bounds
        middle = (below + above) / 2
        too_small = jnp.sum(_norm(eigenvalues, jnp.exp(middle)) * weights) > aim
        return jnp.where(too_small, middle, below), jnp.where(too_small, above, middle)

    # to the last bit; no call of Python, by which libraries check bounds and for which threads wait
    below, above = jax.lax.fori_loop(0, _HALVINGS, halved, (lower, upper))
    return jnp.exp((below + above) / 2)


@alpha_of_norm.defjvp
def _(primals: tuple[Array, ...], tangents: tuple[Array, ...]):
    # implicit differentiation of F(alpha, s, w) = square
    eigenvalues, weights, square = primals
    d_eigenvalues, d_weights, d_square = tangents
    alpha = alpha_of_norm(*primals)
    change = jnp.sum(_norm(eigenvalues, alpha) * d_weights)
    change += jnp.sum(_divided(eigenvalues, eigenvalues, alpha) * weights * d_eigenvalues)
    return alpha, _implicit(eigenvalues, weights, alpha, square, d_square - change)


def _implicit(
    eigenvalues: Array, weights: Array, alpha: Array, square: Array, change: Array
) -> Array:
    """dalpha = change / (dF / dalpha), and 0 where alpha is a bound."""
    values, slopes = jax.jvp(lambda a: _norm(eigenvalues, a), (alpha,), (jnp.ones_like(alpha),))
    reached = jnp.abs(jnp.sum(values * weights) - square) < 1e-6 * square
    return jnp.where(reached, change / jnp.where(reached, jnp.sum(slopes * weights), 1.0), 0.0)


@jax.custom_jvp
def _alpha_of_matrix(
    matrix: Float[Array, "blocks r r"], plane: Float[Array, "blocks r r"], square: Array
) -> Array:
    """alpha with tr(plane f(matrix, alpha)) = square.

    With matrix = V diag(s) V^T the trace is Σ_j f(s_j, alpha) (V^T plane V)_jj.
    """
    eigenvalues, vectors = spectrum(matrix)
    weights = jnp.einsum("bij,bik,bkj->bj", vectors, plane, vectors)
    return alpha_of_norm(eigenvalues, weights, square)


@_alpha_of_matrix.defjvp
def _(primals: tuple[Array, ...], tangents: tuple[Array, ...]):
    # Implicit differentiation of F(alpha, matrix, plane) = square. The derivative of f(matrix) is
    # made of (f(s_i) - f(s_j)) / (s_i - s_j), which exists where eigenvalues coincide (Daleckii and
    # Krein; Bhatia, Matrix Analysis (1997), theorem V.3.3).
    matrix, plane, square = primals
    matrix_dot, plane_dot, square_dot = tangents
    alpha = _alpha_of_matrix(*primals)
    eigenvalues, vectors = spectrum(matrix)

    def turned(matrix: Array) -> Array:
        return jnp.swapaxes(vectors, -1, -2) @ matrix @ vectors

    def diagonal(matrix: Array) -> Array:
        return jnp.diagonal(matrix, axis1=-2, axis2=-1)

    rows, columns, here = eigenvalues[:, :, None], eigenvalues[:, None, :], turned(plane)
    change = jnp.sum(_divided(rows, columns, alpha) * here * turned(matrix_dot))
    change += jnp.sum(_norm(eigenvalues, alpha) * diagonal(turned(plane_dot)))
    return alpha, _implicit(eigenvalues, diagonal(here), alpha, square, square_dot - change)
