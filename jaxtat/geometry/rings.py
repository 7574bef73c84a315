"""Rings recognised from measured positions of detectors in space."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ..base.checks import Numbers, by_library, real_array
from .caps import SphericalCap
from .curves import SampledCurve

SAME = 2e-3  # of the radius: how far detectors may lie off the sphere and their ring
UNEVEN = 0.02  # of the step between neighbours on a ring, likewise


class DetectorRings(SphericalCap):
    """A cap with rings at given heights, each turned by a given angle.

    A ring's area reaches half-way to its neighbours, and as far beyond the highest and the lowest
    one; below the lowest one to the pole, if that is not farther than the next ring.

    Attributes:
        polar_angles: theta of the rings from the axis x_3, decreasing, (rings,) [rad].
        turns: azimuth of each ring's first detector, (rings,) [rad].
    """

    polar_angles: Float[Array, " rings"]
    turns: Float[Array, " rings"]

    @property
    def first_azimuths(self) -> Float[Array, " rings"]:
        return self.turns

    @property
    def lowest_angle(self) -> Float[Array, ""]:
        return by_library(_bounds, (self.polar_angles, self.half_opening))[0]

    @property
    def meridian(self) -> SampledCurve:
        """All rings, on both sides of the axis; a hole between rings is a gap of this curve."""
        shape_of_rings = self.polar_angles, self.half_opening, self.radius
        return SampledCurve(*by_library(_meridian, shape_of_rings), self.closed)

    def _rings(self) -> tuple[Array, Array]:
        return by_library(_cosines_and_areas, (self.polar_angles, self.half_opening))


def _bounds(xp: Any, theta: Any, half_opening: Any) -> Any:
    """theta between which the areas of the rings lie, one more than rings."""
    beyond = 2 * theta[0] - theta[min(1, len(theta) - 1)]
    lowest = xp.where(beyond < np.pi, (theta[0] + beyond) / 2, np.pi)
    between = (theta[1:] + theta[:-1]) / 2
    return xp.concatenate([lowest[None], between, half_opening[None]])


def _cosines_and_areas(xp: Any, theta: Any, half_opening: Any) -> tuple[Any, Any]:
    return xp.cos(theta), xp.diff(xp.cos(_bounds(xp, theta, half_opening)))


def _meridian(xp: Any, polar_angles: Any, half_opening: Any, radius: Any) -> tuple[Any, Any, Any]:
    theta = xp.concatenate([xp.flip(polar_angles), -polar_angles])
    normals = xp.stack([xp.cos(theta), xp.sin(theta)], axis=1)
    arcs = -radius * xp.diff(_bounds(xp, polar_angles, half_opening))
    return radius * normals, xp.concatenate([xp.flip(arcs), arcs]), normals


class FoundRings(NamedTuple):
    """Detectors on rings, as `find_rings` recognises them.

    Attributes:
        rings: the cap, which opens upwards.
        order: rows of the positions, (rings, azimuths).
        upside_down: whether the positions open downwards; x_3 - c_3 has changed its sign then.
    """

    rings: DetectorRings
    order: Int[np.ndarray, "rings azimuths"]
    upside_down: bool


def find_rings(positions: Numbers) -> FoundRings:
    """Rings about an axis along x_3 on a sphere, whose centre and radius are fitted.

    Positions are moved onto the rings that fit them. Detectors may lie up to 0.2 % of the radius
    off the sphere, a ring ends where the polar angle leaps by more than 0.002 rad, and azimuths may
    differ by up to 2 % of the step between neighbours from equal ones. `DetectorPoints` keep the
    measured positions.

    Args:
        positions: concrete, (detectors, 3), in any order [length].

    Raises:
        ValueError: if the detectors do not lie on a sphere, or not on rings of equally many,
            equispaced in azimuth.

    >>> from jaxtat.geometry import spherical_cap
    >>> points = spherical_cap(1.3, 0.5, 6, 8, center=(0.0, 0.1, 0.2)).points.reshape(-1, 3)
    >>> detectors = find_rings(points[::-1])
    >>> detectors.rings.shape, round(float(detectors.rings.radius), 9), detectors.upside_down
    ((6, 8), 1.3, False)
    """
    points = np.asarray(real_array("positions", positions, ("detectors", 3)))
    center, radius = fit_sphere(points)
    unit = (points - center) / radius
    off = float(np.abs(np.linalg.norm(unit, axis=1) - 1).max())
    if off > SAME:
        raise ValueError(
            f"the detectors do not lie on a sphere: up to {off:.2g} of its radius beside it."
        )
    upside_down = bool(unit[:, 2].mean() > 1e-6)
    theta = np.arctan2(np.hypot(unit[:, 0], unit[:, 1]), unit[:, 2] * (-1 if upside_down else 1))
    azimuth = np.mod(np.arctan2(unit[:, 1], unit[:, 0]) + 1e-9, 2 * np.pi) - 1e-9  # -0 is 0
    order = _by_rings(theta, azimuth)
    n_rings, n = order.shape
    steps = 2 * np.pi / n * np.arange(n)
    # about the first of them, so that no angle jumps by a whole turn
    offsets = azimuth[order] - azimuth[order[:, :1]] - steps
    offsets -= 2 * np.pi * np.round(offsets / (2 * np.pi))
    uneven = float(np.ptp(offsets, axis=1).max()) * n / (2 * np.pi)
    if uneven > UNEVEN:
        raise ValueError(
            f"detectors on a ring are not equispaced about the axis x_3: off by {uneven:.2g} of "
            "their distance."
        )
    polar = theta[order].mean(axis=1)
    step = polar[-2] - polar[-1]
    half_opening = polar[-1] - step / 2 if polar[-1] > step else 0.0
    values = center, radius, half_opening, polar, azimuth[order[:, 0]] + offsets.mean(axis=1)
    center, radius, half_opening, polar, turns = (
        jax.device_put(np.asarray(v, float)) for v in values
    )
    rings = DetectorRings(  # pyright: ignore[reportCallIssue] (abstract variables are no arguments)
        center, radius, half_opening, n_rings, n, "given", polar, turns
    )
    return FoundRings(rings, order, upside_down)


def fit_sphere(points: Float[np.ndarray, "detectors 3"]) -> tuple[np.ndarray, float]:
    """Centre and radius by least squares of |p|² = 2 p·c + R² - |c|².

    >>> center, radius = fit_sphere(np.array([[3, 2, 3], [-1, 2, 3], [1, 4, 3], [1, 2, 5.0]]))
    >>> center.round(9).tolist(), round(radius, 9)
    ([1.0, 2.0, 3.0], 2.0)
    """
    middle = points.mean(axis=0)
    local = points - middle
    design = np.column_stack([2 * local, np.ones(len(local))])
    solution, _, rank, _ = np.linalg.lstsq(design, np.sum(local**2, axis=1), rcond=1e-9)
    if rank < 4:
        raise ValueError("the detectors lie in a plane: no sphere is known by them.")
    return middle + solution[:3], float(np.sqrt(solution[3] + solution[:3] @ solution[:3]))


def _by_rings(
    theta: Float[np.ndarray, " detectors"], azimuth: Float[np.ndarray, " detectors"]
) -> Int[np.ndarray, "rings azimuths"]:
    """Rows sorted by ring, from the lowest one, and azimuth."""
    down = np.argsort(-theta)
    first = np.flatnonzero(np.concatenate([[True], -np.diff(theta[down]) > SAME]))
    sizes = np.diff(np.append(first, len(down)))
    n = int(sizes[0])
    if len(sizes) < 2 or n < 4 or n % 2 or (sizes != n).any():
        raise ValueError(
            f"the detectors are on {len(sizes)} rings about the axis x_3 with {sizes.min()} to "
            f"{sizes.max()} of them: expected two rings or more, all with the same even number."
        )
    rings = down.reshape(-1, n)
    return np.take_along_axis(rings, np.argsort(azimuth[rings], axis=1), axis=1)
