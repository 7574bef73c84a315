"""Acquisition curves: detectors on a curve, the circular arc, several curves joined to one."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import equinox as eqx
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
from ..base.hashable_methods import ComparedByIdentity
from .elements import (
    NODES,
    checked_width,
    gauss_rule,
    mean_over_nodes,
    nodes_along_circle,
    nodes_along_tangent,
)

T = TypeVar("T")
C = TypeVar("C", bound="DetectorCurve")


class DetectorCurve(ComparedByIdentity, eqx.Module):
    """Detectors z_k on an acquisition curve gamma: ∫_gamma u dl ≈ Σ_k w_k u(z_k).

    A new curve needs these five, and a line in io/plans.py to be saved.

    Attributes:
        points: detector positions z_k, (detectors, 2), in order along the curve [length].
        weights: arc length w_k that belongs to each detector, (detectors,) [length].
        normals: unit normals, pointing away from the side of the region, (detectors, 2).
        closed: whether the curve returns to its first detector.
        element_width: of the detectors' sensitive elements, () or (detectors,): a datum is the mean
            of g(z, r) over the element; None or 0 of point detectors [length].
    """

    points: eqx.AbstractVar[Float[Array, "detectors 2"]]
    weights: eqx.AbstractVar[Float[Array, " detectors"]]
    normals: eqx.AbstractVar[Float[Array, "detectors 2"]]
    closed: eqx.AbstractVar[bool]
    element_width: eqx.AbstractVar[Float[Array, "*one_or_detectors"] | None]

    @property
    def shape(self) -> tuple[int]:
        """Shape of the detectors: (detectors,)."""
        return (self.n_detectors,)

    @property
    def n_detectors(self) -> int:
        return self.points.shape[0]

    def element_nodes(
        self, n: int = NODES
    ) -> tuple[Float[Array, "detectors nodes 2"], Float[Array, " nodes"]]:
        """Points z_ki and weights c_i with mean over element k ≈ Σ_i c_i u(z_ki), Σ_i c_i = 1.

        A Gauss rule along the tangent, on a `CircularArc` along the circle. Point detectors are
        their own only node.

        Args:
            n: nodes on an element of finite width, see `elements.enough_nodes`.

        >>> curve = circular_arc(1.3, 0.0, 6, element_width=0.2)
        >>> points, weights = curve.element_nodes(5)
        >>> points.shape, bool(abs(jnp.linalg.norm(points, axis=-1) - 1.3).max() < 1e-12)
        ((6, 5, 2), True)
        """
        if self.element_width is None:
            nodes = by_library(lambda _, points: points[:, None], (self.points,))
            return nodes, jax.device_put(np.ones(1))
        nodes, weights = gauss_rule(n)
        return self._nodes(nodes), jax.device_put(weights)

    def _nodes(self, nodes: np.ndarray) -> Float[Array, "detectors nodes 2"]:
        """The points at (-1, 1) times half a width along the elements."""
        where = self.points, self.normals, self.element_width
        return by_library(nodes_along_tangent, where, nodes)

    def mean_over_elements(
        self, compute: Callable[[Float[Array, "detectors 2"]], T], n: int = NODES
    ) -> T:
        """Means over the elements of ``compute``, a function of one point of each element.

        Args:
            compute: of positions, (detectors, 2), to arrays; called once, with the detectors
                themselves, if they are points.
            n: as for `element_nodes`.
        """
        if self.element_width is None:
            return compute(self.points)
        points, weights = self.element_nodes(n)
        return mean_over_nodes(compute, jnp.moveaxis(points, 1, 0), weights)


class SampledCurve(DetectorCurve):
    """A curve given by the positions of its detectors."""

    points: Float[Array, "detectors 2"]
    weights: Float[Array, " detectors"]
    normals: Float[Array, "detectors 2"]
    closed: bool = eqx.field(static=True)
    element_width: Float[Array, "*one_or_detectors"] | None = None


class CircularArc(DetectorCurve):
    """Equispaced detectors on a circle, given by its parameters.

    Attributes:
        center, radius: of the circle [length].
        angle: the direction in which the arc opens [rad].
        half_opening: half the angle under which the opening is seen from the centre [rad].
        n, closed: number of detectors, and whether the opening is none.
        element_width: as of every `DetectorCurve`; elements are arcs of the circle.
    """

    center: Float[Array, "2"]
    radius: Float[Array, ""]
    angle: Float[Array, ""]
    half_opening: Float[Array, ""]
    n: int = eqx.field(static=True)
    closed: bool = eqx.field(static=True)
    element_width: Float[Array, "*one_or_detectors"] | None = None

    @property
    def span(self) -> Float[Array, ""]:
        """Angle of the arc as seen from the centre [rad]."""
        return 2 * jnp.pi - 2 * self.half_opening

    @property
    def angles(self) -> Float[Array, " detectors"]:
        """Angles of the detectors, from the middle of the arc, opposite the opening [rad]."""
        return by_library(_arc_angles, (self.half_opening,), self.n)

    @property
    def points(self) -> Float[Array, "detectors 2"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        where = self.half_opening, self.angle, self.center, self.radius
        return by_library(_arc_points, where, self.n)

    @property
    def weights(self) -> Float[Array, " detectors"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return by_library(_arc_weights, (self.half_opening, self.radius), self.n)

    @property
    def normals(self) -> Float[Array, "detectors 2"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return by_library(_arc_normals, (self.half_opening, self.angle), self.n)

    @property
    def n_detectors(self) -> int:
        return self.n

    @property
    def element_angle(self) -> Float[Array, "*one_or_detectors"] | None:
        """D, the angle that an element subtends at the centre; None for point detectors [rad]."""
        return None if self.element_width is None else self.element_width / self.radius

    def _nodes(self, nodes: np.ndarray) -> Float[Array, "detectors nodes 2"]:
        where = self.center, self.radius, self.normals, self.element_width
        return by_library(nodes_along_circle, where, nodes)


def _arc_angles(xp: Any, half_opening: Any, n: int) -> Any:
    return ((xp.arange(n) + 0.5) / n - 0.5) * (2 * np.pi - 2 * half_opening)


def _arc_normals(xp: Any, half_opening: Any, angle: Any, n: int) -> Any:
    theta = angle + np.pi + _arc_angles(xp, half_opening, n)
    return xp.stack([xp.cos(theta), xp.sin(theta)], axis=-1)


def _arc_points(xp: Any, half_opening: Any, angle: Any, center: Any, radius: Any, n: int) -> Any:
    return center + radius * _arc_normals(xp, half_opening, angle, n)


def _arc_weights(xp: Any, half_opening: Any, radius: Any, n: int) -> Any:
    return xp.broadcast_to(radius * (2 * np.pi - 2 * half_opening) / n, (n,))


def circular_arc(
    radius: Numbers,
    cut: Numbers,
    n_detectors: int,
    *,
    center: Numbers = (0.0, 0.0),
    angle: Numbers = 0.0,
    element_width: Numbers | None = None,
) -> CircularArc:
    """The arc |z| = R_g, z_1 < cut with detectors at the midpoints of n equal pieces.

    The arc is then turned by ``angle`` and moved to ``center``: it opens towards
    (cos angle, sin angle). ``cut >= radius`` gives the full circle (marked as closed if both
    are known, not traced).

    Args:
        radius: R_g > 0 [length].
        cut: the arc ends on the line z_1 = cut, above -radius [length].
        n_detectors: number of detectors, at least 2.
        center: centre of the circle, (2,) [length].
        angle: direction in which the arc opens [rad].
        element_width: length of arc over which a detector takes the mean, a number or one for each
            detector; None for point detectors [length].

    Returns:
        CircularArc, detectors anticlockwise from one end of the opening to the other.

    Raises:
        ValueError: for fewer than 2 detectors, radius <= 0, an empty arc, or elements that are
            longer than it.

    Source: Kunyansky 2008, section 4 (geometries #1 and #2 have R_g = 1.3, cut at 1 and 0).

    >>> curve = circular_arc(1.3, 0.0, 500)
    >>> round(float(curve.weights.sum() / 1.3), 12)  # half a circle
    3.14159265359
    """
    n_detectors = whole_number("n_detectors", n_detectors, 0)
    require_detectors(n_detectors)
    radius, cut = real_array("radius", radius, ()), real_array("cut", cut, ())
    center, angle = real_array("center", center, (2,)), real_array("angle", angle, ())
    require_positive("radius", radius)
    closed = is_concrete(radius, cut) and float(cut) >= float(radius)
    if is_concrete(radius, cut) and float(cut) <= -float(radius):
        raise ValueError(
            f"the arc |z| = {float(radius)}, z_1 < {float(cut)} is empty: "
            "cut must be above -radius."
        )
    half_opening = opening_angle(cut / radius)
    arc = CircularArc(  # pyright: ignore[reportCallIssue] (abstract variables are no arguments)
        center, radius, angle, half_opening, n_detectors, closed
    )
    return with_elements(arc, element_width)


def with_elements(curve: C, width: Numbers | None) -> C:
    """The curve with elements of this width, which is checked; see `DetectorCurve`."""
    return replace(curve, element_width=checked_width(width, curve.weights))


def one_after_another(curves: Sequence[DetectorCurve]) -> SampledCurve:
    """Several curves joined to one, unchecked; normals point away from their common middle."""
    parts = [part for curve in curves for part in (curve.points, curve.weights, curve.normals)]
    return SampledCurve(*by_library(_in_a_row, parts), False, _widths_of_all(curves))


def _in_a_row(xp: Any, *parts: Any) -> tuple[Any, Any, Any]:
    points, weights, normals = parts[::3], parts[1::3], parts[2::3]
    every = xp.concatenate(points)
    middle = every.mean(axis=0)
    turned = [outward(*part, middle, xp) for part in zip(points, normals, strict=True)]
    return every, xp.concatenate(weights), xp.concatenate(turned)


def _widths_of_all(curves: Sequence[DetectorCurve]) -> Float[Array, " detectors"] | None:
    """Element widths of all curves, 0 for point detectors; None if there are no elements."""
    if all(curve.element_width is None for curve in curves):
        return None
    return jnp.concatenate(
        [
            jnp.broadcast_to(
                0.0 if curve.element_width is None else curve.element_width, curve.shape
            )
            for curve in curves
        ]
    )


def outward(points: Any, normals: Any, middle: Any, xp: Any = jnp) -> Any:
    """Normals of one side of a curve, turned away from the middle if they point there.

    Args:
        points, normals: (detectors, 2).
        middle: (2,).
        xp: numpy or jax.numpy.
    """
    away = (normals * (points - middle)).sum()
    return xp.where(away < 0, -1.0, 1.0) * normals  # of a straight array either is as good


def turned_views(curve: DetectorCurve, turns: Numbers) -> SampledCurve:
    """One array in several positions: detectors of view 1, 2, ..., each turned about the origin.

    An array that does not see enough from one position is turned about the object. The weights are
    divided by the number of views, so that places visited twice count once.

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

    weights, width = jnp.tile(curve.weights / n, n), curve.element_width
    if width is not None and width.ndim:
        width = jnp.tile(width, n)
    return SampledCurve(turned(curve.points), weights, turned(curve.normals), False, width)


def opening_angle(cosine: Array) -> Array:
    """arccos(cosine), and 0 with derivative 0 for a circle that is not cut, cosine >= 1."""
    return by_library(opening, (cosine,))


def opening(xp: Any, cosine: Any) -> Any:
    """`opening_angle` by numpy or jax.numpy."""
    cut = cosine < 1
    return xp.where(cut, xp.arccos(xp.where(cut, cosine, 0.0)), 0.0)


def require_detectors(n_detectors: int, least: int = 2) -> None:
    """Raise ValueError for too few detectors."""
    if n_detectors < least:
        raise ValueError(f"got {n_detectors} detector(s), expected at least {least} on a curve.")
