"""Double precision within a function, in programs where JAX computes in single precision."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import jax

P = ParamSpec("P")
T = TypeVar("T")


def in_double(function: Callable[P, T]) -> Callable[P, T]:
    """The function with 64 bits on while it runs, in this thread alone.

    >>> import jax.numpy as jnp
    >>> with jax.enable_x64(False):
    ...     in_double(lambda: jnp.zeros(1).dtype.name)(), jnp.zeros(1).dtype.name
    ('float64', 'float32')
    """

    @wraps(function)
    def inner(*args: P.args, **options: P.kwargs) -> T:
        with jax.enable_x64(True):
            return function(*args, **options)

    return inner
