"""Densities for a whole disk anywhere among the detectors: without symmetry, and soon.

Cylindrical waves about the disk's own centre keep R diagonal; the detectors have distances r_k of
their own, and A = R M needs (J_n|Y_n)(lambda r_k), which are found at few of them. For one alpha no
decomposition is needed but the Cholesky factor of the smaller of two matrices,

    (A A^T + alpha)^-1 A = A (A^T A + alpha)^-1,

and the densities stay a product of A and two triangles.

By numpy, whose products of a matrix with its own transpose take half the time of XLA's, and with
which nothing is compiled. Each frequency has as many orders as it needs; those beyond, up to those
of its group, are zero, and take no time here.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int
from threadpoolctl import threadpool_limits

from ...geometry import DetectorCurve, Disk
from ...regularization import RelativeTikhonov, Tikhonov
from ...special import hankel_rows, known_decay_steps
from .chebyshev_distances import few_distances
from .cholesky import Cholesky, block_bounds, factorize
from .densities import HarmonicDensities, Solved, rows_alone
from .known_waves import known_disk_norms, known_twice
from .moved_units import circle_places, moved_unit
from .orders import TOLERANCE, highest_orders
from .polar import REACHED, PolarGeometry, polar_geometry
from .tikhonov_rows import alphas_of

AT_ONCE = 64  # frequencies of one call, whose tables stay in a cache
EXACT_BELOW = 3e-3  # alpha over its unit, below which factors are found in double precision,
DOUBLE_BELOW = 3e-4  # and below which matrices are to be kept so
# of orders, as in `highest_orders`, by bytes of a number; those left out change images by about the
# square of it over alpha^1.5, alpha over its unit
_TOLERANCE = {4: 1e-5, 8: TOLERANCE}
_ALIGNED = 64  # bytes: such arrays JAX takes without a copy


class Potentials(eqx.Module):
    """A of frequencies that have as many orders.

    Attributes:
        matrix: A, columns as in `fold`, rows of order 0, 0, 1, 1, ...: of cosine and sine.
        scale: eps Delta R.
    """

    matrix: Float[Array, "*f 1 r columns"]
    scale: Float[Array, "*f 1 r"]


class FreeWaves(eqx.Module):
    """A of all frequencies of a whole disk.

    Attributes:
        groups: in the order of the frequencies.
        rows: how many of A are not zero, the first ones.
        unit: of alpha [length²].
        frequencies: lambda [rad/length].
        angles: of the directions, counted from the axis [rad].
    """

    groups: tuple[Potentials, ...]
    rows: Int[np.ndarray, " frequencies"]
    unit: Float[np.ndarray, " frequencies"]
    frequencies: Float[Array, " frequencies"]
    angles: Float[Array, " directions"]


def free_waves(
    curve: DetectorCurve,
    region: Disk,
    frequencies: Float[Array, " frequencies"],
    angles: Float[Array, " directions"],
    groups: Sequence[tuple[int, int, int]],
    n_nodes: int,
    dtype: Any,
) -> FreeWaves:
    """The potentials, which do not depend on alpha.

    Args:
        curve, region: a concrete geometry.
        frequencies: lambda [rad/length].
        angles: theta [rad].
        groups: (first, last + 1, orders) of frequencies that are solved alike; more orders are
            taken where the detectors are so near that they need more.
        n_nodes: on elements of finite width.
        dtype: of the matrices.

    Raises:
        ValueError: for a detector that is hardly farther away than the rim.
    """
    usual = polar_geometry(curve, region, n_nodes)  # for axis and unit, as `solve` has them
    known, radius, center = np.asarray(frequencies), float(region.radius), np.asarray(region.center)
    local, shares = _nodes(curve, center, n_nodes)
    distances = np.hypot(local[..., 0], local[..., 1])
    needed = _needed(known, radius, float(distances.min()), np.dtype(dtype))
    potentials = [
        _space(stop - start, max(orders, int(needed[start:stop].max())), distances.shape[1], dtype)
        for start, stop, orders in groups
    ]
    each = [part for group in potentials for part in zip(*group, strict=True)]
    # beyond lambda r waves change with r like powers of the order
    highest = max(known.max(), needed.max() / distances.min())
    places, to_elements = few_distances(distances.ravel(), highest, dtype)
    to_elements = None if to_elements is None else to_elements.astype(dtype)
    angular = _angular(local, shares, usual, int(needed.max())).astype(dtype)
    around, units = circle_places(usual), np.empty(len(known))

    def fill(number: int, waves: Float[np.ndarray, "orders 2 places"]) -> None:
        values = waves.reshape(-1, len(places)).astype(dtype)
        values = values if to_elements is None else values @ to_elements
        values = values.reshape(*waves.shape[:2], *distances.shape)
        matrix = each[number][0].reshape(-1, 2, 2, distances.shape[1])  # orders, cos|sin, J|Y
        _products(matrix, values, angular)
        if not usual.on_circle:
            units[number] = np.einsum("npjk,npjk->np", matrix, matrix).max()

    with ThreadPoolExecutor(os.cpu_count()) as pool, threadpool_limits(1, user_api="blas"):
        filled = []
        for first in range(0, len(known), AT_ONCE):
            here = slice(first, first + AT_ONCE)
            norms, waves = _waves(known[here], needed[here], radius, np.append(places, around))
            scale = np.repeat(norms * known_twice(len(norms))[:, None], 2, axis=0)
            for i, n in enumerate(needed[here] + 1):
                each[first + i][1][0, : 2 * n] = scale[: 2 * n, i]
                filled.append(pool.submit(fill, first + i, waves[:n, :, i, : len(places)]))
            if usual.on_circle:
                circle = waves[..., len(places) :]
                units[here] = moved_unit(usual, center, known[here], norms, circle)
        for one in filled:
            one.result()
    angles = angles - usual.axis
    found = tuple(Potentials(*arrays) for arrays in jax.device_put(potentials))
    return FreeWaves(found, 2 * (needed + 1), units, frequencies, angles)


def wants_double(waves: FreeWaves, rule: Tikhonov | RelativeTikhonov) -> bool:
    """Whether alpha is so small that matrices in single precision give less than four digits.

    Rounding grows like the unit of alpha over alpha.
    """
    return _least(waves, alphas_of(rule, waves.unit, waves.frequencies)) < DOUBLE_BELOW


def free_densities(waves: FreeWaves, rule: Tikhonov | RelativeTikhonov) -> HarmonicDensities:
    """The densities of all plane waves by a rule, a number or one for each frequency."""
    alphas = alphas_of(rule, waves.unit, waves.frequencies)
    exact = _least(waves, alphas) < EXACT_BELOW
    factors, each = [], []
    for group in waves.groups:
        size = min(group.matrix.shape[-2:])
        factor = _empty_blocks(len(group.scale), size, group.matrix.dtype)
        factors.append(factor)
        for i, matrix in enumerate(np.asarray(group.matrix)):
            each.append((matrix[0], size, *([part[i, 0] for part in parts] for parts in factor)))

    def find(number: int) -> None:
        matrix, size, above, inverse = each[number]
        used = matrix[: waves.rows[number]].astype(float if exact else matrix.dtype, copy=False)
        factorize(used if size == len(matrix) else used.T, alphas[number], above, inverse)

    # a thread for each matrix: more, within one, would wait for each other; the largest first
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(find, reversed(range(len(each)))))
    n_directions = len(waves.angles)
    groups = tuple(
        rows_alone(Solved(group.scale, group.matrix, Cholesky(*factor)), n_directions)
        for group, factor in zip(waves.groups, jax.device_put(factors), strict=True)
    )
    phases = np.ones((len(each), n_directions), groups[0].extra.dtype)
    return HarmonicDensities(groups, waves.angles, jax.device_put(phases), mirror=False)


def _least(waves: FreeWaves, alphas: Float[np.ndarray, " f"]) -> float:
    """The least alpha over its unit."""
    return float((alphas / waves.unit).min())


def _empty_blocks(n: int, size: int, dtype: Any) -> tuple[tuple[np.ndarray, ...], ...]:
    """`Cholesky.above` and `inverse` of n matrices, to be written."""
    bounds = block_bounds(size)
    above = tuple(_empty((n, 1, start, stop - start), dtype) for start, stop in bounds)
    return above, tuple(_empty((n, 1, *2 * (stop - start,)), dtype) for start, stop in bounds)


def _space(
    n: int, orders: int, n_detectors: int, dtype: Any
) -> tuple[Float[np.ndarray, "f 1 r columns"], Float[np.ndarray, "f 1 r"]]:
    """A and its scale of n frequencies, to be written."""
    rows = 2 * (orders + 1)
    return _empty((n, 1, rows, 2 * n_detectors), dtype), np.zeros((n, 1, rows), dtype)


def _nodes(
    curve: DetectorCurve, center: Float[np.ndarray, "2"], n_nodes: int
) -> tuple[Float[np.ndarray, "nodes detectors 2"], Float[np.ndarray, "nodes detectors"]]:
    """Points of the detectors from the centre, and √w times the share of each."""
    points, shares = map(np.asarray, curve.element_nodes(n_nodes))
    return np.moveaxis(points - center, 1, 0), shares[:, None] * np.sqrt(np.asarray(curve.weights))


def _needed(
    frequencies: Float[np.ndarray, " f"], radius: float, nearest: float, dtype: np.dtype
) -> Int[np.ndarray, " f"]:
    """Orders that reach the nearest detector, not decreasing."""
    if radius >= REACHED * nearest:
        raise ValueError(
            f"the region has radius {radius:.6g}, and a detector is only {nearest:.6g} from its "
            "centre: move it by less, or make another function for a smaller region."
        )
    orders = highest_orders(frequencies, radius, nearest, _TOLERANCE[dtype.itemsize])
    return np.maximum.accumulate(orders)


def _angular(
    local: Float[np.ndarray, "nodes detectors 2"],
    shares: Float[np.ndarray, "nodes detectors"],
    usual: PolarGeometry,
    n_max: int,
) -> Float[np.ndarray, "orders 2 nodes detectors"]:
    """(cos|sin) n theta, theta counted from the axis, times the share of each point."""
    theta = np.arctan2(local[..., 1], local[..., 0]) - float(usual.axis)
    phase = np.arange(n_max + 1)[:, None, None] * theta
    return np.stack([np.cos(phase), np.sin(phase)], axis=1) * shares


def _waves(
    frequencies: Float[np.ndarray, " f"],
    needed: Int[np.ndarray, " f"],
    radius: float,
    places: Float[np.ndarray, " places"],
) -> tuple[Float[np.ndarray, "orders f"], Float[np.ndarray, "orders 2 f places"]]:
    """s_n of the traces of J_n cos n t, and eps_n s_n (J_n|Y_n)(lambda r): 0 beyond."""
    n_max = int(needed[-1])
    steps = known_decay_steps(n_max + 1, frequencies * radius)
    scale = np.cumprod(steps[:-1], axis=0)
    norms = known_disk_norms(frequencies * radius, radius, steps)  # over scale
    # what multiplies J_n / scale and Y_n scale
    factors = np.stack([norms * scale**2, norms], axis=1) * known_twice(n_max + 1)[:, None, None]
    found = np.zeros((*factors.shape, len(places)))
    rows = hankel_rows(frequencies[:, None] * places, steps[:-1], needed)
    for n, bessel in enumerate(rows):
        for kind, values in enumerate(bessel):
            first = len(frequencies) - len(values)
            np.multiply(values, factors[n, kind, first:, None], out=found[n, kind, first:])
    return norms * scale, found


def _products(
    matrix: Float[np.ndarray, "more 2 2 detectors"],
    values: Float[np.ndarray, "orders 2 nodes detectors"],
    angular: Float[np.ndarray, "most 2 nodes detectors"],
) -> None:
    """Write A: Σ over nodes of (J_n|Y_n) (cos|sin)."""
    n = len(values)
    np.einsum("njqk,npqk->npjk", values, angular[:n], out=matrix[:n])
    matrix[n:] = 0


def _empty(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Memory that JAX takes as an array without a copy: aligned."""
    size, itemsize = int(np.prod(shape)), np.dtype(dtype).itemsize
    memory = np.empty(size + _ALIGNED // itemsize, dtype)
    skipped = -memory.ctypes.data % _ALIGNED // itemsize
    return memory[skipped : skipped + size].reshape(shape)
