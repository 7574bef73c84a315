"""Non-uniform Fourier sums in JAX itself, for graphics cards and wherever jax-finufft has no wheel.

With nodes y_l = 2π l/M of a grid twice as fine, M >= 2N, and a kernel phi as wide as w nodes,

    Σ_n f_n e^{i n x} ≈ Σ_l u_l phi(2 (l - M x/2π)/w),    u_l = Σ_n (f_n/phi_n) e^{i n y_l},
    phi_n = (w/2) ∫_{-1}^{1} phi(z) cos(π n w z/M) dz,    phi(z) = exp(beta (√(1 - z²) - 1)),

along each axis; close to z = ±1, where its slope would be infinite, phi is constant. What is read
of the grid are pairs of real numbers, not complex ones: the transpose adds to the grid at many
points at once, which cards do in one instruction for real numbers alone.

Source: Barnett, Magland and af Klinteberg, SIAM J. Sci. Comput. 41 (2019) C479-C504.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float
from scipy.fft import next_fast_len

FINER = 2  # M over N, at least
BETA = 2.3  # over w, for a grid that is twice as fine
SPARE = 1  # of the width, over the digits that are asked for
QUADRATURE = 64  # nodes for phi_n
MARGIN = 0.02  # of a node, between the kernel's end and where other nodes are read
FLAT = 1e-3  # 1 - z² below which phi is constant: derivatives at points on nodes stay right
MOST_NODES = 2**31  # their numbers have 32 bits


def from_grid_in_jax(
    values: Complex[Array, " *grid"], points: Float[Array, "n axes"], tolerance: float
) -> Complex[Array, " n"]:
    """F_j = Σ_n f_n e^{i n·x_j}; linear in the values, whose transpose is exact.

    Args:
        values: f.
        points: x_j [rad].
        tolerance: relative error, static.

    >>> wave = from_grid_in_jax(jnp.ones(3, complex), jnp.array([[0.3], [jnp.pi / 2]]), 1e-9)
    >>> wave.real.round(8).tolist()  # 1 + 2 cos(x)
    [2.91067298, 1.0]
    """
    width = math.ceil(-math.log10(tolerance)) + SPARE
    axes, dtype = points.shape[1], values.real.dtype
    fine: tuple[Any, ...] = tuple(next_fast_len(FINER * max(n, width)) for n in values.shape)
    if math.prod(fine) >= MOST_NODES:
        raise ValueError(
            f"the grid of the FFT has {' x '.join(map(str, fine))} nodes, expected fewer than "
            f"{MOST_NODES}: take fewer pixels."
        )
    for axis, (n, m) in enumerate(zip(values.shape, fine, strict=True)):
        whole = tuple(-1 if axis == k else 1 for k in range(axes))
        values = values * jnp.asarray(1 / _transformed(n, m, width), dtype).reshape(whole)
    padded = jnp.pad(values, [(0, m - n) for n, m in zip(values.shape, fine, strict=True)])
    shifts = [-(n // 2) for n in values.shape]
    nodes = jnp.fft.ifftn(jnp.roll(padded, shifts, range(axes)), norm="forward")
    grid = jnp.stack([nodes.real, nodes.imag], axis=-1).reshape(-1, 2)
    near = [_near(points[:, k], fine[k], width, dtype) for k in range(axes)]
    real, imaginary = _read(grid, near, fine)
    return jax.lax.complex(real, imaginary)


def _transformed(n: int, m: int, width: int) -> Float[np.ndarray, " n"]:
    """phi_n of the n numbers of an axis."""
    z, weights = np.polynomial.legendre.leggauss(QUADRATURE)
    numbers, support = np.arange(-(n // 2), (n + 1) // 2), width - MARGIN
    waves = np.cos(np.pi * support / m * np.outer(numbers, z))
    return support / 2 * waves @ (weights * np.asarray(_kernel(z, width, np)))


def _kernel(z: Any, width: int, xp: Any = jnp) -> Any:
    """phi, 0 beyond 1."""
    root = xp.sqrt(xp.maximum(1 - z**2, FLAT))
    return xp.where(z**2 <= 1, xp.exp(BETA * width * (root - 1)), 0.0)


def _near(x: Float[Array, " n"], m: int, width: int, dtype: Any) -> tuple[Array, Array]:
    """Numbers of the nodes along an axis that a point reads, and their factors, (n, width).

    Of each class modulo the width the nearest one. Compilers may compute numbers twice, rounded in
    two ways: where two nodes of a class are as near, both are beyond the kernel's end.
    """
    place, classes = x[:, None] * (m / (2 * jnp.pi)), jnp.arange(width)
    numbers = classes + width * jnp.round((place - classes) / width)
    factors = _kernel((numbers - place) * (2 / (width - MARGIN)), width)
    return numbers.astype(jnp.int32) % m, factors.astype(dtype)


def _read(
    grid: Float[Array, "nodes 2"], near: list[tuple[Array, Array]], fine: tuple[int, ...]
) -> Float[Array, "2 n"]:
    """Sums over the nodes about each point, one number along the first axis after the other."""
    (first, factors), *others = near
    flat, weights = jnp.zeros_like(first[:, :1]), jnp.ones_like(factors[:, :1])
    for (numbers, more), m in zip(others, fine[1:], strict=True):
        flat = (flat[:, :, None] * m + numbers[:, None, :]).reshape(len(first), -1)
        weights = (weights[:, :, None] * more[:, None, :]).reshape(len(first), -1)
    stride = math.prod(fine[1:])

    def add(total: Array, row: tuple[Array, Array]) -> tuple[Array, None]:
        number, factor = row
        read = grid[number[:, None] * stride + flat]
        return total + factor * jnp.einsum("nwp,nw->pn", read, weights), None

    start = jnp.zeros((2, len(first)), grid.dtype)
    return jax.lax.scan(add, start, (first.T, factors.T))[0]
