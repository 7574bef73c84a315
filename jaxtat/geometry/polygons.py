"""Regions of interest with straight sides, and regions of several components."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, by_library, is_concrete, real_array, require_positive
from ..base.hashable_methods import compiled
from ..special import root
from .crossing import first_crossing
from .regions import DEFAULT_BOUNDARY, Counts, Region
from .shapes import pieces_of_line, require_several, shared_out

_LEAST = 4  # boundary points on a side


class Polygon(Region):
    """The inside of a polygon without holes, convex or not."""

    points: Float[Array, "boundary 2"]
    weights: Float[Array, " boundary"]
    normals: Float[Array, "boundary 2"]
    center: Float[Array, "2"]
    counts: tuple[int, ...] = eqx.field(static=True)  # on each side
    automatic: bool = eqx.field(static=True)
    vertices: Float[Array, "vertices 2"]

    def with_counts(self, counts: Counts) -> "Polygon":
        return _polygon(self.vertices, counts, self.automatic)

    def shared_out(self, n_boundary: int) -> tuple[int, ...]:
        known = np.asarray(self.vertices)
        length = np.hypot(*(np.roll(known, -1, axis=0) - known).T)
        shares = np.ceil(n_boundary * length / length.sum())
        return tuple(int(k) for k in np.maximum(shares, _LEAST))

    @property
    def reach(self) -> Float[Array, ""]:
        return by_library(_farthest, (self.vertices, 0.0, self.center))

    @compiled
    def level(self, points: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
        def of_side(total: tuple[Array, Array], side: tuple[Array, Array]):
            nearest, inside = total
            start, end = side
            along, local = end - start, points - start
            share = jnp.clip(local @ along / (along @ along), 0.0, 1.0)
            square = jnp.sum((local - share[..., None] * along) ** 2, axis=-1)
            # a ray to the right passes the side: inside if it passes an odd number of them
            # (sides that meet compare with the very same vertex: rounding would let one slip)
            passes = (points[..., 1] >= start[1]) != (points[..., 1] >= end[1])
            left = along[0] * local[..., 1] - along[1] * local[..., 0]
            crosses = passes & ((left > 0) == (along[1] > 0))
            return (jnp.minimum(nearest, square), inside ^ crosses), None

        shape = points.shape[:-1]
        start = jnp.full(shape, jnp.inf), jnp.zeros(shape, bool)
        sides = self.vertices, jnp.roll(self.vertices, -1, axis=0)
        (square, inside), _ = jax.lax.scan(of_side, start, sides)
        return jnp.where(inside, -root(square), root(square))


class RegionUnion(Region):
    """Several regions apart from each other, reconstructed at once."""

    points: Float[Array, "boundary 2"]
    weights: Float[Array, " boundary"]
    normals: Float[Array, "boundary 2"]
    center: Float[Array, "2"]
    counts: tuple[Counts, ...] = eqx.field(static=True)  # of each region
    automatic: bool = eqx.field(static=True)
    regions: tuple[Region, ...]

    def with_counts(self, counts: Counts) -> "RegionUnion":
        parts = zip(self.regions, counts, strict=True)
        return _union([region.with_counts(part) for region, part in parts])

    def shared_out(self, n_boundary: int) -> tuple[Counts, ...]:
        lengths = [float(region.weights.sum()) for region in self.regions]
        shares = [int(np.ceil(n_boundary * length / sum(lengths))) for length in lengths]
        return tuple(
            region.shared_out(max(share, 8))
            for region, share in zip(self.regions, shares, strict=True)
        )

    @property
    def reach(self) -> Float[Array, ""]:
        # boundary points are midpoints of pieces, which reach half a piece farther
        return by_library(_farthest, (self.points, self.weights, self.center))

    @property
    def components(self) -> tuple[Region, ...]:
        return tuple(part for region in self.regions for part in region.components)

    def level(self, points: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
        return jnp.stack([region.level(points) for region in self.regions]).min(axis=0)


def polygon(vertices: Numbers, *, n_boundary: int | Sequence[int] | None = None) -> Polygon:
    """The region inside a polygon.

    Boundary points are the midpoints of equal pieces of each side; the centre is that of the box
    around the vertices.

    Args:
        vertices: at least 3, in order round the boundary, either way, (vertices, 2) [length].
        n_boundary: number of boundary points, shared out by length, or one number for each side;
            by default `Setup` chooses them by the frequencies.

    Raises:
        ValueError: for fewer than 3 vertices, repeated ones, sides that cross or cover each other,
            no area, or fewer than 4 points on a side.

    >>> triangle = polygon([(-0.65, -0.65), (0.75, -0.65), (-0.65, 0.75)])
    >>> triangle.contains(jnp.array([[-0.3, -0.3], [0.3, 0.3]])).tolist()
    [True, False]
    """
    vertices = real_array("vertices", vertices, ("vertices", 2))
    if vertices.shape[0] < 3:
        raise ValueError(f"got {vertices.shape[0]} vertices, expected at least 3 of a polygon.")
    automatic = n_boundary is None
    if n_boundary is None:  # as many on each side where lengths are traced
        sides = vertices.shape[0]
        n_boundary = max(DEFAULT_BOUNDARY, 4 * _LEAST * sides)
        if not is_concrete(vertices):
            n_boundary = (n_boundary // sides,) * sides
    counts = shared_out("n_boundary", n_boundary, vertices, True, least=1 if automatic else _LEAST)
    if is_concrete(vertices):
        known = np.asarray(vertices)
        crossing = first_crossing(known, np.roll(known, -1, axis=0))
        if crossing is not None:
            raise ValueError(
                f"sides {crossing[0]} and {crossing[1]} of the polygon cross or cover each other: "
                "give the vertices in order round the boundary."
            )
        if abs(_twice_the_area(known, np)) <= 1e-9 * np.ptp(known, axis=0).max() ** 2:
            raise ValueError("the polygon has no area: its vertices lie on a line.")
    counts = tuple(max(k, _LEAST) for k in counts)
    return _polygon(vertices, counts, automatic)


def _polygon(vertices: Array, counts: Counts, automatic: bool) -> Polygon:
    return Polygon(*by_library(_boundary, (vertices,), counts), counts, automatic, vertices)


def _boundary(xp: Any, vertices: Any, counts: tuple[int, ...]) -> tuple[Any, Any, Any, Any]:
    """Points, weights, outward normals and the middle."""
    points, weights, normals = pieces_of_line(vertices, counts, xp)
    side = xp.sign(_twice_the_area(vertices, xp))
    return points, weights, side * normals, _middle(vertices)


def _farthest(xp: Any, points: Any, lengths: Any, center: Any) -> Any:
    """The largest distance from the centre of points, the middles of pieces of these lengths."""
    return (xp.sqrt(xp.sum((points - center) ** 2, axis=1)) + lengths / 2).max()


def _middle(points: Any) -> Any:
    """Centre of the box around points."""
    return (points.max(axis=0) + points.min(axis=0)) / 2


def _twice_the_area(vertices: Any, xp: Any) -> Any:
    """Positive if the vertices go round anticlockwise."""
    x, y = vertices.T
    return xp.sum(x * xp.roll(y, -1) - y * xp.roll(x, -1))


def rectangle(
    half_widths: Numbers,
    *,
    n_boundary: int | Sequence[int] | None = None,
    center: Numbers = (0.0, 0.0),
    angle: Numbers = 0.0,
) -> Polygon:
    """The region |x_1| < a, |x_2| < b, turned by ``angle`` and moved to ``center``.

    Args:
        half_widths: (a, b), above zero [length].
        n_boundary: as in `polygon`, sides beginning with the lower one, anticlockwise.
        center: (2,) [length].
        angle: [rad].

    >>> round(float(rectangle((0.8, 0.6)).weights.sum()), 9)
    5.6
    """
    half = real_array("half_widths", half_widths, (2,))
    center, angle = real_array("center", center, (2,)), real_array("angle", angle, ())
    require_positive("half_widths", half)
    c, s = jnp.cos(angle), jnp.sin(angle)
    corners = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return polygon(
        corners @ jnp.stack([jnp.stack([c, s]), jnp.stack([-s, c])]) + center,
        n_boundary=n_boundary,
    )


def union_of_regions(*regions: Region) -> RegionUnion:
    """Several regions, which must not overlap, as one region of several components.

    Args:
        regions: at least one.

    Raises:
        ValueError: for no regions at all, and for two that overlap.

    >>> left, right = (rectangle((0.2, 0.5), center=(x, 0.0)) for x in (-0.7, 0.7))
    >>> both = union_of_regions(left, right)
    >>> both.contains(jnp.array([[-0.7, 0.0], [0.0, 0.0]])).tolist(), float(both.center[0])
    ([True, False], 0.0)
    """
    require_several("region", Region, regions)
    if is_concrete(*regions):
        for i, one in enumerate(regions):
            for j, other in enumerate(regions):
                if i != j and bool(np.asarray(one.contains(other.points)).any()):
                    raise ValueError(
                        f"regions {min(i, j)} and {max(i, j)} overlap: expected regions apart from "
                        "each other; make one polygon of them."
                    )
    return _union(list(regions))


def _joined(xp: Any, *parts: tuple[Any, ...]) -> tuple[Any, Any, Any, Any]:
    """Points, weights and normals of all, and the middle."""
    points, weights, normals = map(xp.concatenate, parts)
    return points, weights, normals, _middle(points)


def _union(regions: list[Region]) -> RegionUnion:
    parts = [(region.points, region.weights, region.normals) for region in regions]
    return RegionUnion(
        *by_library(_joined, tuple(zip(*parts, strict=True))),
        tuple(region.counts for region in regions),
        all(region.automatic for region in regions),
        tuple(regions),
    )
