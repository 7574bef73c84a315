"""Filter factors: which singular components of a solution are kept. No physics in here.

With A = P diag(sigma) Q^T and phi in [0, 1] the system A q ≈ u is solved (see `filtered_solve`) by

    q = Q diag(phi_j / sigma_j) P^T u,

where phi may depend on the singular values and on the coefficients |P^T u| of each right-hand
side. A new regularisation is a class with a method `factors`, which sees one frequency; its
parameters are numbers, or arrays with one entry for each frequency of a plan.
"""

from abc import abstractmethod
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, by_library, is_concrete, real_array


class Regularization(eqx.Module):
    """How much of each singular component is kept."""

    by_direction: ClassVar[bool] = False  # whether phi differs between right-hand sides
    has_unit: ClassVar[bool] = False  # whether plans measure alpha in that of A A^T

    @abstractmethod
    def factors(
        self,
        sigma: Float[Array, " rank"],
        size: Float[Array, "rank rhs"],
        unit_norm: Float[Array, "*one_or_rhs"],
    ) -> Float[Array, "rank rhs"]:
        """phi_j for every right-hand side.

        Args:
            sigma: singular values, descending.
            size: norms |p_j·u| / sigma_j that each component would add to the solution.
            unit_norm: the norm in which bounds on solutions are expressed, N(lambda), for all or
                each of the right-hand sides.
        """

    def slope(self, sigma: Float[Array, "*k"]) -> Float[Array, "*k"]:
        """dphi / d(sigma²) where phi is a smooth function of sigma; 0 for rules made of steps."""
        return jnp.zeros_like(sigma)

    def chosen(
        self,
        sigma: Float[Array, " rank"],
        size: Float[Array, "rank rhs"],
        unit_norm: Float[Array, "*one_or_rhs"],
        excess: Array | float = 0.0,
    ) -> "Regularization":
        """The rule that is used, for one that chooses among others by the norm of solutions.

        Args:
            sigma, size, unit_norm: as in `factors`.
            excess: of the mean square of the norm over what follows from sigma and size.
        """
        return self

    def in_units_of(self, square: Array, frequency: Array) -> "Regularization":
        """The rule for `factors` from the one of a plan, if that has a unit.

        Args:
            square: the unit of alpha at one or all frequencies [length²].
            frequency: lambda [rad/length].
        """
        return self


class Truncation(Regularization):
    """Rules that keep or drop components: for plans, which form the components.

    Attributes:
        counterpart: the smooth rule that `solve` takes instead, in words.
    """

    counterpart: ClassVar[str]


class NormBound(Truncation):
    """The paper's rule: the most terms for which ||rho|| <= K N(lambda), for each direction.

    N(lambda) is the norm of the least densities on a full circle (`special.full_circle_norm`), so
    K is dimensionless; for detectors that lie on no circle it is `microlocal_norm`, by direction.
    On an open arc most wave fronts pass the curve once instead of twice and K must exceed √2. The
    formula printed in the paper lacks a factor 1/(2π R_g) under the root;
    its K = 1.5 at R_g = 1.3 is K = 1.5 √(2π·1.3) = 4.287 here.

    The first term that would exceed the bound is admitted with the fraction that reaches it, which
    makes solutions continuous in K; ``fractional=False`` drops it as the paper does.

    Each term that enters leaves a kink, so that the slope of an image's error in K says little of
    its trend. With a ``softness`` s the solution is the mean of those with bounds K' around K, K'²
    from (1 - s) K² to (1 + s) K², those near K counting most: K' reaches s/2 to either side. Its
    norm is at most the mean of theirs, so that the bound still holds, and its slopes are means too.

    Args:
        K: a number, or one for each frequency.
        fractional: whether to admit a part of the first term that does not fit.
        softness: 0 for a sharp edge, or 0.001 to 1, a number or one for each frequency.

    Source: Kunyansky 2008, section 3.2.
    """

    counterpart = "TikhonovNormBound(K)"
    by_direction = True
    K: Float[Array, "*each"]
    fractional: bool = eqx.field(static=True)
    softness: Float[Array, "*each"] | None

    def __init__(self, K: Numbers, *, fractional: bool = True, softness: Numbers = 0.0):
        self.K = not_negative("K", K)
        self.fractional = fractional
        self.softness = _soft_edge(softness, 1e-3, 1.0)
        if self.softness is not None and not fractional:
            raise ValueError("softness is the mean of fractions: leave out fractional=False.")

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        square, bound = size**2, (self.K * unit_norm) ** 2
        before = jnp.cumsum(square, axis=0) - square
        if self.softness is not None:
            return _mean_fraction(bound - before, square, self.softness * bound)
        left = bound - before
        fits = left >= square
        if not self.fractional:
            # the sum only grows, but its rounding may not: nothing after the first refusal
            return jnp.cumprod(fits.astype(size.dtype), axis=0)
        partly = ~fits & (left > 0) & (square > 0)
        fraction = jnp.sqrt(jnp.where(partly, left / jnp.where(partly, square, 1.0), 1.0))
        return jnp.where(fits, 1.0, jnp.where(partly, fraction, 0.0))


def _mean_fraction(left: Array, square: Array, half_width: Array) -> Array:
    """Mean of √(x / square), cut to 0 and 1, over x in a hat of this half width around ``left``.

    The hat is the second difference of 1, so the mean is that of F with F'' = √(x / square):
    4/15 x^(5/2) / √square below ``square``, and its quadratic continuation above.
    """
    none, all_of_it = left <= -half_width, left >= square + half_width
    unit = jnp.where(half_width > 0, half_width, 1.0)
    end = square / unit

    def twice_integrated(x: Array) -> Array:
        rises = (x > 0) & (x < end)
        ratio = jnp.where(rises, x, 1.0) / jnp.where(rises, end, 1.0)
        beyond = x - end
        above = 4 / 15 * end**2 + beyond * (2 / 3 * end + beyond / 2)
        inside = 4 / 15 * jnp.where(rises, x, 0.0) ** 2 * jnp.sqrt(ratio)
        return jnp.where(x >= end, jnp.where(x > 0, above, 0.0), inside)

    x = left / unit
    mean = twice_integrated(x + 1) - 2 * twice_integrated(x) + twice_integrated(x - 1)
    return jnp.where(none, 0.0, jnp.where(all_of_it, 1.0, jnp.clip(mean, 0.0, 1.0)))


class FixedRank(Truncation):
    """The j_max largest singular values; of a real-valued j_max the remainder as a fraction.

    With a ``softness`` s the mean of the solutions with ranks j' from j_max - s/2 to j_max + s/2,
    those near j_max counting most, as in `NormBound`: smooth in j_max, with as many terms in all.

    Args:
        j_max: a number, or one for each frequency.
        softness: 0 for a sharp edge, or at least 0.01 terms.
    """

    counterpart = "Tikhonov(alpha)"
    j_max: Float[Array, "*each"]
    softness: Float[Array, "*each"] | None

    def __init__(self, j_max: Numbers, *, softness: Numbers = 0.0):
        self.j_max = not_negative("j_max", j_max)
        self.softness = _soft_edge(softness, 1e-2, np.inf)

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        left = self.j_max - jnp.arange(sigma.shape[0])
        whole = jnp.clip(left, 0.0, 1.0)
        if self.softness is not None:
            whole = _mean_part(left, self.softness / 2)
        return jnp.broadcast_to(whole[:, None], size.shape)


def _mean_part(left: Array, half_width: Array) -> Array:
    """Mean of x, cut to 0 and 1, over x in a hat of this half width around ``left``."""

    def twice_integrated(x: Array) -> Array:
        return (jnp.maximum(x, 0.0) ** 3 - jnp.maximum(x - 1 / half_width, 0.0) ** 3) / 6

    x = left / half_width
    mean = twice_integrated(x + 1) - 2 * twice_integrated(x) + twice_integrated(x - 1)
    inside = (x > -1) & (left < 1 + half_width)
    return jnp.where(inside, jnp.clip(half_width * mean, 0.0, 1.0), jnp.where(x > 0, 1.0, 0.0))


class SingularValueCutoff(Truncation):
    """Singular values of at least sigma_min, those of `single_layer.potential_matrix` [length].

    Of the first value below it the fraction log(sigma_k / sigma_min) / log(sigma_k / sigma_{k+1})
    is kept, which makes solutions continuous in sigma_min; ``fractional=False`` keeps none.
    """

    counterpart = "Tikhonov(alpha)"
    sigma_min: Float[Array, "*each"]
    fractional: bool = eqx.field(static=True)

    def __init__(self, sigma_min: Numbers, *, fractional: bool = True):
        self.sigma_min = not_negative("sigma_min", sigma_min)
        self.fractional = fractional

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        kept = (sigma >= self.sigma_min).astype(size.dtype)
        if self.fractional:
            tiny = jnp.finfo(sigma.dtype).tiny
            before = jnp.concatenate([jnp.zeros(1), sigma[:-1]])
            first = (sigma < self.sigma_min) & (before >= self.sigma_min)
            above = jnp.where(first, before, 1.0)
            whole = jnp.log(above / jnp.where(first, jnp.maximum(sigma, tiny), 0.5))
            part = jnp.log(above / jnp.where(first, self.sigma_min, 1.0))
            kept = jnp.where(first, part / whole, kept)
        return jnp.broadcast_to(kept[:, None], size.shape)


DEFAULT_KAPPA = 0.1
"""The default kappa of `RelativeCutoff` where the paper's assumptions fail, see `build_plan`."""


def single_crossing(frequency: Array) -> Array:
    """2 √2 / lambda: the singular value of a wave that crosses the curve once and squarely.

    A wave packet on lines of transverse weight W has 2 √(2 W) / lambda: its traces on the boundary
    have the mean square 4, where it enters and where it leaves, its densities lambda² / (2 W).
    """
    return 2 * jnp.sqrt(2.0) / frequency


class RelativeCutoff(Truncation):
    """Singular values above kappa 2 √2 / lambda: waves crossing the curve with a weight > kappa².

    2 √2 / lambda is the singular value of a wave that crosses the curve once and squarely, for
    any curve and region. So kappa needs no norm, and has the same meaning where part of the region
    is not seen: what no detector records is left out, and the rest is kept. kappa = 0.1 suits noise
    of some per cent or of unknown level (with a known one `NoiseLevel` is better), and regions that
    are not wholly seen; 0.01 suits exact data of regions that are. `RelativeTikhonov` is the same
    without a step.
    """

    counterpart = "RelativeTikhonov(kappa)"
    kappa: Float[Array, "*each"]

    def __init__(self, kappa: Numbers):
        self.kappa = not_negative("kappa", kappa)

    def factors(self, sigma: Array, size: Array, unit_norm: Array) -> Array:
        raise ValueError("RelativeCutoff needs the frequency: call in_units_of beforehand.")

    def in_units_of(self, square: Array, frequency: Array) -> "SingularValueCutoff":
        return SingularValueCutoff(self.kappa * single_crossing(frequency))


_Rule = TypeVar("_Rule", bound=eqx.Module | None)


def per_frequency(rule: _Rule, n_frequencies: int) -> _Rule:
    """The rule with one entry per frequency in every array, as `jax.lax.map` takes it.

    Raises:
        ValueError: for arrays that are neither numbers nor of this length.
    """
    for path, leaf in jax.tree_util.tree_leaves_with_path(rule):
        if leaf.shape not in ((), (n_frequencies,)):
            raise ValueError(
                f"{jax.tree_util.keystr(path, simple=True)} has shape {leaf.shape}, expected a "
                f"number or one per frequency ({n_frequencies},)."
            )

    def repeated(xp: Any, leaf: Any) -> Any:
        return xp.broadcast_to(leaf, (n_frequencies,))

    return jax.tree.map(lambda leaf: by_library(repeated, (leaf,)), rule)


def not_negative(name: str, value: Numbers) -> Array:
    """A number, or one per frequency."""
    value = real_array(name, value, None)
    if value.ndim > 1:
        raise ValueError(f"{name} has shape {value.shape}, expected a number or one per frequency.")
    if is_concrete(value) and np.asarray(value).min() < 0:
        raise ValueError(f"{name} is {float(value.min())}, expected a value of at least zero.")
    return value


def _soft_edge(softness: Numbers, least: float, most: float) -> Array | None:
    """The softness of an edge; None for a sharp one."""
    value = not_negative("softness", softness)
    if not is_concrete(value):
        return value
    if not np.any(np.asarray(value)):
        return None
    if np.asarray(value).min() < least or np.asarray(value).max() > most:
        raise ValueError(
            f"softness is {softness}, expected 0 for a sharp edge or at least {least:g}"
            f"{f' and at most {most:g}' if np.isfinite(most) else ''}."
        )
    return value
