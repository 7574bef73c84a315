"""Filter factors, and the one regularised solve that uses them. No physics in here.

The system A q ≈ u is solved through A = P diag(sigma) Q^T with factors phi in [0, 1],

    q = Q diag(phi_j / sigma_j) P^T u,

where phi may depend on the singular values and on the coefficients |P^T u| of each right-hand
side. A new regularisation is a class with a method `factors`.
"""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

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
    """Singular values of at least sigma_min, those of `single_layer.potential_matrix` [length]."""

    sigma_min: Float[Array, ""]

    def __init__(self, sigma_min: Numbers):
        self.sigma_min = _not_negative("sigma_min", sigma_min)

    def factors(self, sigma: Array, size: Array, unit_norm: Array, largest: Array) -> Array:
        return jnp.broadcast_to((sigma >= self.sigma_min).astype(size.dtype)[:, None], size.shape)


class Tikhonov(Regularization):
    """phi = sigma² / (sigma² + alpha a), a the largest diagonal entry of A A^T in the waves' basis.

    The rule of `reconstruct_direct`, as a plan; for plans in cylindrical waves only.
    """

    alpha: Float[Array, ""]

    def __init__(self, alpha: Numbers):
        self.alpha = _not_negative("alpha", alpha)

    def factors(self, sigma: Array, size: Array, unit_norm: Array, largest: Array) -> Array:
        square = sigma**2
        shrunk = square / jnp.maximum(square + self.alpha * largest, jnp.finfo(sigma.dtype).tiny)
        return jnp.broadcast_to(shrunk[:, None], size.shape)


class Components(eqx.Module):
    """Singular components of a problem and how much of each is kept.

    Attributes:
        left, right: p_j and q_j, (blocks, equations, k) and (blocks, k, unknowns).
        inverse: 1 / sigma_j, 0 below rounding, (blocks, k).
        amplitudes: p_j·u / sigma_j, (blocks, k, rhs).
        factors: phi_j, (blocks, k, rhs).
        singular_values: sigma_j of all blocks, descending, (rank,).
        terms: Σ_j phi_j, the number of terms kept (j_max), (rhs,).
        norm: ||q||, (rhs,).
        residual: ||A q - u|| / ||u||, (rhs,).
    """

    left: Float[Array, "blocks equations k"]
    right: Float[Array, "blocks k unknowns"]
    inverse: Float[Array, "blocks k"]
    amplitudes: Complex[Array, "blocks k rhs"]
    factors: Float[Array, "blocks k rhs"]
    singular_values: Float[Array, " rank"]
    terms: Float[Array, " rhs"]
    norm: Float[Array, " rhs"]
    residual: Float[Array, " rhs"]

    @property
    def solution(self) -> Complex[Array, "blocks unknowns rhs"]:
        """q = Σ_j phi_j (p_j·u / sigma_j) q_j."""
        kept = self.factors * self.amplitudes
        transposed = jnp.swapaxes(self.right, -1, -2)
        return jax.lax.complex(transposed @ kept.real, transposed @ kept.imag)


def filtered_solve(
    blocks: Float[Array, "blocks equations unknowns"],
    rhs: Complex[Array, "blocks equations rhs"],
    regularization: Regularization,
    unit_norm: Float[Array, ""],
) -> Components:
    """q = Q diag(phi_j / sigma_j) P^T u with A = P diag(sigma) Q^T.

    A is block diagonal, one block for a problem without symmetry; its singular values are ordered
    over all blocks before the factors are chosen. Those below max(A.shape) · eps · sigma_1 are
    rounding, and never used.

    Args:
        blocks: of A, real.
        rhs: u, complex, one column per right-hand side.
        regularization: gives the factors phi.
        unit_norm: N(lambda), see `Regularization.factors`.

    Returns:
        Components, of which ``solution`` is q.

    >>> a = jnp.diag(jnp.array([4.0, 2.0, 1.0]))[None]
    >>> u = jnp.array([[[4.0], [4.0], [4.0]]]) + 0j
    >>> found = filtered_solve(a, u, FixedRank(2.5), jnp.array(1.0))
    >>> found.solution[0, :, 0].real.tolist(), found.terms.tolist()
    ([1.0, 2.0, 2.0], [2.5])
    """
    n_blocks, n_rhs = blocks.shape[0], rhs.shape[-1]
    left, sigma, right = jnp.linalg.svd(blocks, full_matrices=False)
    floor = n_blocks * max(blocks.shape[1:]) * jnp.finfo(sigma.dtype).eps * sigma.max()
    inverse = jnp.where(sigma > floor, 1 / jnp.where(sigma > floor, sigma, 1.0), 0.0)
    # the matrix is real: real and imaginary parts are right-hand sides of their own
    parts = jnp.concatenate([rhs.real, rhs.imag], axis=-1)
    amplitudes = inverse[..., None] * (jnp.swapaxes(left, -1, -2) @ parts)
    largest = jnp.sum(blocks**2, axis=-1).max()
    order = jnp.argsort(-sigma, axis=None)
    size = _modulus(amplitudes).reshape(-1, n_rhs)[order]
    factors = regularization.factors(sigma.ravel()[order], size, unit_norm, largest)
    factors *= (inverse > 0).ravel()[order][:, None]
    unordered = factors[jnp.argsort(order)].reshape(n_blocks, -1, n_rhs)
    kept = jnp.tile(unordered, 2) * amplitudes
    misfit = left @ (sigma[..., None] * kept) - parts
    return Components(
        left=left,
        right=right,
        inverse=inverse,
        amplitudes=_complex(amplitudes),
        factors=unordered,
        singular_values=sigma.ravel()[order],
        terms=jnp.sum(factors, axis=0),
        norm=_norm(_modulus(kept)),
        residual=_norm(_modulus(misfit)) / _norm(_modulus(parts)),
    )


def _complex(parts: Array) -> Array:
    """Columns (real parts, imaginary parts) as complex ones."""
    real, imaginary = jnp.split(parts, 2, axis=-1)
    return jax.lax.complex(real, imaginary)


def _modulus(parts: Array) -> Array:
    real, imaginary = jnp.split(parts, 2, axis=-1)
    square = real**2 + imaginary**2
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def _norm(columns: Array) -> Array:
    return jnp.sqrt(jnp.sum(columns**2, axis=tuple(range(columns.ndim - 1))))


def _not_negative(name: str, value: Numbers) -> Array:
    value = real_array(name, value, ())
    if is_concrete(value) and float(np.asarray(value)) < 0:
        raise ValueError(f"{name} is {float(value)}, expected a value of at least zero.")
    return value
