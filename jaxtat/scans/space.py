"""Scans in space: detectors around a volume, by their positions."""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..base.units import Units
from ..geometry import BallBody, DetectorPoints, SphericalCap, around_body, find_rings
from ..geometry.balls import Ball
from ..geometry.elements import SQUARE
from ..geometry.rings import fit_sphere
from ..io import Scan
from ..io.scan import OF_ELEMENTS
from .acquisition import facts_of, in_space, rows_used, times_of, units_of

FACING = np.cos(np.radians(1.0))  # of elements that are taken to face the middle
MOST_POINTS = 800  # detectors off rings, for the formula: its systems are dense


class FactsInSpace(NamedTuple):
    """Facts of a scan in space, as opposed to choices.

    Attributes:
        detectors: the cap, or points.
        order: rows of the data in the order of the detectors, flat.
        radius: of the sphere on which, or near which, they lie; off a body, to the nearest of them
            [length].
        upside_down: see `geometry.rings.FoundRings`.
        times: of a pressure record, (times,) [time].
        units: of lengths and times.
    """

    detectors: SphericalCap | DetectorPoints
    order: Int[np.ndarray, " used"]
    radius: float
    upside_down: bool
    times: Float[np.ndarray, " times"] | None
    units: Units

    @property
    def arrangement(self) -> str:
        """The arrangement of the detectors in words."""
        return self._places + self._sizes

    @property
    def _sizes(self) -> str:
        if self.detectors.element_radius is None:
            return ""
        widest = float(np.max(np.asarray(self.detectors.element_radius)))
        normals = getattr(self.detectors, "normals", None)
        facing = "" if normals is None else " that face where the file says"
        size = self.units.of_length(widest)
        return f", elements (in the file) as wide as disks of radius {size}{facing}"

    @property
    def _places(self) -> str:
        if isinstance(self.detectors, SphericalCap):
            rings, azimuths = self.detectors.shape
            way = "downwards" if self.upside_down else "upwards"
            return f"{rings} rings of {azimuths} on a sphere, open {way}"
        return "on no rings"


def facts_in_space(scan: Scan, use: object = None, about: Any = None) -> FactsInSpace:
    """Detectors on rings, if they are, and times.

    Args:
        scan: of which `facts.in_space` is true.
        use: rows of the data to use, all by default.
        about: a body's centre, see `facts_around`; by default their own.

    Raises:
        ValueError: for integrals of detectors that are neither on rings nor few, and as `rows_used`
            and `times_of`.
    """
    rows = rows_used(scan, use)
    points = np.asarray(scan.known["detectors"], float)[rows]
    times = times_of(scan)
    sizes = _element_radii(scan, rows)
    normals = _normals(scan, rows, points) if sizes is not None else None
    try:
        if normals is not None:
            raise ValueError("elements do not face the middle of their rings.")
        found = find_rings(points)
        order, upside_down = found.order.ravel(), found.upside_down
        detectors = replace(found.rings, element_radius=_of_all(sizes))
        radius = float(found.rings.radius)
    except ValueError as error:
        if len(points) > MOST_POINTS and times is None:
            raise ValueError(
                f"{error} Only up to {MOST_POINTS} detectors may lie anywhere, here are "
                f"{len(points)}: choose some with --use."
            ) from error
        center, radius = fit_sphere(points)
        detectors = DetectorPoints(points, None, center, element_radius=sizes, normals=normals)
        order = np.arange(len(points))
        upside_down = False
    units = units_of(radius, times)
    facts = FactsInSpace(detectors, rows[order], radius, upside_down, times, units)
    return facts_around(scan, facts, about)


def facts_around(scan: Scan, facts: FactsInSpace, center: Any) -> FactsInSpace:
    """The same about another centre, of a body, as scattered detectors where that is off their own.

    Args:
        center: three numbers [length]; None for their own.

    Raises:
        ValueError: for elements of a size, which face their own centre.
    """
    if center is None:
        return facts
    body = BallBody(center, 1.0, 1.0, 1.0)
    if around_body(facts.detectors, body) is facts.detectors:
        return facts
    points = np.asarray(scan.known["detectors"], float)[facts.order]  # rings may be turned over
    detectors = DetectorPoints(points, None, body.center)
    nearest = float(np.min(np.asarray(detectors.distance)))
    return facts._replace(detectors=detectors, radius=nearest, upside_down=False)


def units_of_scan(scan: Scan) -> Units:
    """Units of a scan's positions and times, in the plane or in space."""
    return (facts_in_space if in_space(scan) else facts_of)(scan).units


def require_few(detectors: SphericalCap | DetectorPoints) -> None:
    """Raise ValueError for more detectors off rings than the formula takes."""
    if isinstance(detectors, DetectorPoints) and detectors.shape[0] > MOST_POINTS:
        raise ValueError(
            f"the formula takes up to {MOST_POINTS} detectors off rings, here are "
            f"{detectors.shape[0]}: leave out --direct, --alpha, --low-pass and --inversion, and "
            "the volume is fitted, or choose some with --use (0:N takes all N, noisy ones too)."
        )


def _element_radii(scan: Scan, rows: np.ndarray) -> np.ndarray | None:
    """Radii of round elements, or of those that record what square ones do, as the file says."""
    known = {name: scan.known[name] for name in OF_ELEMENTS if name in scan.known}
    if not known:
        return None
    if len(known) > 1:
        raise ValueError("element_radius and element_size are both known: expected one of them.")
    ((name, size),) = known.items()
    radius = size * (1 if name == "element_radius" else SQUARE)
    return np.asarray(radius[rows] if np.ndim(radius) else radius)


def _normals(scan: Scan, rows: np.ndarray, points: np.ndarray) -> np.ndarray | None:
    """Of elements as the file says, None if all face the middle."""
    if "normals" not in scan.known:
        return None
    normals = np.asarray(scan.known["normals"], float)[rows]
    towards = points - fit_sphere(points)[0]
    cosine = np.abs(np.sum(normals * towards, axis=1))
    sizes = np.linalg.norm(normals, axis=1) * np.linalg.norm(towards, axis=1)
    return None if (cosine > FACING * sizes).all() and sizes.all() else normals


def _of_all(radii: np.ndarray | None) -> Array | None:
    """One radius of all elements of rings, or ValueError, by which they are taken as scattered."""
    if radii is None:
        return None
    if np.ptp(radii):
        raise ValueError("elements on rings have different sizes.")
    return jax.device_put(np.asarray(radii.flat[0]))


class TurnedOver(eqx.Module):
    """A region in the mirror of its central plane x_3 = c_3."""

    region: Ball

    def contains(self, points: Float[Array, "*n 3"]) -> Bool[Array, "*n"]:
        """Whether each point lies inside."""
        center = self.region.center
        return self.region.contains((points - center) * jnp.array([1.0, 1.0, -1.0]) + center)
