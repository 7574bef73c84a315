"""Scans in space: detectors around a volume, by their positions."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..base.units import Units
from ..geometry import DetectorPoints, SphericalCap, find_rings
from ..geometry.balls import Ball
from ..geometry.rings import fit_sphere
from ..io import Scan
from .acquisition import rows_used, times_of, units_of

MOST_POINTS = 800  # detectors off rings, for the formula: its systems are dense


class FactsInSpace(NamedTuple):
    """Facts of a scan in space, as opposed to choices.

    Attributes:
        detectors: the cap, or points.
        order: rows of the data in the order of the detectors, flat.
        radius: of the sphere on which, or near which, they lie [length].
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
        if isinstance(self.detectors, SphericalCap):
            rings, azimuths = self.detectors.shape
            way = "downwards" if self.upside_down else "upwards"
            return f"{rings} rings of {azimuths} on a sphere, open {way}"
        return "on no rings"


def facts_in_space(scan: Scan, use: object = None) -> FactsInSpace:
    """Detectors on rings, if they are, and times.

    Args:
        scan: of which `facts.in_space` is true.
        use: rows of the data to use, all by default.

    Raises:
        ValueError: for integrals of detectors that are neither on rings nor few, and as `rows_used`
            and `times_of`.
    """
    rows = rows_used(scan, use)
    points = np.asarray(scan.known["detectors"], float)[rows]
    times = times_of(scan)
    try:
        found = find_rings(points)
        detectors, order, upside_down = found.rings, found.order.ravel(), found.upside_down
        radius = float(found.rings.radius)
    except ValueError as error:
        if len(points) > MOST_POINTS and times is None:
            raise ValueError(
                f"{error} Only up to {MOST_POINTS} detectors may lie anywhere, here are "
                f"{len(points)}: choose some with --use."
            ) from error
        center, radius = fit_sphere(points)
        detectors, order = DetectorPoints(points, None, center), np.arange(len(points))
        upside_down = False
    return FactsInSpace(detectors, rows[order], radius, upside_down, times, units_of(radius, times))


def require_few(detectors: SphericalCap | DetectorPoints) -> None:
    """Raise ValueError for more detectors off rings than the formula takes."""
    if isinstance(detectors, DetectorPoints) and detectors.shape[0] > MOST_POINTS:
        raise ValueError(
            f"the formula takes up to {MOST_POINTS} detectors off rings, here are "
            f"{detectors.shape[0]}: leave out --direct, --alpha, --low-pass and --inversion, and "
            "the volume is fitted, or choose some with --use."
        )


class TurnedOver(eqx.Module):
    """A region in the mirror of its central plane x_3 = c_3."""

    region: Ball

    def contains(self, points: Float[Array, "*n 3"]) -> Bool[Array, "*n"]:
        """Whether each point lies inside."""
        center = self.region.center
        return self.region.contains((points - center) * jnp.array([1.0, 1.0, -1.0]) + center)
