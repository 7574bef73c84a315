"""Tikhonov's regularisation: how alpha of (A A^T + alpha) y = A G is chosen at each frequency.

One family for plans and for `solve`. A plan takes alpha as filter factors of singular components;
`solve` asks for `absolute`, with a look at the system and the data. A number is relative to
`table.alpha_unit` of the cylindrical waves at its frequency, or, on boundary traces, to 8/lambda²
(`single_crossing`, squared). A new rule is a class with the methods `factors` and `absolute`.
"""

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_number, named, real_array, require_positive
from .rules import Excess, Regularization, Truncation, not_negative, per_frequency, single_crossing
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


class ByPlaneWaves(TikhonovRule):
    """`Tikhonov` with an alpha that is chosen by what becomes of all plane waves together."""

    needs_matrix = True

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        return self.chosen(sigma, size, unit_norm).factors(sigma, size, unit_norm)


class TikhonovNormBound(ByPlaneWaves):
    """`Tikhonov` with the alpha for which the root mean square of ||rho|| is K N(lambda).

    The mean is that over all directions: alpha is one number for each frequency.

    Source: the discrepancy principle's counterpart for the norm; Hansen, Rank-Deficient and
    Discrete Ill-Posed Problems (SIAM 1998), section 5.1.
    """

    K: Float[Array, "*each"]

    def __init__(self, K: Numbers):
        self.K = not_negative("K", K)

    def chosen(
        self,
        sigma: Array,
        size: Array,
        unit_norm: Array,
        excess: Excess = Excess(),  # noqa: B008
    ) -> Tikhonov:
        weights = sigma**2 * jnp.mean(size**2, axis=-1)
        square = jnp.mean((self.K * unit_norm) ** 2) - excess.norm
        return Tikhonov(alpha_where(NORM, sigma**2, weights, square))

    def absolute(self, data: FrequencyData) -> Array:
        matrix, plane = _matrices(self, data)
        square = (self.K * data.unit_norm) ** 2
        return _alphas_of_matrix((NORM,), matrix, plane, square[None])[0]


class ResidualTarget(ByPlaneWaves):
    """`Tikhonov` with the largest alpha whose residual is small enough, but no norm above K N.

    The residual is ||A rho - u|| / ||u|| of the traces u of plane waves. Its and the norm's squares
    are means over all directions: alpha is one number for each frequency. With a target for the
    residual alone, the discrepancy principle, the norm diverges where directions are not seen. With
    a bound on the norm alone, more noise than necessary passes where all are seen.

    Source: the discrepancy principle, Morozov, Soviet Math. Dokl. 7 (1966) 414-417, with a bound.
    """

    residual: Float[Array, "*each"]
    K: Float[Array, "*each"]

    def __init__(self, residual: Numbers = 1e-3, K: Numbers = 2.0):
        """residual: root mean square of ||A rho - u|| / ||u||; K: bound, in units of N(lambda)."""
        self.residual, self.K = not_negative("residual", residual), not_negative("K", K)

    def chosen(
        self,
        sigma: Array,
        size: Array,
        unit_norm: Array,
        excess: Excess = Excess(),  # noqa: B008
    ) -> Tikhonov:
        weights = sigma**2 * jnp.mean(size**2, axis=-1)
        total = jnp.sum(weights) + excess.rhs
        of_residual = self.residual**2 * total - excess.residual
        of_norm = jnp.mean((self.K * unit_norm) ** 2) - excess.norm
        wanted = alpha_where(RESIDUAL, sigma**2, weights, of_residual)
        return Tikhonov(jnp.maximum(wanted, alpha_where(NORM, sigma**2, weights, of_norm)))

    def absolute(self, data: FrequencyData) -> Array:
        matrix, plane = _matrices(self, data)
        total = jnp.sum(jnp.trace(plane, axis1=-2, axis2=-1))
        squares = self.residual**2 * total, (self.K * data.unit_norm) ** 2
        return _alphas_of_matrix((RESIDUAL, NORM), matrix, plane, jnp.stack(squares)).max()


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


class Measure(NamedTuple):
    """Σ_j f(s_j, alpha) w_j, by which alpha is chosen; s_j of A A^T, w_j mean squares of p_j·u.

    Attributes:
        f: of s and alpha.
        divided: (f(s, alpha) - f(t, alpha)) / (s - t) of s, t and alpha; df / ds where s = t.
        sign: 1 if f falls with alpha, -1 if it rises.
    """

    f: Callable[[Array, Array], Array]
    divided: Callable[[Array, Array, Array], Array]
    sign: int


NORM = Measure(
    f=lambda s, alpha: s / (s + alpha) ** 2,
    divided=lambda s, t, alpha: (alpha**2 - s * t) / ((s + alpha) * (t + alpha)) ** 2,
    sign=1,
)
"""||A^T (A A^T + alpha)^-1 u||²."""

RESIDUAL = Measure(
    f=lambda s, alpha: (alpha / (s + alpha)) ** 2,
    divided=lambda s, t, alpha: (
        -(alpha**2) * (s + t + 2 * alpha) / ((s + alpha) * (t + alpha)) ** 2
    ),
    sign=-1,
)
"""||A A^T (A A^T + alpha)^-1 u - u||²."""


def _matrices(rule: TikhonovRule, data: FrequencyData) -> tuple[Array, Array]:
    """A A^T and the mean of u u^H."""
    if data.matrix is None or data.plane is None:
        raise ValueError(
            f"{type(rule).__name__} needs the matrix of every frequency in cylindrical waves: use "
            "a region that they reach, or build_plan, or take a number, NoiseLevel(sigma) or "
            "RelativeTikhonov(kappa)."
        )
    return data.matrix, data.plane


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def alpha_where(
    measure: Measure,
    eigenvalues: Float[Array, "*k"],
    weights: Float[Array, "*k"],
    square: Float[Array, ""],
) -> Float[Array, ""]:
    """alpha with Σ_j f(s_j, alpha) w_j = square, between 1e-15 and 1e6 times the largest s.

    Args:
        measure: f.
        eigenvalues: s_j of A A^T.
        weights: w_j, mean squares of p_j·u.
        square: of norm or residual. Where it is not reached alpha is one of the two bounds.
    """
    largest = eigenvalues.max()
    largest = jnp.where(largest > 0, largest, 1.0)
    lower, upper = jnp.log(1e-15 * largest), jnp.log(1e6 * largest)
    aim = jnp.maximum(square, jnp.finfo(square.dtype).tiny)

    def halved(_: Array, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        below, above = bounds
        middle = (below + above) / 2
        reached = jnp.sum(measure.f(eigenvalues, jnp.exp(middle)) * weights)
        too_small = measure.sign * (reached - aim) > 0
        return jnp.where(too_small, middle, below), jnp.where(too_small, above, middle)

    # to the last bit; no call of Python, by which libraries check bounds and for which threads wait
    below, above = jax.lax.fori_loop(0, _HALVINGS, halved, (lower, upper))
    return jnp.exp((below + above) / 2)


@alpha_where.defjvp
def _(measure: Measure, primals: tuple[Array, ...], tangents: tuple[Array, ...]):
    # implicit differentiation of F(alpha, s, w) = square, but none at the bounds
    eigenvalues, weights, square = primals
    d_eigenvalues, d_weights, d_square = tangents
    alpha = alpha_where(measure, *primals)
    values, slopes = _with_slopes(measure, eigenvalues, alpha)
    change = jnp.sum(values * d_weights)
    change += jnp.sum(measure.divided(eigenvalues, eigenvalues, alpha) * weights * d_eigenvalues)
    total, slope = jnp.sum(values * weights), jnp.sum(slopes * weights)
    return alpha, _implicit(total, slope, square, d_square - change)


def _with_slopes(measure: Measure, eigenvalues: Array, alpha: Array) -> tuple[Array, Array]:
    """f and df / dalpha."""
    return jax.jvp(lambda alpha: measure.f(eigenvalues, alpha), (alpha,), (jnp.ones_like(alpha),))


def _implicit(total: Array, slope: Array, square: Array, change: Array) -> Array:
    """dalpha = change / slope, and 0 where alpha is a bound."""
    reached = jnp.abs(total - square) < 1e-6 * square
    return jnp.where(reached, change / jnp.where(reached, slope, 1.0), 0.0)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _alphas_of_matrix(
    measures: tuple[Measure, ...], matrix: Array, plane: Array, squares: Array
) -> Array:
    """alpha for each measure, with tr(plane f(matrix, alpha)) the given square.

    With matrix = V diag(s) V^T the trace is Σ_j f(s_j, alpha) (V^T plane V)_jj.
    """
    eigenvalues, vectors = spectrum(matrix)
    known = eigenvalues, jnp.einsum("bij,bik,bkj->bj", vectors, plane, vectors)
    alphas = (alpha_where(of, *known, square) for of, square in zip(measures, squares, strict=True))
    return jnp.stack(list(alphas))


@_alphas_of_matrix.defjvp
def _(measures: tuple[Measure, ...], primals: tuple[Array, ...], tangents: tuple[Array, ...]):
    # Implicit differentiation of F(alpha, matrix, plane) = square. The derivative of f(matrix) is
    # made of (f(s_i) - f(s_j)) / (s_i - s_j), which exists where eigenvalues coincide (Daleckii and
    # Krein; Bhatia, Matrix Analysis (1997), theorem V.3.3).
    matrix, plane, squares = primals
    matrix_dot, plane_dot, squares_dot = tangents
    alphas = _alphas_of_matrix(measures, *primals)
    eigenvalues, vectors = spectrum(matrix)

    def turned(matrix: Array) -> Array:
        return jnp.swapaxes(vectors, -1, -2) @ matrix @ vectors

    def diagonal(matrix: Array) -> Array:
        return jnp.diagonal(matrix, axis1=-2, axis2=-1)

    rows, columns = eigenvalues[:, :, None], eigenvalues[:, None, :]
    here, matrix_dot, plane_dot = turned(plane), turned(matrix_dot), diagonal(turned(plane_dot))

    def changed(measure: Measure, alpha: Array, square: Array, square_dot: Array) -> Array:
        values, slopes = _with_slopes(measure, eigenvalues, alpha)
        change = jnp.sum(measure.divided(rows, columns, alpha) * here * matrix_dot)
        change += jnp.sum(values * plane_dot)
        total, slope = jnp.sum(values * diagonal(here)), jnp.sum(slopes * diagonal(here))
        return _implicit(total, slope, square, square_dot - change)

    each = zip(measures, alphas, squares, squares_dot, strict=True)
    return alphas, jnp.stack([changed(*one) for one in each])
