"""Several devices or machines: the same work on parts of an array, by `jax.shard_map`.

A mesh is JAX's own, with one axis of any name: ``jax.make_mesh((8,), ("devices",))``. With several
processes every process makes the same calls with the same arguments after
``jax.distributed.initialize``, and reads what it holds of the result.

Several host devices on one CPU wait for each other in threads of one pool, which has as many as the
machine has cores. Where these are few the program can wait for ever: set the environment variable
NPROC=8 (or more) before JAX starts.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array


def checked_mesh(mesh: Any) -> Mesh | None:
    """The mesh with shardings left to the compiler, or ValueError if it is none of one axis."""
    if mesh is None:
        return None
    if not isinstance(mesh, Mesh) or len(mesh.axis_names) != 1:
        raise ValueError(
            f"mesh is {mesh!r}, expected a jax.sharding.Mesh of one axis: "
            "jax.make_mesh((number_of_devices,), ('devices',))."
        )
    return Mesh(mesh.devices, mesh.axis_names, axis_types=(AxisType.Auto,))


def whole(array: Array) -> Array:
    """An array that is divided over a mesh with explicit axes, on every device; others unchanged.

    `jax.make_mesh` makes explicit axes, for which every operation would have to name its sharding.
    """
    mesh = jax.typeof(array).sharding.mesh
    if AxisType.Explicit in mesh.axis_types:
        return jax.sharding.reshard(array, NamedSharding(mesh, PartitionSpec()))
    return array


def replicated(tree: Any, mesh: Mesh | None) -> Any:
    """The arrays of a tree on every device of the mesh."""
    if mesh is None:
        return tree
    return jax.device_put(tree, NamedSharding(mesh, PartitionSpec()))


def map_shards(work: Callable[[Any, Any], Any], common: Any, stack: Any, mesh: Mesh | None) -> Any:
    """``work`` on arrays whose first axes are alike, each device doing its share of them.

    Args:
        work: from ``common`` and a tree of arrays (n, ...) to another, row by row, for any n.
        common: a tree of arrays that every device needs whole. What derivatives are taken of must
            come this way, not as a closure.
        stack: the tree; filled up with copies of the first row to a multiple of the devices.
        mesh: None for a plain call.
    """
    if mesh is None:
        return work(common, stack)
    n = jax.tree.leaves(stack)[0].shape[0]
    missing = -n % mesh.size

    def deal(leaf: jax.Array) -> jax.Array:
        # like cards: neighbours cost alike, so every device gets some of each
        filled = jnp.concatenate([leaf, jnp.repeat(leaf[:1], missing, axis=0)])
        return filled.reshape(-1, mesh.size, *leaf.shape[1:]).swapaxes(0, 1).reshape(filled.shape)

    def collect(leaf: jax.Array) -> jax.Array:
        dealt = leaf.reshape(mesh.size, -1, *leaf.shape[1:])
        return dealt.swapaxes(0, 1).reshape(leaf.shape)[:n]

    whole, shard = PartitionSpec(), PartitionSpec(mesh.axis_names[0])
    # the check of what is replicated does not know loops of unknown length
    spread = jax.shard_map(
        work, mesh=mesh, in_specs=(whole, shard), out_specs=shard, check_vma=False
    )
    return jax.tree.map(collect, spread(common, jax.tree.map(deal, stack)))
