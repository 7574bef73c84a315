"""Methods of modules that `jax.jit` takes as they are: ``jax.jit(operator.mv)``.

Equinox hashes a module by its arrays, which have no hash, and a method by its module.
"""

from collections.abc import Callable
from functools import wraps
from typing import TypeVar

import equinox as eqx

C = TypeVar("C", bound=Callable)


class ComparedByIdentity:
    """Hashed by identity: `jax.jit` compiles its methods with its arrays as constants."""

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)


def compiled(method: C) -> C:
    """``method`` compiled by `equinox.filter_jit`, whose own wrapper of a method has no hash."""
    program = eqx.filter_jit(method)

    @wraps(method)
    def call(*args, **kwargs):
        return program(*args, **kwargs)

    return call  # pyright: ignore[reportReturnType]
