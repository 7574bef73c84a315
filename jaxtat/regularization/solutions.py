"""Tikhonov's system with any matrix, solved: the one place for those that are formed.

Where alpha is known (M + alpha) y = b takes one Cholesky factorisation, with M = A A^T or A^T A.
Where a rule, or several, choose alpha by the spectrum of M, it takes the eigenvalues. Truncations
keep parts of A itself, see `filtered`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..base.linear_algebra import cholesky_solve, eigh, lu_solve, product_of_blocks


class SolveReport(eqx.Module):
    """How the systems were solved, per frequency.

    Attributes:
        alpha: in the unit of A A^T [length²].
        relative_alpha: in the unit in which numbers are passed, see `Tikhonov`.
        residual: largest ||(A A^T + alpha) y - A G|| / ||A G|| of the images.
        converged: whether the system has a solution: rounding leaves none where alpha is too small.
    """

    alpha: Float[Array, "*frequencies"]
    relative_alpha: Float[Array, "*frequencies"]
    residual: Float[Array, "*frequencies"]
    converged: Bool[Array, "*frequencies"]


def report_of(alpha: Array, unit: Array, residual: Array) -> SolveReport:
    """The report on systems that were solved directly, of one or more frequencies."""
    return SolveReport(alpha, alpha / unit, residual, jnp.isfinite(residual))


def tikhonov_solution(
    matrix: Float[Array, "blocks r r"],
    alpha: Float[Array, ""],
    rhs: Float[Array, "blocks r images"],
    *,
    symmetric: bool = True,
) -> tuple[Float[Array, "blocks r images"], Float[Array, "2 images"]]:
    """y = (M + alpha)^-1 b, and ||(M + alpha) y - b||² and ||b||² of each image.

    Args:
        matrix, alpha, rhs: M, alpha and b.
        symmetric: whether M is, as A A^T; if not, by an LU factorisation.

    >>> y, (left, size) = tikhonov_solution(jnp.eye(2)[None], jnp.array(3.0), jnp.ones((1, 2, 3)))
    >>> y[0, 0].tolist(), size.tolist(), bool(left.max() < 1e-30)
    ([0.25, 0.25, 0.25], [2.0, 2.0, 2.0], True)
    """
    shifted = matrix + alpha * jnp.eye(matrix.shape[-1])
    y = (cholesky_solve if symmetric else lu_solve)(shifted, rhs)
    misfit = product_of_blocks(shifted, y) - rhs
    squares = jnp.stack([jnp.sum(part**2, axis=(0, 1)) for part in (misfit, rhs)])
    return y, jax.lax.stop_gradient(squares)


def relative_residual(squares: Float[Array, "2 *f images"]) -> Float[Array, "*f"]:
    """The largest ||(M + alpha) y - b|| / ||b|| of the images; 0 for data that are zero."""
    left, size = squares
    return jnp.sqrt(jnp.max(left / jnp.where(size > 0, size, 1.0), axis=-1))


def spectrum(
    matrix: Float[Array, "blocks r r"],
) -> tuple[Float[Array, "blocks r"], Float[Array, "blocks r r"]]:
    """Eigenvalues of M = V diag(s) V^T, none below zero, and V."""
    eigenvalues, vectors = eigh(matrix)
    return jnp.maximum(eigenvalues, 0.0), vectors
