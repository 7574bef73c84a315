"""Non-uniform Fourier sums: from a regular grid to any frequencies.

    type 2:  F_j = Σ_n f_n e^{i n·x_j},        type 1, its transpose:  f_n = Σ_j F_j e^{i n·x_j},

n_a = -⌊N_a/2⌋ .. ⌈N_a/2⌉ - 1 along each of one to three axes. The second is what
derivatives of the first take. Both are computed by jax-finufft
(Barnett, Magland, af Klinteberg, SIAM J. Sci. Comput. 41 (2019) C479-C504) with one kernel, so that
they are transposes of each other to rounding, whatever the tolerance. Its wheels are for processors
under Linux and macOS; elsewhere `nufft_in_jax` does the same (benchmarks/bench_nufft.py compares
them). Imported when first used.
"""

from functools import cache
from importlib.util import find_spec
from typing import Any

import jax
import jax.numpy as jnp
from jax.interpreters import batching
from jaxtyping import Array, Complex, Float

from .nufft_in_jax import from_grid_in_jax

ROUGH = 1e-6  # tolerance from which a grid 5/4 as fine does, by wider kernels
FEW = 2**15  # points whose sums take a millisecond or two: threads that are busy cost more


def from_grid(
    values: Complex[Array, "*batch_and_grid"], points: Float[Array, "n axes"], tolerance: float
) -> Complex[Array, "*batch n"]:
    """F_j = Σ_n f_n e^{i n·x_j}, type 2; differentiable in values and points.

    Args:
        values: f on the grid, its axes last, (..., N_1, N_2) or with one or three axes.
        points: x_j, frequencies times grid steps [rad].
        tolerance: relative error, static.

    >>> wave = from_grid(jnp.ones((1, 3), complex), jnp.array([[0.3, jnp.pi / 2]]), 1e-9)
    >>> round(float(wave[0].real), 8)  # 1 + 2 cos(π/2)
    1.0
    """
    axes = points.shape[1]
    batch, grid = values.shape[: values.ndim - axes], values.shape[values.ndim - axes :]
    if not native():
        sums = _in_jax(values.reshape(-1, *grid), points, tolerance)
        return sums.reshape(*batch, points.shape[0])
    coarse = axes == 2 and tolerance >= ROUGH and grid[0] * grid[1] > max(len(points), FEW)
    opts = _options(axes, len(points) < FEW, 1.25 if coarse else 2.0)
    options = {"iflag": 1, "eps": tolerance, "opts": opts}
    sums = _library().nufft2(values.reshape(-1, *grid), *points.T, **options)
    return sums.reshape(*batch, points.shape[0])


def to_grid(
    values: Complex[Array, "*batch n"],
    points: Float[Array, "n axes"],
    shape: tuple[int, ...],
    tolerance: float,
) -> Complex[Array, "*batch_and_grid"]:
    """f_n = Σ_j F_j e^{i n·x_j}, type 1, the transpose of `from_grid`; differentiable likewise.

    Args:
        values: F at the points, (..., n).
        points: x_j [rad].
        shape: of the grid, static.
        tolerance: relative error, static.

    >>> wave = to_grid(jnp.ones((1, 1), complex), jnp.array([[jnp.pi / 2]]), (3,), 1e-9)
    >>> wave[0].imag.round(8).tolist()
    [-1.0, 0.0, 1.0]
    """
    like = jax.ShapeDtypeStruct((*values.shape[:-1], *shape), values.dtype)
    return jax.linear_transpose(lambda grid: from_grid(grid, points, tolerance), like)(values)[0]


def native() -> bool:
    """Whether jax-finufft can do it here."""
    return jax.default_backend() == "cpu" and find_spec("jax_finufft") is not None


def _in_jax(values: Array, points: Array, tolerance: float) -> Array:
    """One sum after the other."""
    return jax.lax.map(lambda one: from_grid_in_jax(one, points, tolerance), values)


@cache
def _library() -> Any:
    """jax-finufft, with a rule for `jax.vmap` that works: its own needs what JAX 0.10 removed."""
    from jax_finufft import ops

    for primitive in (ops.nufft1_p, ops.nufft2_p):
        batching.primitive_batchers[primitive] = _batched
    return ops


@cache
def _options(axes: int, few: bool, finer: float) -> Any:
    """Few sums, and those along one axis, are too short to be shared out among threads.

    Both types on a grid as many times finer: left alone the library takes 2 or 5/4 by type, density
    and threads, with which the two would not be transposes, and volumes would take twice as long.
    In the plane of more nodes than points 5/4 saves a fifth of the time, which FFTs take.
    """
    from jax_finufft.options import Opts

    return Opts(nthreads=1 if few or axes == 1 else 0, upsampfac=finer)


def _batched(args: Any, axes: Any, *, output_shape: Any, nufft_type: int, **options: Any) -> Any:
    """Values are (sets, transforms, ...), points (sets, n): a new axis becomes transforms or sets.

    Values alone that are mapped are more transforms at the same points, which share the sorting.
    """
    mapped = [axis is not None for axis in axes]
    size = next(arg.shape[axis] for arg, axis, yes in zip(args, axes, mapped, strict=True) if yes)
    front = [
        jnp.moveaxis(arg, axis, 0) if yes else arg
        for arg, axis, yes in zip(args, axes, mapped, strict=True)
    ]
    ops = _library()

    def transform(values: Array, points: list[Array]) -> Array:
        primitive = ops.nufft1_p if nufft_type == 1 else ops.nufft2_p
        return primitive.bind(
            values, *points, output_shape=output_shape, nufft_type=nufft_type, **options
        )

    values, *points = front
    if not any(mapped[1:]):
        _, sets, n, *rest = values.shape
        together = jnp.moveaxis(values, 0, 1).reshape(sets, size * n, *rest)
        sums = transform(together, points)
        return jnp.moveaxis(sums.reshape(sets, size, n, *sums.shape[2:]), 1, 0), 0
    stacked = [
        arg if yes else jnp.broadcast_to(arg, (size, *arg.shape))
        for arg, yes in zip(front, mapped, strict=True)
    ]
    values, *points = (jax.lax.collapse(arg, 0, 2) for arg in stacked)
    sums = transform(values, points)
    return sums.reshape(size, -1, *sums.shape[1:]), 0
