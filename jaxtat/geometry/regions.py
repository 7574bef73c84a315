"""Regions of interest: where the image is reconstructed, and their boundaries."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from ..checks import Numbers, by_library, is_concrete, real_array, require_positive, whole_number
from .curves import DetectorCurve, opening


class Region(eqx.Module):
    """A region of interest Omega, known by its boundary: ∫_dOmega u dl ≈ Σ_k w_k u(x_k).

    A new region needs these fields and the two methods, and a line in io/plans.py to be saved;
    nothing else in the library asks more.

    Attributes:
        points: collocation points x_k on the boundary, (boundary, 2) [length].
        weights: arc length w_k that belongs to each, (boundary,) [length].
        normals: outward unit normals, (boundary, 2).
        center: a point in the middle, (2,); phases of plane waves are counted from it [length].
    """

    points: eqx.AbstractVar[Float[Array, "boundary 2"]]
    weights: eqx.AbstractVar[Float[Array, " boundary"]]
    normals: eqx.AbstractVar[Float[Array, "boundary 2"]]
    center: eqx.AbstractVar[Float[Array, "2"]]

    @property
    @abstractmethod
    def reach(self) -> Float[Array, ""]:
        """Radius of a disk about ``center`` that holds the region [length]."""

    @property
    def components(self) -> tuple["Region", ...]:
        """Its connected parts: a line meets the region if it meets one of them."""
        return (self,)

    @abstractmethod
    def level(self, points: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
        """Below zero inside, zero on the boundary, above zero outside [length]."""

    def contains(self, points: Float[Array, "*n 2"]) -> Bool[Array, "*n"]:
        """Whether each point lies inside (the boundary does not)."""
        return by_library(lambda xp, level: level < 0, (self.level(points),))


class TruncatedDisk(Region):
    """|x| < R, x_1 < x_right, turned by ``angle`` and moved to ``center``."""

    points: Float[Array, "boundary 2"]
    weights: Float[Array, " boundary"]
    normals: Float[Array, "boundary 2"]
    center: Float[Array, "2"]
    radius: Float[Array, ""]
    x_right: Float[Array, ""]
    angle: Float[Array, ""]
    whole: bool = eqx.field(static=True)  # not cut at all

    @property
    def reach(self) -> Float[Array, ""]:
        return self.radius

    def level(self, points: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
        return by_library(_level, (points, self.radius, self.x_right, self.center, self.angle))


def _level(xp: Any, points: Any, radius: Any, x_right: Any, center: Any, angle: Any) -> Any:
    local = points - center
    along = local[..., 0] * xp.cos(angle) + local[..., 1] * xp.sin(angle)
    return xp.maximum(xp.sqrt(xp.sum(local**2, axis=-1)) - radius, along - x_right)


def truncated_disk(
    radius: Numbers,
    x_right: Numbers,
    n_collocation: int,
    *,
    center: Numbers = (0.0, 0.0),
    angle: Numbers = 0.0,
    n_chord: int | None = None,
) -> TruncatedDisk:
    """The region |x| < R, x_1 < x_right, then turned by ``angle`` and moved to ``center``.

    Boundary points are the midpoints of equal pieces, on the arc and on the chord x_1 = x_right
    each. ``x_right >= radius`` gives the disk.

    Args:
        radius: R > 0 [length].
        x_right: position of the chord, above -radius [length].
        n_collocation: number of boundary points; about twice the number of detectors is right.
        center: centre of the disk, (2,) [length].
        angle: direction of the chord's outward normal [rad]; use the arc's own ``angle``.
        n_chord: how many of the points lie on the chord; by default in proportion to its length.
            Must be given when radius or x_right is traced (0: a disk).

    Raises:
        ValueError: for fewer than 8 points, radius <= 0 or an empty region.

    Source: Kunyansky 2008, section 4 (Omega(R, x_right), R = 1, x_right = 1 and 0).

    >>> import jax.numpy as jnp
    >>> region = truncated_disk(1.0, 0.0, 1000)
    >>> float(abs(region.weights.sum() - (jnp.pi + 2))) < 1e-12
    True
    >>> region.contains(jnp.array([[-0.5, 0.0], [0.5, 0.0]])).tolist()
    [True, False]
    """
    radius, x_right = real_array("radius", radius, ()), real_array("x_right", x_right, ())
    center, angle = real_array("center", center, (2,)), real_array("angle", angle, ())
    require_positive("radius", radius)
    n_collocation = whole_number("n_collocation", n_collocation, 8)
    if is_concrete(radius, x_right):
        cosine = float(x_right) / float(radius)
        if cosine <= -1:
            raise ValueError(
                f"the region |x| < {float(radius)}, x_1 < {float(x_right)} is empty: "
                "x_right must be above -radius."
            )
        n_chord = _chord_share(cosine, n_collocation) if n_chord is None else n_chord
    if n_chord is None:
        raise ValueError("n_chord must be given when radius or x_right is traced.")
    if not 0 <= n_chord < n_collocation:
        raise ValueError(f"n_chord is {n_chord}, expected 0 to {n_collocation - 1} of the points.")
    numbers, counts = (radius, x_right, center, angle), (n_collocation - n_chord, n_chord)
    points, weights, normals = by_library(_boundary, numbers, *counts)
    return TruncatedDisk(
        points=points,
        weights=weights,
        normals=normals,
        center=center,
        radius=radius,
        x_right=x_right,
        angle=angle,
        whole=n_chord == 0,
    )


def _boundary(
    xp: Any,
    radius: Any,
    x_right: Any,
    center: Any,
    angle: Any,
    n_arc: int,
    n_chord: int,
) -> tuple[Any, Any, Any]:
    """Points, weights and normals."""
    half_opening = opening(xp, x_right / radius) if n_chord else 0.0
    arc = _arc_boundary(xp, radius, half_opening, n_arc)
    chord = _chord_boundary(xp, radius, half_opening, x_right, n_chord)
    points, normals, weights = (xp.concatenate(pair) for pair in zip(arc, chord, strict=True))
    c, s = xp.cos(angle), xp.sin(angle)
    turn = xp.stack([xp.stack([c, -s]), xp.stack([s, c])])
    return points @ turn.T + center, weights, normals @ turn.T


def require_outside(curve: DetectorCurve, region: Region) -> None:
    """Raise ValueError if a detector lies inside or on the region of interest."""
    if not is_concrete(curve, region):
        return
    inside = np.asarray(region.level(curve.points)) <= 1e-6 * float(region.reach)
    if inside.any():
        first = int(np.argmax(inside))
        raise ValueError(
            f"{int(inside.sum())} of {inside.size} detectors lie inside or on the region of "
            f"interest, the first is number {first} at {np.asarray(curve.points[first])}; the "
            f"region reaches {float(region.reach):.6g} from {np.asarray(region.center)}. Shrink "
            "or move the region, and check that both use the same unit of length."
        )


def _chord_share(cosine: float, n_collocation: int) -> int:
    ratio = min(cosine, 1.0)
    chord, arc = 2 * np.sqrt(1 - ratio**2), 2 * (np.pi - np.arccos(ratio))
    # an even share keeps arc and chord mirror symmetric without a point on the axis
    return 2 * round(n_collocation * chord / (chord + arc) / 2)


def _arc_boundary(xp: Any, radius: Any, half_opening: Any, n: int) -> tuple[Any, Any, Any]:
    span = 2 * np.pi - 2 * half_opening
    theta = half_opening + (xp.arange(n) + 0.5) * span / n
    normals = xp.stack([xp.cos(theta), xp.sin(theta)], axis=-1)
    return radius * normals, normals, xp.broadcast_to(radius * span / n, (n,))


def _chord_boundary(
    xp: Any, radius: Any, half_opening: Any, x_right: Any, n: int
) -> tuple[Any, Any, Any]:
    half = radius * xp.sin(half_opening)
    x2 = half * ((2 * xp.arange(n) + 1) / max(n, 1) - 1)
    points = xp.stack([xp.broadcast_to(x_right, (n,)), x2], axis=-1)
    normals = xp.broadcast_to(np.array([1.0, 0.0]), (n, 2))
    return points, normals, xp.broadcast_to(2 * half / max(n, 1), (n,))
