"""Cholesky factors in blocks: found by LAPACK, and applied by products alone.

M = U^T U with columns of U in blocks, block i (U_0i ... U_ii). Kept are what is above the diagonal,
and U_ii^-1. Both substitutions,

    y_i = (b_i - Σ_j<i y_j U_ji) U_ii^-1,    x_i = U_ii^-1 (y_i - Σ_j>i U_ij x_j),

the first one in rows, are then products. A factor takes half the time of an inverse and three
quarters of its memory.
"""

from collections.abc import Sequence
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .lapack import cholesky, invert, multiply, square

BLOCK = 256  # columns at most: more blocks take less memory, and longer to compile
_LEAF = 64  # rows of a triangle that is inverted without being parted


class Cholesky(eqx.Module):
    """U of M = U^T U.

    Attributes:
        above: of each block of columns, what is above the diagonal.
        inverse: U_ii^-1.
    """

    above: tuple[Float[Array, "*f _ _"], ...]
    inverse: tuple[Float[Array, "*f _ _"], ...]

    def solve(self, columns: Float[Array, "*f k columns"]) -> Float[Array, "*f k columns"]:
        """M^-1 columns."""
        # rows, then columns: transposed matrices on the left are slow
        rows, found = jnp.swapaxes(columns, -1, -2), []
        for above, inverse in zip(self.above, self.inverse, strict=True):
            start, size = above.shape[-2:]
            part = rows[..., start : start + size]
            if start:
                part -= jnp.concatenate(found, axis=-1) @ above
            found.append(part @ inverse)
        rest = jnp.swapaxes(jnp.concatenate(found, axis=-1), -1, -2)
        solved: list[Array] = []
        for above, inverse in zip(self.above[::-1], self.inverse[::-1], strict=True):
            start = above.shape[-2]
            part = inverse @ rest[..., start:, :]
            solved.insert(0, part)
            rest = rest[..., :start, :] - above @ part
        return jnp.concatenate(solved, axis=-2)

    @property
    def size(self) -> int:
        """Rows of M."""
        return sum(self.above[-1].shape[-2:])


def block_bounds(size: int) -> list[tuple[int, int]]:
    """First column and last + 1 of each block."""
    bounds = np.linspace(0, size, -(-size // BLOCK) + 1).astype(int).tolist()
    return list(pairwise(bounds))


def factorize(
    wide: Float[np.ndarray, "rows columns"],
    alpha: float,
    above: Sequence[Float[np.ndarray, "_ _"]],
    inverse: Sequence[Float[np.ndarray, "_ _"]],
) -> None:
    """Write the factor of W W^T + alpha, found in the precision of W.

    Args:
        wide: W, rows or columns contiguous. Further rows, up to the size of M, are zero: there U is
            the identity.
        alpha: positive.
        above, inverse: written, as in `Cholesky`, of one matrix.

    Raises:
        LinAlgError: where alpha is less than rounding.
    """
    upper, n = _root(wide, alpha), len(wide)
    for of_above, of_inverse in zip(above, inverse, strict=True):
        start, size = of_above.shape
        used = slice(start, min(start + size, n))
        k = max(used.stop - start, 0)
        if k < size:
            of_above[...], of_inverse[...] = 0, np.eye(size)
        if k:
            of_above[:, :k] = upper[:start, used]
            _invert(upper[used, used])
            of_inverse[:k, :k] = upper[used, used]


def _root(wide: Float[np.ndarray, "n columns"], alpha: float) -> Float[np.ndarray, "n n"]:
    """U of W W^T + alpha."""
    n = len(wide)
    upper = np.zeros((n, n), wide.dtype)
    square(wide, upper)
    upper.reshape(-1)[:: n + 1] += alpha
    if not cholesky(upper):
        raise np.linalg.LinAlgError("alpha is less than rounding: the matrix is not positive.")
    return upper


def _invert(triangle: Float[np.ndarray, "n n"]) -> None:
    """Write the inverse over an upper triangle, by its halves: products are what is fast."""
    n, h = len(triangle), len(triangle) // 2
    if n <= _LEAF:
        invert(triangle)
        return
    first, last = triangle[:h, :h], triangle[h:, h:]
    _invert(first)
    _invert(last)
    multiply(-1.0, first, triangle[:h, h:], last)
