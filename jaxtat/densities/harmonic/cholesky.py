"""Cholesky factors in blocks: found by numpy, and applied by products alone.

M = L L^T with rows of L in blocks, block i (L_i0 ... L_ii). Kept are what is left of the diagonal,
and L_ii^-1. Both substitutions,

    y_i = L_ii^-1 (b_i - Σ_j<i L_ij y_j),    x_i = L_ii^-T (y_i - Σ_j>i L_ji^T x_j),

are then products, as is most of the factorization. A factor takes half the time of an inverse and
three quarters of its memory.
"""

from collections.abc import Sequence
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

BLOCK = 256  # rows at most: more blocks take less memory, and longer to compile
_LEAF = 64  # rows of a triangle that is inverted without being parted


class Cholesky(eqx.Module):
    """L of M = L L^T.

    Attributes:
        left: of each block of rows, what is left of the diagonal.
        inverse: L_ii^-1.
    """

    left: tuple[Float[Array, "*f _ _"], ...]
    inverse: tuple[Float[Array, "*f _ _"], ...]

    def solve(self, columns: Float[Array, "*f k columns"]) -> Float[Array, "*f k columns"]:
        """M^-1 columns."""
        found: list[Array] = []
        for left, inverse in zip(self.left, self.inverse, strict=True):
            start, size = left.shape[-1], inverse.shape[-1]
            part = columns[..., start : start + size, :]
            if start:
                part -= left @ jnp.concatenate(found, axis=-2)
            found.append(inverse @ part)
        # rows instead of columns: transposed matrices on the left are slow
        rest, solved = jnp.swapaxes(jnp.concatenate(found, axis=-2), -1, -2), []
        for left, inverse in zip(self.left[::-1], self.inverse[::-1], strict=True):
            start = left.shape[-1]
            part = rest[..., start:] @ inverse
            solved.insert(0, part)
            rest = rest[..., :start] - part @ left
        return jnp.swapaxes(jnp.concatenate(solved, axis=-1), -1, -2)

    @property
    def size(self) -> int:
        """Rows of M."""
        return self.left[-1].shape[-1] + self.inverse[-1].shape[-1]


def block_bounds(size: int) -> list[tuple[int, int]]:
    """First row and last + 1 of each block."""
    bounds = np.linspace(0, size, -(-size // BLOCK) + 1).astype(int).tolist()
    return list(pairwise(bounds))


def factorize(
    wide: Float[np.ndarray, "rows columns"],
    alpha: float,
    left: Sequence[Float[np.ndarray, "_ _"]],
    inverse: Sequence[Float[np.ndarray, "_ _"]],
) -> None:
    """Write the factor of W W^T + alpha, found in the precision of W.

    Args:
        wide: W. Further rows, up to the size of M, are zero: there L is the identity.
        alpha: positive.
        left, inverse: written, as in `Cholesky`, of one matrix.

    Raises:
        LinAlgError: where alpha is less than rounding.
    """
    before: list[tuple[int, np.ndarray, np.ndarray]] = []
    for of_left, of_inverse in zip(left, inverse, strict=True):
        size, start = of_left.shape
        rows = wide[start : start + size]
        n = len(rows)
        of_left[n:], of_inverse[...] = 0, np.eye(size)
        if n:
            found = rows @ wide[:start].T
            for first, earlier, triangle in before:
                block = found[:, first : first + len(triangle)]
                block[...] = (block - found[:, :first] @ earlier.T) @ triangle.T
            triangle = _inverse_root(rows @ rows.T, found, alpha)
            of_left[:n], of_inverse[:n, :n] = found, triangle
            before.append((start, found, triangle))


def _inverse_root(
    gram: Float[np.ndarray, "b b"], found: Float[np.ndarray, "b before"], alpha: float
) -> Float[np.ndarray, "b b"]:
    """L^-1 of gram + alpha - found found^T = L L^T."""
    if found.size:
        gram -= found @ found.T
    gram[np.diag_indices(len(gram))] += alpha
    (potrf,) = scipy.linalg.get_lapack_funcs(("potrf",), (gram,))
    # LAPACK has columns in order: what is an upper triangle to it is a lower one here
    upper, failed = potrf(gram.T, lower=False, overwrite_a=True, clean=True)
    if failed:
        raise np.linalg.LinAlgError("alpha is less than rounding: the matrix is not positive.")
    return _triangle_inverse(upper.T)


def _triangle_inverse(triangle: Float[np.ndarray, "b b"]) -> Float[np.ndarray, "b b"]:
    """Of a lower triangle, by its halves: most of it is products, unlike in LAPACK."""
    if len(triangle) <= _LEAF:
        (trtri,) = scipy.linalg.get_lapack_funcs(("trtri",), (triangle,))
        return trtri(triangle.T, lower=False)[0].T
    h = len(triangle) // 2
    found = np.zeros_like(triangle)
    found[:h, :h] = first = _triangle_inverse(triangle[:h, :h])
    found[h:, h:] = last = _triangle_inverse(triangle[h:, h:])
    np.matmul(-last, triangle[h:, :h] @ first, out=found[h:, :h])
    return found
