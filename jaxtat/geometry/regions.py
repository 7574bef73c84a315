"""Regions of interest: where the image is reconstructed, and their boundaries."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from ..base.checks import (
    Numbers,
    by_library,
    is_concrete,
    real_array,
    require_positive,
    whole_number,
)
from ..base.hashable_methods import ComparedByIdentity
from .curves import opening

DEFAULT_BOUNDARY = 512  # boundary points of a region that no setup has chosen them for
Counts = tuple[Any, ...]  # of boundary points on every piece; of a union, one tuple per region


class Region(ComparedByIdentity, eqx.Module):
    """A region of interest Omega, given by its boundary: ∫_dOmega u dl ≈ Σ_k w_k u(x_k).

    A new region needs these fields and the methods, and a line in io/plans.py to be saved.

    Attributes:
        points: collocation points x_k on the boundary, (boundary, 2) [length].
        weights: arc length w_k that belongs to each, (boundary,) [length].
        normals: outward unit normals, (boundary, 2).
        center: a point in the middle, (2,); phases of plane waves are counted from it [length].
        counts: how many of the points lie on each piece of the boundary.
        automatic: whether a `Setup` may choose other counts, as its highest frequency asks.
    """

    points: eqx.AbstractVar[Float[Array, "boundary 2"]]
    weights: eqx.AbstractVar[Float[Array, " boundary"]]
    normals: eqx.AbstractVar[Float[Array, "boundary 2"]]
    center: eqx.AbstractVar[Float[Array, "2"]]
    counts: eqx.AbstractVar[Counts]
    automatic: eqx.AbstractVar[bool]

    @property
    @abstractmethod
    def reach(self) -> Float[Array, ""]:
        """Radius of a disk about ``center`` that holds the region [length]."""

    @property
    def components(self) -> tuple["Region", ...]:
        """Its connected parts: a line meets the region if it meets one of them."""
        return (self,)

    @property
    def n_boundary(self) -> int:
        """Number of boundary points."""
        return self.points.shape[0]

    @abstractmethod
    def with_counts(self, counts: Counts) -> "Region":
        """The same region with other numbers of boundary points; it may be traced."""

    @abstractmethod
    def shared_out(self, n_boundary: int) -> Counts:
        """About n boundary points, shared out by length; concrete."""

    @abstractmethod
    def level(self, points: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
        """Below zero inside, zero on the boundary, above zero outside [length]."""

    def contains(self, points: Float[Array, "*n 2"]) -> Bool[Array, "*n"]:
        """Whether each point lies inside (the boundary does not)."""
        return by_library(lambda xp, level: level < 0, (self.level(points),))


class Disk(Region):
    """|x| < R, x_1 < cut, turned by ``angle`` and moved to ``center``."""

    points: Float[Array, "boundary 2"]
    weights: Float[Array, " boundary"]
    normals: Float[Array, "boundary 2"]
    center: Float[Array, "2"]
    counts: tuple[int, int] = eqx.field(static=True)  # on the arc and on the chord
    automatic: bool = eqx.field(static=True)
    radius: Float[Array, ""]
    cut: Float[Array, ""]
    angle: Float[Array, ""]

    @property
    def whole(self) -> bool:
        """Whether it is not cut at all."""
        return self.counts[1] == 0

    @property
    def reach(self) -> Float[Array, ""]:
        return self.radius

    def with_counts(self, counts: Counts) -> "Disk":
        return _disk(self.radius, self.cut, self.center, self.angle, counts, self.automatic)

    def shared_out(self, n_boundary: int) -> tuple[int, int]:
        if self.whole:
            return n_boundary, 0
        n_chord = _chord_share(self.cut, self.radius, n_boundary)
        return 2 * -(-(n_boundary - n_chord) // 2), n_chord  # none on the axis of symmetry

    def level(self, points: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
        where = points, self.radius, self.cut, self.center, self.angle
        return by_library(_level, where, self.whole)


def _level(
    xp: Any, points: Any, radius: Any, cut: Any, center: Any, angle: Any, whole: bool
) -> Any:
    local = points - center
    distance = xp.sqrt(xp.sum(local**2, axis=-1))
    if whole:
        return distance - radius
    along = local[..., 0] * xp.cos(angle) + local[..., 1] * xp.sin(angle)
    return xp.maximum(distance - radius, along - cut)


def disk(
    radius: Numbers,
    cut: Numbers | None = None,
    *,
    center: Numbers = (0.0, 0.0),
    angle: Numbers = 0.0,
    n_boundary: int | None = None,
) -> Disk:
    """The disk |x| < R, or its part x_1 < cut, turned by ``angle`` and moved to ``center``.

    Boundary points are the midpoints of equal pieces, on the arc and on the chord x_1 = cut each.

    Args:
        radius: R > 0 [length].
        cut: position of the chord, above -radius [length]. None, or a cut at or beyond the radius
            (both known, not traced), leaves the whole disk.
        center: of the disk, (2,) [length].
        angle: direction of the chord's outward normal [rad]; use the arc's own ``angle``.
        n_boundary: number of boundary points; by default `Setup` chooses it by the frequencies.

    Raises:
        ValueError: for fewer than 8 points, radius <= 0 or an empty region.

    Source: Kunyansky 2008, section 4 (Omega(R, x_right): R = 1, cut at 1 and 0).

    >>> import jax.numpy as jnp
    >>> region = disk(1.0, 0.0)
    >>> float(abs(region.weights.sum() - (jnp.pi + 2))) < 1e-12
    True
    >>> region.contains(jnp.array([[-0.5, 0.0], [0.5, 0.0]])).tolist()
    [True, False]
    """
    radius = real_array("radius", radius, ())
    center, angle = real_array("center", center, (2,)), real_array("angle", angle, ())
    require_positive("radius", radius)
    automatic = n_boundary is None
    n = DEFAULT_BOUNDARY if n_boundary is None else whole_number("n_boundary", n_boundary, 8)
    n_chord = 0
    chord = radius if cut is None else real_array("cut", cut, ())
    if cut is not None:
        if is_concrete(radius, chord) and float(chord) <= -float(radius):
            raise ValueError(
                f"the region |x| < {float(radius)}, x_1 < {float(chord)} is empty: "
                "cut must be above -radius."
            )
        n_chord = _chord_share(chord, radius, n)
    return _disk(radius, chord, center, angle, (n - n_chord, n_chord), automatic)


def _disk(
    radius: Array, cut: Array, center: Array, angle: Array, counts: Counts, automatic: bool
) -> Disk:
    n_arc, n_chord = counts
    numbers = radius, cut, center, angle
    points, weights, normals = by_library(_boundary, numbers, n_arc, n_chord)
    return Disk(points, weights, normals, center, (n_arc, n_chord), automatic, radius, cut, angle)


def _boundary(
    xp: Any,
    radius: Any,
    cut: Any,
    center: Any,
    angle: Any,
    n_arc: int,
    n_chord: int,
) -> tuple[Any, Any, Any]:
    """Points, weights and normals."""
    half_opening = opening(xp, cut / radius) if n_chord else 0.0
    arc = _arc_boundary(xp, radius, half_opening, n_arc)
    chord = _chord_boundary(xp, radius, half_opening, cut, n_chord)
    points, normals, weights = (xp.concatenate(pair) for pair in zip(arc, chord, strict=True))
    c, s = xp.cos(angle), xp.sin(angle)
    turn = xp.stack([xp.stack([c, -s]), xp.stack([s, c])])
    return points @ turn.T + center, weights, normals @ turn.T


def require_outside(points: Float[Array, "detectors 2"], region: Region) -> None:
    """Raise ValueError if a detector lies inside or on the region of interest."""
    if not is_concrete(points, region):
        return
    inside = np.asarray(region.level(points)) <= 1e-6 * float(region.reach)
    if inside.any():
        first, reach = int(np.argmax(inside)), float(region.reach)
        where = _in_words(points[first], reach), _in_words(region.center, reach)
        raise ValueError(
            f"{int(inside.sum())} of {inside.size} detectors lie inside or on the region of "
            f"interest, the first is number {first} at {where[0]}; the region reaches {reach:.6g} "
            f"from {where[1]}. Shrink or move the region, and check that both use the same unit of "
            "length."
        )


def _in_words(point: Any, reach: float) -> str:
    """A point, without what is rounding beside the region's reach."""
    values = np.where(np.abs(point) < 1e-9 * reach, 0.0, point)
    return f"({', '.join(f'{x:.6g}' for x in values)})"


def _chord_share(cut: Array, radius: Array, n_boundary: int) -> int:
    """How many of the boundary points lie on the chord; a third where the geometry is traced."""
    if not is_concrete(cut, radius):
        return 2 * (n_boundary // 6)
    ratio = min(float(cut) / float(radius), 1.0)
    chord, arc = 2 * np.sqrt(1 - ratio**2), 2 * (np.pi - np.arccos(ratio))
    # an even share keeps arc and chord mirror symmetric without a point on the axis
    return 2 * round(n_boundary * chord / (chord + arc) / 2)


def _arc_boundary(xp: Any, radius: Any, half_opening: Any, n: int) -> tuple[Any, Any, Any]:
    span = 2 * np.pi - 2 * half_opening
    theta = half_opening + (xp.arange(n) + 0.5) * span / n
    normals = xp.stack([xp.cos(theta), xp.sin(theta)], axis=-1)
    return radius * normals, normals, xp.broadcast_to(radius * span / n, (n,))


def _chord_boundary(
    xp: Any, radius: Any, half_opening: Any, cut: Any, n: int
) -> tuple[Any, Any, Any]:
    half = radius * xp.sin(half_opening)
    x2 = half * ((2 * xp.arange(n) + 1) / max(n, 1) - 1)
    points = xp.stack([xp.broadcast_to(cut, (n,)), x2], axis=-1)
    normals = xp.broadcast_to(np.array([1.0, 0.0]), (n, 2))
    return points, normals, xp.broadcast_to(2 * half / max(n, 1), (n,))
