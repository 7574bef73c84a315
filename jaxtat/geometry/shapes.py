"""Acquisition curves from formulas: any smooth curve, ellipses, polylines, and several at once.

Detectors are at the midpoints of equal pieces, as along `circular_arc`. Everything is a
differentiable function of the numbers that describe the curve; how many detectors there are on each
piece is a size, and is not.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import (
    Numbers,
    by_library,
    is_concrete,
    real_array,
    require_positive,
    whole_number,
)
from .curves import DetectorCurve, SampledCurve, one_after_another, outward, with_elements
from .measured_curves import require_simple

_TABLE = 32  # nodes per detector, by which arc length is measured


def parametric_curve(
    position: Callable[[Array], Numbers],
    start: Numbers,
    stop: Numbers,
    n_detectors: int,
    *,
    closed: bool = False,
    element_width: Numbers | None = None,
) -> SampledCurve:
    """Detectors at the midpoints of n pieces of equal arc length of t -> position(t).

    Args:
        position: smooth, a number to (x_1, x_2), made of `jax.numpy`; what it closes over may be
            traced.
        start, stop: of t.
        n_detectors: at least 2.
        closed: whether the curve returns to where it starts.
        element_width: as in `detector_curve`.

    Returns:
        DetectorCurve: weights are length / n.

    Raises:
        ValueError: for fewer than 2 detectors, a curve without length, or one that crosses or
            repeats itself.

    >>> spiral = parametric_curve(lambda t: (1.2 + t / 20) * jnp.array([jnp.cos(t), jnp.sin(t)]),
    ...                           1.0, 5.0, 300)
    >>> exact = np.trapezoid(np.hypot(1.2 + (t := np.linspace(1, 5, 9001)) / 20, 1 / 20), t)
    >>> bool(abs(spiral.weights.sum() / exact - 1) < 1e-6)
    True
    """
    n = whole_number("n_detectors", n_detectors, 2)
    start, stop = real_array("start", start, ()), real_array("stop", stop, ())
    return _checked(_by_arc_length(position, start, stop, n, closed), element_width)


def elliptic_arc(
    semi_axes: Numbers,
    n_detectors: int,
    *,
    start: Numbers = 0.0,
    stop: Numbers = 2 * np.pi,
    center: Numbers = (0.0, 0.0),
    angle: Numbers = 0.0,
    element_width: Numbers | None = None,
) -> SampledCurve:
    """The arc (a cos t, b sin t), start < t < stop, turned by ``angle`` and moved to ``center``.

    Detectors are at the midpoints of pieces of equal length. The whole ellipse, stop - start = 2π,
    is marked as closed if both are known, not traced.

    Args:
        semi_axes: (a, b), above zero [length].
        n_detectors: at least 2.
        start, stop: of t [rad].
        center: (2,) [length].
        angle: of the first axis [rad].
        element_width: as in `detector_curve`.

    >>> half = elliptic_arc((1.6, 1.25), 200, start=np.pi / 2, stop=3 * np.pi / 2)
    >>> bool(jnp.all(half.points[:, 0] < 0)), round(float(half.weights.sum()), 4)
    (True, 4.4937)
    """
    n = whole_number("n_detectors", n_detectors, 2)
    semi_axes = real_array("semi_axes", semi_axes, (2,))
    start, stop = real_array("start", start, ()), real_array("stop", stop, ())
    center, angle = real_array("center", center, (2,)), real_array("angle", angle, ())
    require_positive("semi_axes", semi_axes)
    turn = 0.0
    if is_concrete(start, stop):
        turn = abs(float(stop) - float(start)) / (2 * np.pi)
        if not 0 < turn <= 1 + 1e-12:
            raise ValueError(
                f"t runs from {float(start):.6g} to {float(stop):.6g}, expected more than nothing "
                "and at most one turn, 2π."
            )
    closed = abs(turn - 1) < 1e-12
    arc = _elliptic(semi_axes, start, stop, center, angle, n, closed)
    return with_elements(arc, element_width)


def polyline(
    vertices: Numbers,
    n_detectors: int | Sequence[int],
    *,
    closed: bool = False,
    element_width: Numbers | None = None,
) -> SampledCurve:
    """Straight pieces from vertex to vertex: a line, an L, a U, or a polygon (``closed``).

    On each piece detectors are at the midpoints of equal parts, so that none is in a corner and the
    weights add up to its length.

    Args:
        vertices: at least 2, in order along the curve, (vertices, 2) [length].
        n_detectors: in all, shared out by length, or one number for each piece (needed where
            vertices are traced).
        closed: whether a last piece leads back to the first vertex.
        element_width: as in `detector_curve`.

    Raises:
        ValueError: for repeated vertices, pieces without a detector, and pieces that cross or cover
            each other.

    >>> u_shape = polyline([(1.2, 1.2), (-1.2, 1.2), (-1.2, -1.2), (1.2, -1.2)], 90)
    >>> u_shape.n_detectors, round(float(u_shape.weights.sum()), 12)
    (90, 7.2)
    """
    vertices = real_array("vertices", vertices, ("vertices", 2))
    if vertices.shape[0] < 2:
        raise ValueError(f"got {vertices.shape[0]} vertex, expected at least 2.")
    counts = shared_out("n_detectors", n_detectors, vertices, closed, least=1)
    if sum(counts) < 2:
        raise ValueError("got 1 detector, expected at least 2 on a curve.")
    parts = by_library(_polyline, (vertices,), counts)
    return _checked(SampledCurve(*parts, closed), element_width)


def join_curves(*curves: DetectorCurve) -> SampledCurve:
    """Several separate curves as one: each keeps its weights, and the gaps have none.

    Normals are turned away from the middle of all of them. Elements keep their widths, along the
    tangent.

    Args:
        curves: in the order in which their data come.

    Raises:
        ValueError: for no curves at all, and curves that cross each other.

    >>> from jaxtat import circular_arc
    >>> left, right = (circular_arc(1.3, -0.3, 50, angle=a) for a in (0.0, np.pi))
    >>> join_curves(left, right).n_detectors
    100
    """
    require_several("curve", DetectorCurve, curves)
    return _checked(one_after_another(curves))


def require_several(name: str, kind: type, objects: Sequence[Any]) -> None:
    """Raise ValueError for no arguments, and for a list in place of separate arguments."""
    if not objects:
        raise ValueError(f"got no {name}s, expected at least one.")
    for one in objects:
        if not isinstance(one, kind):
            raise ValueError(
                f"got a {type(one).__name__} for a {name}: expected each {name} as an argument of "
                f"its own, such as (first, second) or (*{name}s)."
            )


def shared_out(name: str, n: Any, vertices: Array, closed: bool, least: int) -> tuple[int, ...]:
    """How many of n points lie on each straight piece: in proportion to its length."""
    pieces = vertices.shape[0] - (not closed)
    length = None
    if is_concrete(vertices):
        known = np.asarray(vertices)
        length = np.hypot(*(np.roll(known, -1, axis=0) - known)[:pieces].T)
        if length.min() <= 1e-9 * length.max():
            raise ValueError("two neighbouring vertices are at the same position: leave one out.")
    if np.ndim(n) > 0:
        counts = tuple(whole_number(name, k, least) for k in n)
        if len(counts) != pieces:
            raise ValueError(
                f"{name} has {len(counts)} numbers, expected one for each of {pieces} straight "
                "pieces."
            )
    elif length is None:
        raise ValueError(f"{name} must be one number for each piece where vertices are traced.")
    else:
        n = whole_number(name, n, 1)
        edges = np.concatenate([[0.0], np.cumsum(length)]) * (n / length.sum())
        counts = tuple(int(k) for k in np.diff(np.floor(edges + 0.5)))
        if min(counts) < least:
            raise ValueError(
                f"{name} is {n}, which leaves {min(counts)} for the shortest of {len(counts)} "
                f"straight pieces, expected at least {least} on each."
            )
    return counts


def pieces_of_line(vertices: Any, counts: tuple[int, ...], xp: Any = jnp) -> tuple[Any, Any, Any]:
    """Midpoints of equal parts of every piece, their lengths, and the normals on the right.

    Args:
        vertices: (vertices, 2).
        counts: parts of every piece.
        xp: numpy or jax.numpy.
    """
    starts = vertices[: len(counts)]
    ends = xp.roll(vertices, -1, axis=0)[: len(counts)]
    which = np.repeat(np.arange(len(counts)), counts)
    share = np.concatenate([(np.arange(k) + 0.5) / k for k in counts])[:, None]
    along = ends - starts
    length = xp.sqrt((along**2).sum(axis=1))
    normals = xp.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    weights = length / np.array(counts)
    return starts[which] + share * along[which], weights[which], normals[which]


def _polyline(xp: Any, vertices: Any, counts: tuple[int, ...]) -> tuple[Any, Any, Any]:
    points, weights, normals = pieces_of_line(vertices, counts, xp)
    return points, weights, outward(points, normals, points.mean(axis=0), xp)


@partial(jax.jit, static_argnums=(5, 6))
def _elliptic(
    semi_axes: Array,
    start: Array,
    stop: Array,
    center: Array,
    angle: Array,
    n: int,
    closed: bool,
) -> SampledCurve:
    c, s = jnp.cos(angle), jnp.sin(angle)

    def position(t: Array) -> Array:
        x, y = semi_axes[0] * jnp.cos(t), semi_axes[1] * jnp.sin(t)
        return center + jnp.stack([c * x - s * y, s * x + c * y])

    return _by_arc_length(position, start, stop, n, closed)


@partial(jax.jit, static_argnums=(0, 3, 4))
def _by_arc_length(
    position: Callable[[Array], Numbers], start: Array, stop: Array, n: int, closed: bool
) -> SampledCurve:
    def place(t: Array) -> Array:
        return real_array("position(t)", position(t), (2,))

    def tangent(t: Array) -> Array:
        return jax.jvp(place, (t,), (jnp.ones_like(t),))[1]

    nodes = jnp.linspace(0.0, 1.0, _TABLE * n + 1)
    t = start + (stop - start) * nodes
    speed = jnp.linalg.norm(jax.vmap(tangent)(t), axis=1) * jnp.abs(stop - start)
    steps = (speed[1:] + speed[:-1]) / (2 * _TABLE * n)
    length = jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])
    middle = _inverse((jnp.arange(n) + 0.5) / n * length[-1], t, length, speed)
    points, along = jax.vmap(place)(middle), jax.vmap(tangent)(middle)
    along = along / jnp.linalg.norm(along, axis=1, keepdims=True)
    normals = jnp.stack([along[:, 1], -along[:, 0]], axis=1)
    weights = jnp.broadcast_to(length[-1] / n, (n,))
    return SampledCurve(points, weights, outward(points, normals, points.mean(axis=0)), closed)


def _inverse(
    wanted: Float[Array, " n"],
    t: Float[Array, " nodes"],
    length: Float[Array, " nodes"],
    speed: Float[Array, " nodes"],
) -> Float[Array, " n"]:
    """t at given lengths, by a cubic that has the slope 1 / speed at every node.

    With straight lines t would have a kink, and no derivative, wherever a detector comes to lie on
    a node: in the middle of every symmetric curve. Slopes up to three times those of the lines keep
    cubics monotone (Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246).
    """
    i = jnp.clip(jnp.searchsorted(length, wanted, side="right") - 1, 0, length.shape[0] - 2)
    step = length[i + 1] - length[i]
    share = (wanted - length[i]) / jnp.where(step > 0, step, 1.0)
    mean = (speed[i] + speed[i + 1]) / 2
    first, last = (
        jnp.minimum(mean / jnp.where(end > 0, end, 1.0), 3.0) for end in (speed[i], speed[i + 1])
    )
    bend = (first - 1) * (1 - share) - (last - 1) * share
    return t[i] + (t[i + 1] - t[i]) * (share + share * (1 - share) * bend)


def _checked(curve: SampledCurve, element_width: Numbers | None = None) -> SampledCurve:
    if is_concrete(curve):
        length = float(np.asarray(curve.weights).sum())
        if not (np.isfinite(length) and length > 0):
            raise ValueError(f"the curve's length is {length:.6g}, expected a value above zero.")
        require_simple(np.asarray(curve.points), curve.closed)
    return curve if element_width is None else with_elements(curve, element_width)
