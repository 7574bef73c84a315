"""How precisely a function computes, whatever the program around it has set for JAX."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial, wraps
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

    return _within(partial(jax.enable_x64, True), function)


def in_full(function: Callable[P, T]) -> Callable[P, T]:
    """The function with products of matrices in the precision of their entries.

    Graphics cards else round factors of 32-bit products to 11 bits (TF32), 5e-4 of their size.

    >>> import jax.numpy as jnp
    >>> square = jax.make_jaxpr(in_full(lambda x: x @ x))(jnp.ones((2, 2), "float32"))
    >>> "HIGHEST" in str(square)
    True
    """

    return _within(partial(jax.default_matmul_precision, "highest"), function)


def _within(
    context: Callable[[], AbstractContextManager], function: Callable[P, T]
) -> Callable[P, T]:
    @wraps(function)
    def inner(*args: P.args, **options: P.kwargs) -> T:
        with context():
            return function(*args, **options)

    return inner
