"""Factorisations and solutions of matrices: the one module that calls LAPACK through JAX.

On CPUs JAX 0.10 (0.10.0 to 0.10.2, the newest; not 0.9) shares the matrices of a batch among the
threads in one of which the call waits for them. With as many calls at once as there are threads, in
one program or in programs of several threads, all of them wait for ever. So matrices are handed to
LAPACK one by one, under `jax.vmap` too.

Solutions have implicit derivatives, one more solve each. Factors have JAX's own derivatives in
forward mode alone: what needs others has a rule of its own.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap, sequential_vmap
from jaxtyping import Array, Float, Inexact


def cholesky_solve(
    matrix: Float[Array, "blocks r r"], rhs: Float[Array, "blocks r columns"]
) -> Float[Array, "blocks r columns"]:
    """matrix^-1 rhs of symmetric, positive definite blocks.

    >>> cholesky_solve(4 * jnp.eye(2)[None], jnp.ones((1, 2, 1)))[0, :, 0].tolist()
    [0.25, 0.25]
    """
    triangles = [_cholesky(block) for block in jax.lax.stop_gradient(matrix)]

    def solve(_: Callable, right: Array) -> Array:
        return jnp.stack([_by_both(*pair) for pair in zip(triangles, right, strict=True)])

    product = partial(product_of_blocks, matrix)
    return jax.lax.custom_linear_solve(product, rhs, solve, symmetric=True)


def lu_solve(
    matrix: Inexact[Array, "blocks r r"], rhs: Inexact[Array, "blocks r columns"]
) -> Inexact[Array, "blocks r columns"]:
    """matrix^-1 rhs of any regular blocks, real or complex.

    >>> lu_solve(jnp.array([[[0.0, 2.0], [1.0, 0.0]]]), jnp.array([[[4.0], [3.0]]])).tolist()
    [[[3.0], [2.0]]]
    """
    factors = [_lu_of_transposed(block) for block in jax.lax.stop_gradient(matrix)]

    def solve(by_factors: Callable, _: Callable, right: Array) -> Array:
        each = zip(factors, right, strict=True)
        return jnp.stack([by_factors(*lu, part) for lu, part in each])

    return jax.lax.custom_linear_solve(
        partial(product_of_blocks, matrix),
        rhs,
        partial(solve, _by_transposed_lu),
        partial(solve, _by_lu),
    )


def lower_solve(
    triangle: Float[Array, "r r"], rhs: Float[Array, "r *columns"]
) -> Float[Array, "r *columns"]:
    """triangle^-1 rhs of a lower triangle.

    >>> lower_solve(jnp.array([[2.0, 0.0], [1.0, 1.0]]), jnp.array([2.0, 3.0])).tolist()
    [1.0, 2.0]
    """
    constant = jax.lax.stop_gradient(triangle)

    def solve(_: Callable, right: Array) -> Array:
        return _by_lower(constant, right)

    def solve_transposed(_: Callable, right: Array) -> Array:
        return _by_transposed_lower(constant, right)

    return jax.lax.custom_linear_solve(lambda x: triangle @ x, rhs, solve, solve_transposed)


def eigh(
    matrix: Float[Array, "blocks r r"],
) -> tuple[Float[Array, "blocks r"], Float[Array, "blocks r r"]]:
    """Eigenvalues, ascending, and eigenvectors of symmetric blocks.

    >>> eigh(jnp.diag(jnp.array([2.0, 1.0]))[None])[0].tolist()
    [[1.0, 2.0]]
    """
    return _of_blocks(_eigh, matrix)


def svd(
    matrix: Float[Array, "blocks m n"],
) -> tuple[Float[Array, "blocks m k"], Float[Array, "blocks k"], Float[Array, "blocks k n"]]:
    """P, sigma, descending, and Q^T of blocks P diag(sigma) Q^T, k = min(m, n).

    >>> svd(jnp.diag(jnp.array([2.0, 4.0]))[None])[1].tolist()
    [[4.0, 2.0]]
    """
    return _of_blocks(_svd, matrix)


def qr(
    matrix: Float[Array, "blocks m n"],
) -> tuple[Float[Array, "blocks m k"], Float[Array, "blocks k n"]]:
    """Q and R of blocks Q R, k = min(m, n).

    >>> abs(qr(jnp.array([[[3.0], [4.0]]]))[1]).tolist()
    [[[5.0]]]
    """
    return _of_blocks(_qr, matrix)


def product_of_blocks(
    matrix: Inexact[Array, "blocks m r"], columns: Inexact[Array, "blocks r c"]
) -> Inexact[Array, "blocks m c"]:
    """Block by block: products of batches do not reach the fast library routine."""
    return jnp.stack([block @ part for block, part in zip(matrix, columns, strict=True)])


def _of_blocks(factors: Callable, matrix: Array) -> Any:
    each = zip(*(factors(block) for block in matrix), strict=True)
    return tuple(jnp.stack(part) for part in each)


def _one_matrix_at_a_time(solve: Callable) -> Callable:
    """``solve(*factors, right)``, under `jax.vmap` with all columns of one matrix together."""
    in_turn, alone = sequential_vmap(solve), custom_vmap(solve)

    @alone.def_vmap
    def _(size: int, batched: list[bool], *arguments: Array) -> tuple[Array, bool]:
        *factors, right = arguments
        if any(batched[:-1]):
            axes = [0 if each else None for each in batched]
            return jax.vmap(in_turn, axes, axis_size=size)(*arguments), True
        columns = jnp.moveaxis(right, 0, -1)
        solution = alone(*factors, columns.reshape(columns.shape[0], -1)).reshape(columns.shape)
        return jnp.moveaxis(solution, -1, 0), True

    return alone


@sequential_vmap
def _cholesky(matrix: Array) -> Array:
    # LAPACK wants columns in order, XLA has rows: turned, a symmetric matrix needs no copy
    return jnp.linalg.cholesky(matrix.T, symmetrize_input=False)


@sequential_vmap
def _lu_of_transposed(matrix: Array) -> tuple[Array, Array]:
    return jax.scipy.linalg.lu_factor(matrix.T)  # turned, as above


@sequential_vmap
def _eigh(matrix: Array) -> tuple[Array, Array]:
    return tuple(jnp.linalg.eigh(matrix))


@sequential_vmap
def _svd(matrix: Array) -> tuple[Array, Array, Array]:
    return tuple(jnp.linalg.svd(matrix, full_matrices=False))


@sequential_vmap
def _qr(matrix: Array) -> tuple[Array, Array]:
    q, r = jnp.linalg.qr(matrix)
    return q, r


@_one_matrix_at_a_time
def _by_both(triangle: Array, right: Array) -> Array:
    return jax.scipy.linalg.cho_solve((triangle, True), right)


@_one_matrix_at_a_time
def _by_lu(factors: Array, pivots: Array, right: Array) -> Array:
    return jax.scipy.linalg.lu_solve((factors, pivots), right)


@_one_matrix_at_a_time
def _by_transposed_lu(factors: Array, pivots: Array, right: Array) -> Array:
    return jax.scipy.linalg.lu_solve((factors, pivots), right, trans=1)


@_one_matrix_at_a_time
def _by_lower(triangle: Array, right: Array) -> Array:
    return jax.scipy.linalg.solve_triangular(triangle, right, lower=True)


@_one_matrix_at_a_time
def _by_transposed_lower(triangle: Array, right: Array) -> Array:
    return jax.scipy.linalg.solve_triangular(triangle, right, lower=True, trans=1)
