"""Solvers of the systems of one frequency, direct and iterative, with implicit derivatives."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


def lu_solve(
    matrix: Float[Array, "blocks r r"], rhs: Float[Array, "blocks r columns"]
) -> Float[Array, "blocks r columns"]:
    """matrix^-1 rhs, with implicit derivatives: one more solve each.

    LAPACK wants columns in order, XLA has rows: the transposed needs no copy.
    """
    turned = jnp.swapaxes(jax.lax.stop_gradient(matrix), -1, -2)
    factors = jax.vmap(jax.scipy.linalg.lu_factor)(turned)

    def solve(trans: int, _: Callable, right: Array) -> Array:
        return jax.vmap(partial(jax.scipy.linalg.lu_solve, trans=trans))(factors, right)

    return jax.lax.custom_linear_solve(
        partial(product_of_blocks, matrix), rhs, partial(solve, 1), partial(solve, 0)
    )


def cholesky_solve(
    matrix: Float[Array, "blocks r r"], rhs: Float[Array, "blocks r columns"]
) -> Float[Array, "blocks r columns"]:
    """matrix^-1 rhs of symmetric blocks, with implicit derivatives: one more solve each."""
    # LAPACK wants columns in order, XLA has rows: turned, a symmetric matrix needs no copy
    turned = jnp.swapaxes(jax.lax.stop_gradient(matrix), -1, -2)
    triangle = jnp.linalg.cholesky(turned, symmetrize_input=False)

    def solve(_, right: Array) -> Array:
        return jax.scipy.linalg.cho_solve((triangle, True), right)

    return jax.lax.custom_linear_solve(
        partial(product_of_blocks, matrix), rhs, solve, symmetric=True
    )


def product_of_blocks(
    matrix: Float[Array, "blocks m r"], columns: Float[Array, "blocks r c"]
) -> Array:
    """Block by block: products of batches do not reach the fast library routine."""
    return jnp.stack([block @ part for block, part in zip(matrix, columns, strict=True)])


def conjugate_gradients(
    product: Callable[[Array], Array],
    precondition: Callable[[Array], Array],
    rhs: Float[Array, "images blocks r"],
    tolerance: Array | float,
    max_steps: int,
) -> tuple[Float[Array, "images blocks r"], Int[Array, ""]]:
    """Solve product(y) = rhs for all images, until each has ||residual|| <= tolerance ||rhs||.

    Libraries measure the error entry by entry, relative to each; here entries differ by twelve
    powers of ten, and only their common norm matters.

    Source: Hestenes and Stiefel, J. Res. Nat. Bur. Stand. 49 (1952) 409-436.
    """

    def dot(u: Array, v: Array) -> Array:
        return jnp.sum(u * v, axis=(1, 2), keepdims=True)

    def unfinished(state: tuple[Array, ...]) -> Array:
        _, r, _, _, step = state
        return (step < max_steps) & jnp.any(dot(r, r) > goal)

    def advance(state: tuple[Array, ...]) -> tuple[Array, ...]:
        y, r, p, rz, step = state
        running = dot(r, r) > goal
        image = product(p)
        length = jnp.where(running, rz / jnp.where(running, dot(p, image), 1.0), 0.0)
        y, r = y + length * p, r - length * image
        z = precondition(r)
        rz_next = dot(r, z)
        p = z + jnp.where(running, rz_next / jnp.where(running, rz, 1.0), 0.0) * p
        return y, r, p, rz_next, step + 1

    goal = tolerance**2 * dot(rhs, rhs)
    z = precondition(rhs)
    start = jnp.zeros_like(rhs), rhs, z, dot(rhs, z), jnp.zeros((), int)
    y, *_, step = jax.lax.while_loop(unfinished, advance, start)
    return y, step
