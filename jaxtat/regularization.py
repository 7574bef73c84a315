"""Filter factors: which singular components of a solution are kept. No physics in here.

With A = P diag(sigma) Q^T and phi in [0, 1] the system A q ≈ u is solved (see `filtered_solve`) by

    q = Q diag(phi_j / sigma_j) P^T u,

where phi may depend on the singular values and on the coefficients |P^T u| of each right-hand
side. A new regularisation is a class with a method `factors`.
"""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .checks import Numbers, is_concrete, real_array


class Regularization(eqx.Module):
    """How much of each singular component is kept."""

    by_direction: ClassVar[bool] = False  # whether phi differs between right-hand sides

    @abstractmethod
    def factors(
        self,
        sigma: Float[Array, " rank"],
        size: Float[Array, "rank rhs"],
        unit_norm: Float[Array, ""],
        largest: Float[Array, ""],
    ) -> Float[Array, "rank rhs"]:
        """phi_j for every right-hand side.

        Args:
            sigma: singular values, descending.
            size: norms |p_j·u| / sigma_j that each component would add to the solution.
            unit_norm: the norm in which bounds on solutions are expressed, N(lambda).
            largest: diagonal entry of A A^T, the unit of alpha.
        """

    def slope(self, sigma: Float[Array, "*k"], largest: Float[Array, ""]) -> Float[Array, "*k"]:
        """dphi / d(sigma²) where phi is a smooth function of sigma; 0 for rules made of steps."""
        return jnp.zeros_like(sigma)


class NormBound(Regularization):
    """The paper's rule: the most terms for which ||rho|| <= K N(lambda), for each direction.

    N(lambda) is the norm of the least densities on a full circle (`special.full_circle_norm`), so
    K is dimensionless. On an open arc most wave fronts pass the curve once instead of twice and
    K must exceed √2. The formula printed in the paper lacks a factor 1/(2π R_g) under the root;
    its K = 1.5 at R_g = 1.3 is K = 1.5 √(2π·1.3) = 4.287 here.

    The first term that would exceed the bound is admitted with the fraction that reaches it, which
    makes solutions continuous in K; ``fractional=False`` drops it as the paper does.

    Source: Kunyansky 2008, section 3.2.
    """

    by_direction = True
    K: Float[Array, ""]
    fractional: bool = eqx.field(static=True)

    def __init__(self, K: Numbers, *, fractional: bool = True):
        self.K = _not_negative("K", K)
        self.fractional = fractional

    def factors(self, sigma: Array, size: Array, unit_norm: Array, largest: Array) -> Array:
        square = size**2
        left = (self.K * unit_norm) ** 2 - (jnp.cumsum(square, axis=0) - square)
        fits = left >= square
        if not self.fractional:
            # the sum only grows, but its rounding may not: nothing after the first refusal
            return jnp.cumprod(fits.astype(size.dtype), axis=0)
        partly = ~fits & (left > 0) & (square > 0)
        fraction = jnp.sqrt(jnp.where(partly, left / jnp.where(partly, square, 1.0), 1.0))
        return jnp.where(fits, 1.0, jnp.where(partly, fraction, 0.0))


class FixedRank(Regularization):
    """The j_max largest singular values; of a real-valued j_max the remainder as a fraction."""

    j_max: Float[Array, ""]

    def __init__(self, j_max: Numbers):
        self.j_max = _not_negative("j_max", j_max)

    def factors(self, sigma: Array, size: Array, unit_norm: Array, largest: Array) -> Array:
        whole = jnp.clip(self.j_max - jnp.arange(sigma.shape[0]), 0.0, 1.0)
        return jnp.broadcast_to(whole[:, None], size.shape)


class SingularValueCutoff(Regularization):
    """Singular values of at least sigma_min, those of `single_layer.potential_matrix` [length].

    Of the first value below it the fraction log(sigma_k / sigma_min) / log(sigma_k / sigma_{k+1})
    is kept, which makes solutions continuous in sigma_min; ``fractional=False`` keeps none.
    """

    sigma_min: Float[Array, ""]
    fractional: bool = eqx.field(static=True)

    def __init__(self, sigma_min: Numbers, *, fractional: bool = True):
        self.sigma_min = _not_negative("sigma_min", sigma_min)
        self.fractional = fractional

    def factors(self, sigma: Array, size: Array, unit_norm: Array, largest: Array) -> Array:
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


class Tikhonov(Regularization):
    """phi = sigma² / (sigma² + alpha a), a the largest diagonal entry of A A^T in the waves' basis.

    The rule of `reconstruct_direct`, as a plan; for plans in cylindrical waves only.
    """

    alpha: Float[Array, ""]

    def __init__(self, alpha: Numbers):
        self.alpha = _not_negative("alpha", alpha)

    def factors(self, sigma: Array, size: Array, unit_norm: Array, largest: Array) -> Array:
        square = sigma**2
        total = square + self.alpha * largest
        shrunk = square / jnp.where(total > 0, total, 1.0)
        return jnp.broadcast_to(shrunk[:, None], size.shape)

    def slope(self, sigma: Array, largest: Array) -> Array:
        alpha = self.alpha * largest
        total = sigma**2 + alpha
        return jnp.where(total > 0, alpha / jnp.where(total > 0, total, 1.0) ** 2, 0.0)


def _not_negative(name: str, value: Numbers) -> Array:
    value = real_array(name, value, ())
    if is_concrete(value) and float(np.asarray(value)) < 0:
        raise ValueError(f"{name} is {float(value)}, expected a value of at least zero.")
    return value
