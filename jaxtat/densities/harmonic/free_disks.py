"""Densities for a whole disk anywhere among the detectors: without symmetry, and soon.

Cylindrical waves about the disk's own centre keep R diagonal; the detectors have distances r_k of
their own, and A = R M needs (J_n|Y_n)(lambda r_k). For one alpha no decomposition is needed but an
inverse, of the smaller of two matrices,

    (A A^T + alpha)^-1 A = A (A^T A + alpha)^-1,

and the densities stay a product of two matrices.

By numpy, whose products of a matrix with its own transpose take half the time of XLA's, and with
which nothing is compiled.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float
from threadpoolctl import threadpool_limits

from ...geometry import DetectorCurve, Disk
from ...regularization import RelativeTikhonov, Tikhonov
from ...special import hankel_rows, known_decay_steps
from .densities import HarmonicDensities, Solved, rows_alone
from .moved_units import circle_places, moved_unit
from .orders import highest_orders
from .polar import REACHED, PolarGeometry, polar_geometry
from .tikhonov_rows import alphas_of

AT_ONCE = 32  # frequencies of one call, whose tables stay in a cache
EXACT_BELOW = 3e-3  # alpha over its unit, below which inverses are found in double precision,
DOUBLE_BELOW = 3e-4  # and below which matrices are to be kept so
_LEAF = 32  # rows of a matrix that is inverted without being parted
_ALIGNED = 64  # bytes: such arrays JAX takes without a copy


class Potentials(eqx.Module):
    """A of frequencies that have as many orders.

    Attributes:
        matrix: A, columns as in `fold`.
        scale: eps Delta R.
    """

    matrix: Float[Array, "*f 1 r columns"]
    scale: Float[Array, "*f 1 r"]


class FreeWaves(eqx.Module):
    """A of all frequencies of a whole disk.

    Attributes:
        groups: in the order of the frequencies.
        unit: of alpha [length²].
        frequencies: lambda [rad/length].
        angles: of the directions, counted from the axis [rad].
    """

    groups: tuple[Potentials, ...]
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
    groups = _enough(groups, known, radius, float(distances.min()))
    angular = _angular(local, shares, usual, max(orders for *_, orders in groups))
    around = circle_places(usual)
    found, units = [], []
    for start, stop, orders in groups:
        matrix = _empty((stop - start, 2, orders + 1, 2, distances.shape[1]), dtype)
        scale = np.empty((stop - start, 2, orders + 1), dtype)
        for first in range(start, stop, AT_ONCE):
            few, here = known[first:stop][:AT_ONCE], slice(first - start, first - start + AT_ONCE)
            norms, circle = _filled(matrix[here], few, radius, distances, angular, around)
            scale[here] = (norms * _twice(orders)).T[:, None]
            if usual.on_circle:
                units.append(moved_unit(usual, center, few, norms, circle))
        rows = matrix.reshape(len(matrix), 1, 2 * orders + 2, -1)
        if not usual.on_circle:
            units.append(np.einsum("fbrc,fbrc->fbr", rows, rows).max(axis=(1, 2)))
        found.append(Potentials(*jax.device_put((rows, scale.reshape(rows.shape[:-1])))))
    return FreeWaves(tuple(found), np.concatenate(units), frequencies, angles - usual.axis)


def wants_double(waves: FreeWaves, rule: Tikhonov | RelativeTikhonov) -> bool:
    """Whether alpha is so small that matrices in single precision give less than four digits.

    Rounding grows like the unit of alpha over alpha.
    """
    return _least(waves, alphas_of(rule, waves.unit, waves.frequencies)) < DOUBLE_BELOW


def inverse_densities(waves: FreeWaves, rule: Tikhonov | RelativeTikhonov) -> HarmonicDensities:
    """The densities of all plane waves by a rule, a number or one for each frequency."""
    alphas = alphas_of(rule, waves.unit, waves.frequencies)
    exact, start, groups = _least(waves, alphas) < EXACT_BELOW, 0, []
    for group in waves.groups:
        stop = start + len(group.scale)
        inverse = _inverses(np.asarray(group.matrix), alphas[start:stop], exact)
        rows = Solved(group.scale, group.matrix, jax.device_put(inverse))
        groups.append(rows_alone(rows, len(waves.angles)))
        start = stop
    phases = np.ones((start, len(waves.angles)), groups[0].extra.dtype)
    return HarmonicDensities(tuple(groups), waves.angles, jax.device_put(phases), mirror=False)


def _least(waves: FreeWaves, alphas: Float[np.ndarray, " f"]) -> float:
    """The least alpha over its unit."""
    return float((alphas / waves.unit).min())


def _inverses(
    matrices: Float[np.ndarray, "f 1 r columns"], alphas: Float[np.ndarray, " f"], exact: bool
) -> Float[np.ndarray, "f 1 k k"]:
    """Of A A^T + alpha, or of A^T A + alpha where that is smaller."""
    size = min(matrices.shape[-2:])
    found = _empty((len(matrices), 1, size, size), matrices.dtype)

    def find(number: int) -> None:
        matrix = matrices[number, 0].astype(float if exact else matrices.dtype, copy=False)
        wide = matrix if size == len(matrix) else matrix.T
        gram = wide @ wide.T
        gram[np.diag_indices(size)] += alphas[number]
        # LAPACK has columns in order: what is an upper triangle to it is a lower one here
        upper = scipy.linalg.cholesky(gram.T, overwrite_a=True, check_finite=False)
        half = _triangle_inverse(upper.T)
        found[number] = half.T @ half

    # a thread for each matrix: more, within one, would wait for each other
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(find, range(len(matrices))))
    return found


def _triangle_inverse(triangle: Float[np.ndarray, "r r"]) -> Float[np.ndarray, "r r"]:
    """Of a lower triangle, by its halves: nearly all of it is products, unlike in LAPACK."""
    if len(triangle) <= _LEAF:
        return np.linalg.inv(triangle)
    h = len(triangle) // 2
    found = np.zeros_like(triangle)
    found[:h, :h] = first = _triangle_inverse(triangle[:h, :h])
    found[h:, h:] = last = _triangle_inverse(triangle[h:, h:])
    found[h:, :h] = -last @ (triangle[h:, :h] @ first)
    return found


def _nodes(
    curve: DetectorCurve, center: Float[np.ndarray, "2"], n_nodes: int
) -> tuple[Float[np.ndarray, "nodes detectors 2"], Float[np.ndarray, "nodes detectors"]]:
    """Points of the detectors from the centre, and √w times the share of each."""
    points, shares = map(np.asarray, curve.element_nodes(n_nodes))
    return np.moveaxis(points - center, 1, 0), shares[:, None] * np.sqrt(np.asarray(curve.weights))


def _enough(
    groups: Sequence[tuple[int, int, int]],
    frequencies: Float[np.ndarray, " f"],
    radius: float,
    nearest: float,
) -> list[tuple[int, int, int]]:
    """The groups with orders that reach the nearest detector too."""
    if radius >= REACHED * nearest:
        raise ValueError(
            f"the region has radius {radius:.6g}, and a detector is only {nearest:.6g} from its "
            "centre: move it by less, or make another function for a smaller region."
        )
    needed = highest_orders(frequencies, radius, nearest)
    return [(a, b, max(orders, int(needed[a:b].max()))) for a, b, orders in groups]


def _angular(
    local: Float[np.ndarray, "nodes detectors 2"],
    shares: Float[np.ndarray, "nodes detectors"],
    usual: PolarGeometry,
    n_max: int,
) -> Float[np.ndarray, "2 orders nodes detectors"]:
    """(cos|sin) n theta, theta counted from the axis, times the share of each point."""
    theta = np.arctan2(local[..., 1], local[..., 0]) - float(usual.axis)
    phase = np.arange(n_max + 1)[:, None, None] * theta
    return np.stack([np.cos(phase), np.sin(phase)]) * shares


def _filled(
    matrix: Float[np.ndarray, "f 2 orders 2 detectors"],
    frequencies: Float[np.ndarray, " f"],
    radius: float,
    distances: Float[np.ndarray, "nodes detectors"],
    angular: Float[np.ndarray, "2 more nodes detectors"],
    around: Float[np.ndarray, " places"],
) -> tuple[Float[np.ndarray, "orders f"], Float[np.ndarray, "orders 2 f places"]]:
    """Write A; s_n of the traces of J_n cos n t, and eps_n s_n (J_n|Y_n)(lambda r) at places."""
    orders = matrix.shape[2] - 1
    steps = known_decay_steps(orders + 1, frequencies * radius)
    scale = np.cumprod(steps[:-1], axis=0)
    norms = _disk_norms(frequencies * radius, radius, steps)  # over scale
    # what multiplies J_n / scale and Y_n scale
    factors = (
        np.stack([norms * scale**2, norms], axis=1)[..., None] * _twice(orders)[..., None, None]
    )
    circle = np.empty((*factors.shape[:-1], len(around)))
    places = np.append(distances, around)
    rows = hankel_rows(frequencies[:, None] * places, steps[:-1])
    for n, bessel in enumerate(rows):
        for kind, factor in enumerate(factors[n]):
            values = bessel[kind] * factor
            at_elements = values[:, : distances.size].reshape(-1, *distances.shape)
            circle[n, kind] = values[:, distances.size :]
            matrix[:, :, n, kind] = np.einsum("fqk,pqk->fpk", at_elements, angular[:, n])
    return norms * scale, circle


def _disk_norms(
    x: Float[np.ndarray, " f"], radius: float, steps: Float[np.ndarray, "more f"]
) -> Float[np.ndarray, "orders f"]:
    """`waves.disk_norms` of the cosines, x = lambda R."""
    j = np.stack([value[:, 0] for value, _ in hankel_rows(x[:, None], steps)])
    before = np.concatenate([-j[1:2] * steps[1], j[:-2] / steps[1:-1]])  # J_{-1} = -J_1
    slope = (before - j[1:] * steps[1:]) / 2
    norm = np.sqrt(np.pi * radius * (j[:-1] ** 2 + slope**2))
    norm[0] *= np.sqrt(2)
    return norm


def _twice(n_max: int) -> Float[np.ndarray, "orders 1"]:
    """eps_n: 1 for n = 0, else 2."""
    return np.where(np.arange(n_max + 1) == 0, 1.0, 2.0)[:, None]


def _empty(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Memory that JAX takes as an array without a copy: aligned."""
    size, itemsize = int(np.prod(shape)), np.dtype(dtype).itemsize
    memory = np.empty(size + _ALIGNED // itemsize, dtype)
    skipped = -memory.ctypes.data % _ALIGNED // itemsize
    return memory[skipped : skipped + size].reshape(shape)
