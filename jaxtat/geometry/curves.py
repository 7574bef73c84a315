"""Acquisition curves: where the detectors are."""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..checks import Numbers, is_concrete, real_array, require_positive, whole_number


class DetectorCurve(eqx.Module):
    """Detectors z_k on an acquisition curve gamma: ∫_gamma u dl ≈ Σ_k w_k u(z_k).

    A new curve needs these four, and a line in io/plans.py to be saved.

    Attributes:
        points: detector positions z_k, (detectors, 2), in order along the curve [length].
        weights: arc length w_k that belongs to each detector, (detectors,) [length].
        normals: unit normals, pointing away from the side of the region, (detectors, 2).
        closed: whether the curve returns to its first detector.
    """

    points: eqx.AbstractVar[Float[Array, "detectors 2"]]
    weights: eqx.AbstractVar[Float[Array, " detectors"]]
    normals: eqx.AbstractVar[Float[Array, "detectors 2"]]
    closed: eqx.AbstractVar[bool]

    @property
    def n_detectors(self) -> int:
        return self.points.shape[0]


class SampledCurve(DetectorCurve):
    """A curve known by its detectors."""

    points: Float[Array, "detectors 2"]
    weights: Float[Array, " detectors"]
    normals: Float[Array, "detectors 2"]
    closed: bool = eqx.field(static=True)


class CircularArc(DetectorCurve):
    """Equispaced detectors on a circle, which stay on it whatever becomes of the parameters.

    Attributes:
        center, radius: of the circle [length].
        angle: the direction in which the arc opens [rad].
        half_opening: half the angle under which the opening is seen from the centre [rad].
        n, closed: number of detectors, and whether the opening is none.
    """

    center: Float[Array, "2"]
    radius: Float[Array, ""]
    angle: Float[Array, ""]
    half_opening: Float[Array, ""]
    n: int = eqx.field(static=True)
    closed: bool = eqx.field(static=True)

    @property
    def span(self) -> Float[Array, ""]:
        """Angle of the arc as seen from the centre [rad]."""
        return 2 * jnp.pi - 2 * self.half_opening

    @property
    @eqx.filter_jit
    def angles(self) -> Float[Array, " detectors"]:
        """Of the detectors, counted from the middle of the arc, opposite the opening [rad]."""
        return ((jnp.arange(self.n) + 0.5) / self.n - 0.5) * self.span

    @property
    @eqx.filter_jit
    def points(self) -> Float[Array, "detectors 2"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.center + self.radius * self.normals

    @property
    @eqx.filter_jit
    def weights(self) -> Float[Array, " detectors"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return jnp.broadcast_to(self.radius * self.span / self.n, (self.n,))

    @property
    @eqx.filter_jit
    def normals(self) -> Float[Array, "detectors 2"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        theta = self.angle + jnp.pi + self.angles
        return jnp.stack([jnp.cos(theta), jnp.sin(theta)], axis=-1)

    @property
    def n_detectors(self) -> int:
        return self.n


class Circle(eqx.Module):
    """A circle |z - center| = radius [length]."""

    center: Float[Array, "2"]
    radius: Float[Array, ""]


def circular_arc(
    radius: Numbers,
    z_right: Numbers,
    n_detectors: int,
    *,
    center: Numbers = (0.0, 0.0),
    angle: Numbers = 0.0,
) -> CircularArc:
    """The arc |z| = R_g, z_1 < z_right with detectors at the midpoints of n equal pieces.

    The arc is then turned by ``angle`` and moved to ``center``: it opens towards
    (cos angle, sin angle). ``z_right >= radius`` gives the full circle (marked as closed if both
    are known, not traced).

    Args:
        radius: R_g > 0 [length].
        z_right: the arc ends on the line z_1 = z_right, above -radius [length].
        n_detectors: number of detectors, at least 2.
        center: centre of the circle, (2,) [length].
        angle: direction in which the arc opens [rad].

    Returns:
        CircularArc, detectors anticlockwise from one end of the opening to the other.

    Raises:
        ValueError: for fewer than 2 detectors, radius <= 0 or an empty arc.

    Source: Kunyansky 2008, section 4 (geometries #1 and #2 have R_g = 1.3, z_right = 1 and 0).

    >>> curve = circular_arc(1.3, 0.0, 500)
    >>> round(float(curve.weights.sum() / 1.3), 12)  # half a circle
    3.14159265359
    """
    n_detectors = whole_number("n_detectors", n_detectors, 0)
    _require_detectors(n_detectors)
    radius, z_right = real_array("radius", radius, ()), real_array("z_right", z_right, ())
    center, angle = real_array("center", center, (2,)), real_array("angle", angle, ())
    require_positive("radius", radius)
    closed = is_concrete(radius, z_right) and float(z_right) >= float(radius)
    if is_concrete(radius, z_right) and float(z_right) <= -float(radius):
        raise ValueError(
            f"the arc |z| = {float(radius)}, z_1 < {float(z_right)} is empty: "
            "z_right must be above -radius."
        )
    half_opening = opening_angle(z_right / radius)
    return CircularArc(  # pyright: ignore[reportCallIssue] (abstract variables are no arguments)
        center, radius, angle, half_opening, n_detectors, closed
    )


def detector_curve(positions: Numbers, *, closed: bool | None = None) -> SampledCurve:
    """Acquisition curve through measured detector positions, in order along the curve.

    Each detector owns half the arc to either neighbour, w_k = (l_{k-1,k} + l_{k,k+1})/2; an end
    detector owns a full step, as if its sensitive area reached half a step past it. The arcs l and
    the tangents are those of the circle through three neighbouring detectors: exact for a circle;
    for other smooth curves weights are third and normals second order in the spacing. Beside a gap
    of more than four median steps a detector counts as an end.

    Args:
        positions: (detectors, 2), or (detectors, 3) where one of the three coordinates is constant
            (a planar array) and is dropped [length]. Any orientation, any spacing.
        closed: whether the last detector is a neighbour of the first. By default it is if that
            distance is at most twice the median step; under tracing it must be given.

    Returns:
        DetectorCurve with normals on the outer side, away from the middle of the curve.

    Raises:
        ValueError: for fewer than 3 detectors, positions off a plane, repeated or unsorted ones.

    >>> import numpy as np
    >>> theta = np.linspace(0.8, 5.5, 256)
    >>> curve = detector_curve(40.5e-3 * np.stack([np.cos(theta), np.sin(theta)], axis=1))
    >>> np.allclose(curve.weights, 40.5e-3 * 4.7 / 255, rtol=1e-12)
    True
    """
    points = in_plane(positions)
    _require_detectors(points.shape[0], least=3)
    if is_concrete(points):
        closed = is_closed(np.asarray(points)) if closed is None else closed
        require_sorted(np.asarray(points), closed)
    elif closed is None:
        raise ValueError(
            "closed must be given (True or False) when the detector positions are traced."
        )
    return _sampled(points, bool(closed))


def keep_detectors(curve: DetectorCurve, keep: Numbers | np.ndarray) -> SampledCurve:
    """The curve without some detectors; each of the others owns half the arc to its neighbours.

    So the gap of one missing detector is shared by those beside it. One of more than four median
    steps is a gap in the curve: the detectors beside it are ends, and nobody stands for it. Data
    keep the same rows, ``g[..., keep, :]``.

    Args:
        curve: any, its weights are not used.
        keep: whether each detector stays, boolean, (detectors,), concrete; such as
            ``channel_quality(...).good``.

    Returns:
        DetectorCurve, differentiable with respect to the positions.

    Raises:
        ValueError: for a mask that does not fit, is traced, or keeps fewer than 3.

    >>> curve = circular_arc(1.3, 0.0, 100)
    >>> keep = np.arange(100) != 40
    >>> found = keep_detectors(curve, keep).weights * (100 / (np.pi * 1.3))
    >>> [round(float(w), 9) for w in found[37:43]]
    [1.0, 1.0, 1.5, 1.5, 1.0, 1.0]
    """
    if not is_concrete(keep):
        raise ValueError("keep is traced, expected a concrete mask: sizes depend on it.")
    mask = np.asarray(keep)
    if mask.dtype != bool or mask.shape != (curve.n_detectors,):
        raise ValueError(
            f"keep has dtype {mask.dtype} and shape {mask.shape}, expected booleans "
            f"({curve.n_detectors},)."
        )
    _require_detectors(int(mask.sum()), least=3)
    return _sampled(curve.points[np.flatnonzero(mask)], curve.closed)


@partial(jax.jit, static_argnums=1)
def _sampled(points: Array, closed: bool) -> SampledCurve:
    """Weights and normals from the circles through three neighbours."""
    before, here, after = _neighbours(points, closed)
    step = _arc_to_next(before, here, after)  # from each detector to the next one
    ends = jnp.roll(step, 1) if closed else jnp.concatenate([step[:1], step[:-1]])
    step = step if closed else step.at[-1].set(step[-2])
    gap = (4 + 1e-9) * jnp.median(step)  # three missing of equal ones are not a gap yet
    ends, step = jnp.where(ends > gap, step, ends), jnp.where(step > gap, ends, step)
    tangents = _tangents(before, here, after)
    normals = jnp.stack([tangents[:, 1], -tangents[:, 0]], axis=-1)
    outward = jnp.sum(normals * (points - points.mean(axis=0)))
    side = jnp.where(outward < 0, -1.0, 1.0)  # of a straight array either is as good
    return SampledCurve(points, (ends + step) / 2, side * normals, closed)


def turned_views(curve: DetectorCurve, turns: Numbers) -> SampledCurve:
    """One array in several positions: detectors of view 1, 2, ..., each turned about the origin.

    An array that sees too little at once is turned about the object, or the object before it. The
    weights are divided by the number of views, so that places visited twice count once.

    Args:
        curve: the array at turn 0, the axis of rotation at the origin.
        turns: angles, (views,) [rad].

    Returns:
        DetectorCurve of views * detectors positions.

    >>> import numpy as np
    >>> half = circular_arc(1.3, 0.0, 40)
    >>> both = turned_views(half, [0.0, np.pi])
    >>> both.n_detectors, bool(abs(both.points[:40] + both.points[40:]).max() < 1e-12)
    (80, True)
    """
    turns = real_array("turns", turns, ("views",))
    n = whole_number("the number of views", turns.shape[0], 1)
    c, s = jnp.cos(turns), jnp.sin(turns)
    turn = jnp.stack([jnp.stack([c, -s], axis=-1), jnp.stack([s, c], axis=-1)], axis=-2)

    def turned(vectors: Array) -> Array:
        return jnp.einsum("vij,kj->vki", turn, vectors).reshape(-1, 2)

    weights = jnp.tile(curve.weights / n, n)
    return SampledCurve(turned(curve.points), weights, turned(curve.normals), False)


@jax.jit
def opening_angle(cosine: Array) -> Array:
    """arccos(cosine), and 0 with derivative 0 for a circle that is not cut, cosine >= 1."""
    cut = cosine < 1
    return jnp.where(cut, jnp.arccos(jnp.where(cut, cosine, 0.0)), 0.0)


def fit_circle(points: Numbers) -> Circle:
    """Circle closest to points: least squares of |z|² - 2 c·z - (R_g² - |c|²).

    Raises:
        ValueError: for fewer than 3 points, or points on a straight line.

    Args:
        points: (n, 2), at least 3 of them, not on one line [length].

    Returns:
        Circle, a differentiable function of the points.

    Source: I. Kåsa, IEEE Trans. Instrum. Meas. 25 (1976) 8-14.

    >>> circle = fit_circle(circular_arc(1.3, 0.2, 40, center=(2.0, -1.0)).points)
    >>> [round(float(v), 9) for v in (*circle.center, circle.radius)]
    [2.0, -1.0, 1.3]
    """
    points = real_array("points", points, ("points", 2))
    _require_detectors(points.shape[0], least=3)
    if not is_concrete(points):
        return Circle(*_fit_circle(points, jnp)[:2])
    center, radius, size = _fit_circle(np.asarray(points), np)  # no program for known positions
    if not float(radius) < 1e4 * float(size):
        raise ValueError("the points lie on a straight line, expected part of a circle.")
    return Circle(*jax.device_put((center, np.asarray(radius))))


def _fit_circle(points: Any, xp: Any) -> tuple[Any, Any, Any]:
    """Centre, radius, and how far the points reach from their middle, by numpy or jax.numpy."""
    middle = points.mean(axis=0)
    local = points - middle  # centred, so that the normal equations are well conditioned
    design = xp.concatenate([2 * local, xp.ones_like(local[:, :1])], axis=1)
    try:
        solution = xp.linalg.solve(design.T @ design, design.T @ xp.sum(local**2, axis=1))
    except np.linalg.LinAlgError:
        solution = np.full(3, np.inf)
    center = solution[:2]
    radius = xp.sqrt(solution[2] + center @ center)
    return center + middle, radius, xp.abs(local).max()


def _require_detectors(n_detectors: int, least: int = 2) -> None:
    if n_detectors < least:
        raise ValueError(f"got {n_detectors} detector(s), expected at least {least} on a curve.")


def in_plane(positions: Numbers) -> Float[Array, "detectors 2"]:
    points = real_array("positions", positions, ("detectors", None))
    if points.shape[1] not in (2, 3):
        raise ValueError(f"positions has shape {points.shape}, expected (detectors, 2 or 3).")
    if points.shape[1] == 2:
        return points
    if not is_concrete(points):
        raise ValueError("traced positions must be (detectors, 2): drop the constant coordinate.")
    spread = np.ptp(np.asarray(points), axis=0)
    flat = int(np.argmin(spread))
    if spread[flat] > 1e-3 * spread.max():
        raise ValueError(
            f"the detectors do not lie in a coordinate plane: their coordinates spread over "
            f"{spread}; rotate them into a plane and pass the two coordinates in it."
        )
    return jnp.delete(points, flat, axis=1)


def is_closed(points: np.ndarray) -> bool:
    """Whether the last detector is a neighbour of the first."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return bool(np.linalg.norm(points[0] - points[-1]) <= 2 * np.median(steps))


def require_sorted(points: np.ndarray, closed: bool) -> None:
    """Neighbours in the array must be neighbours on the curve: no repeats, turns back or jumps."""
    steps = np.diff(np.concatenate([points, points[:1]]), axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    inner = lengths if closed else lengths[:-1]
    if inner.min() == 0.0:
        k = int(np.argmin(inner))
        raise ValueError(f"detectors {k} and {k + 1} are at the same position: leave one out.")
    directions = steps[: len(inner)] / inner[:, None]
    turns = np.sum(directions[1:] * directions[:-1], axis=1)
    advice = "sort the detectors along the curve (an arc: by angle) and their data with them."
    if turns.min() < -0.8:  # swapped neighbours turn right round, a coarse triangle by 120 degrees
        k = int(np.argmin(turns)) + 1
        raise ValueError(f"the detectors are not in order: the curve turns back at {k}; {advice}")
    k = int(np.argmax(inner))
    if inner[k] > 4 * np.median(lengths) and (closed or inner[k] > lengths[-1]):
        raise ValueError(
            f"the detectors are not in order: the widest opening lies between detectors {k} and "
            f"{k + 1}, inside the sequence; start behind it with np.roll(..., -{k + 1}, axis=0), "
            "the data likewise, or say whether the curve is closed (closed=True or False)."
        )


def _neighbours(points: Array, closed: bool) -> tuple[Array, Array, Array]:
    """For each detector the three points of its circle; open ends take two from one side."""
    before, after = jnp.roll(points, 1, axis=0), jnp.roll(points, -1, axis=0)
    if not closed:
        before, after = before.at[0].set(points[2]), after.at[-1].set(points[-3])
    return before, points, after


def _tangents(before: Array, here: Array, after: Array) -> Array:
    """Unit tangents at ``here`` of the circles through the three points.

    Inversion about ``here`` maps the circle to a straight line parallel to its tangent.
    """
    ahead, behind = after - here, before - here
    tangent = ahead / _square(ahead) - behind / _square(behind)
    # at the open ends both neighbours lie on one side; keep the direction of travel
    tangent = tangent.at[0].multiply(jnp.sign(tangent[0] @ (here[1] - here[0])))
    tangent = tangent.at[-1].multiply(jnp.sign(tangent[-1] @ (here[-1] - here[-2])))
    return tangent / jnp.sqrt(_square(tangent))


def _arc_to_next(before: Array, here: Array, after: Array) -> Array:
    """Arc length (2/κ) asin(κ c/2) over the chord c to the next point, κ of the three points."""
    chord = jnp.sqrt(_square(jnp.roll(here, -1, axis=0) - here))
    a, b = after - here, before - here
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    curvature2 = 4 * cross**2 / (_square(a) * _square(b) * _square(a - b))[:, 0]
    # the chord that closes an open curve is no arc of it, and is replaced by the caller
    x2 = jnp.minimum(curvature2 * chord[:, 0] ** 2 / 4, 0.999)
    small = x2 < 1e-8  # asin(x)/x, by its series where the quotient and its derivative are 0/0
    x = jnp.sqrt(jnp.where(small, 0.5, x2))
    return chord[:, 0] * jnp.where(small, 1 + x2 / 6, jnp.arcsin(x) / x)


def _square(vectors: Array) -> Array:
    return jnp.sum(vectors**2, axis=-1, keepdims=True)
