"""Work on the rows of arrays, several at a time, so that its memory stays bounded."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Shaped


def map_rows(function: Callable[[Any], Any], rows: Any, at_once: int) -> Any:
    """``function`` of every row, of at most ``at_once`` rows together.

    Args:
        function: of a tree of arrays to another.
        rows: the tree, of arrays (n, ...).
        at_once: the most rows at a time.

    Returns:
        Tree of arrays (n, ...).

    >>> map_rows(lambda x: x**2, jnp.arange(5.0), 2).tolist()
    [0.0, 1.0, 4.0, 9.0, 16.0]
    """
    return in_groups(jax.vmap(function), rows, at_once, fill="edge")


def in_groups(work: Callable[[Any], Any], rows: Any, most: int, *, fill: str = "constant") -> Any:
    """``work`` on a stack of rows, a few at a time, of groups of one size.

    `jax.lax.map` with a ``batch_size`` leaves a smaller group over, for which all is compiled once
    more.

    Args:
        work: from arrays (n, ...) to others, row by row.
        rows: tree of arrays (n, ...).
        most: rows at a time.
        fill: of the last group, as in `equal_parts`.
    """
    n = jax.tree.leaves(rows)[0].shape[0]
    if n <= most:
        return work(rows)
    groups = jax.lax.map(work, jax.tree.map(partial(equal_parts, most=most, fill=fill), rows))
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:n], groups)


def equal_parts(
    array: Shaped[Array | np.ndarray, "n *rest"], most: int, fill: str = "constant"
) -> Shaped[Array, "parts size *rest"]:
    """Rows in parts of one size, at most ``most``, the last filled up with zeros.

    Args:
        array: (n, ...).
        most: rows of a part.
        fill: "constant" for zeros, or "edge" for copies of the last row.

    >>> equal_parts(jnp.arange(5), 2).tolist()
    [[0, 1], [2, 3], [4, 0]]
    """
    n = array.shape[0]
    n_parts = max(1, -(-n // most))
    size = max(1, -(-n // n_parts))
    filled = jnp.pad(array, [(0, n_parts * size - n)] + [(0, 0)] * (array.ndim - 1), mode=fill)
    return filled.reshape(n_parts, size, *array.shape[1:])
