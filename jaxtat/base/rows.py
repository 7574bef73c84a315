"""A function of each row of arrays, several rows at a time."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


def map_rows(function: Callable[[Any], Any], rows: Any, at_once: int) -> Any:
    """``function`` of every row, of at most ``at_once`` rows together, so that memory is bounded.

    Groups of one size, of which the last is filled up with copies of the last row. `jax.lax.map`
    with a ``batch_size`` leaves a smaller one over, for which all is compiled once more.

    Args:
        function: of a tree of arrays to another.
        rows: the tree, of arrays (n, ...).
        at_once: the most rows at a time.

    Returns:
        Tree of arrays (n, ...).

    >>> map_rows(lambda x: x**2, jnp.arange(5.0), 2).tolist()
    [0.0, 1.0, 4.0, 9.0, 16.0]
    """
    n = jax.tree.leaves(rows)[0].shape[0]
    n_groups = -(-n // at_once)
    if n_groups <= 1:
        return jax.vmap(function)(rows)
    size = -(-n // n_groups)

    def grouped(leaf: Any) -> jax.Array:
        missing = (n_groups * size - n, *leaf.shape[1:])
        filled = jnp.concatenate([leaf, jnp.broadcast_to(leaf[-1:], missing)])
        return filled.reshape(n_groups, size, *leaf.shape[1:])

    groups = jax.lax.map(jax.vmap(function), jax.tree.map(grouped, rows))
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:n], groups)
