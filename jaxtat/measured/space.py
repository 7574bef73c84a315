"""Scans in space: detectors around a volume, by their positions."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..checks import real_array
from ..geometry import VolumeGrid
from ..harmonic.tikhonov import SolveReport
from ..io import Scan
from ..spherical import (
    BallPart,
    CapLayout,
    DetectorPoints,
    SphericalCap,
    ball_part,
    cap_layout,
    enough_boundary,
    find_rings,
    reconstruct_cap,
)
from ..spherical.rings import fit_sphere
from ..units import Units
from .choices import LOW_PASSES, Choices
from .facts import rows_used, times_of, units_of

MOST_POINTS = 800  # detectors off rings: their systems are dense


class FactsInSpace(NamedTuple):
    """What a scan holds that is no choice.

    Attributes:
        detectors: the cap, or points.
        order: rows of the data in the order of the detectors, flat.
        radius: of the sphere on which, or near which, they lie [length].
        upside_down: see `spherical.rings.FoundRings`.
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
        """In words."""
        if isinstance(self.detectors, SphericalCap):
            rings, azimuths = self.detectors.shape
            way = "downwards" if self.upside_down else "upwards"
            return f"{rings} rings of {azimuths} on a sphere, open {way}"
        return "on no rings: all systems are dense"


def facts_in_space(scan: Scan, use: object = None) -> FactsInSpace:
    """Detectors on rings, if they are, and times.

    Args:
        scan: of which `facts.in_space` is true.
        use: rows of the data to use, all by default.

    Raises:
        ValueError: for detectors that are neither on rings nor few, and as `rows_used` and
            `times_of`.
    """
    rows = rows_used(scan, use)
    points = np.asarray(scan.known["detectors"], float)[rows]
    times = times_of(scan)
    try:
        found = find_rings(points)
        detectors, order, upside_down = found.rings, found.order.ravel(), found.upside_down
        radius = float(found.rings.radius)
    except ValueError as error:
        if len(points) > MOST_POINTS:
            raise ValueError(
                f"{error} Only up to {MOST_POINTS} detectors may lie anywhere, here are "
                f"{len(points)}: choose some with --use."
            ) from error
        center, radius = fit_sphere(points)
        detectors, order = DetectorPoints(points, None, center), np.arange(len(points))
        upside_down = False
    return FactsInSpace(detectors, rows[order], radius, upside_down, times, units_of(radius, times))


class TurnedOver(eqx.Module):
    """A region in the mirror of its central plane x_3 = c_3."""

    region: BallPart

    def contains(self, points: Float[Array, "*n 3"]) -> Bool[Array, "*n"]:
        """Whether each point lies inside."""
        center = self.region.center
        return self.region.contains((points - center) * jnp.array([1.0, 1.0, -1.0]) + center)


class Space(eqx.Module):
    """Detectors, region, voxels and radii, found once for all frames.

    Detectors open upwards; ``upside_down`` tells that volumes are to be turned over in x_3. The
    grid is symmetric about the centre and stays; the region is `shown_region` then.
    """

    detectors: SphericalCap | DetectorPoints
    region: BallPart
    grid: VolumeGrid
    radii: Float[Array, " radii"]
    upside_down: bool = eqx.field(static=True)

    @classmethod
    def of(cls, scan: Scan, choices: Choices) -> "Space":
        facts = facts_in_space(scan, choices.order)
        own = scan.known.get("radii") if scan.kind == "circular_integrals" else None
        radii = choices.radii if own is None else real_array("radii", own, ("radii",))
        grid = VolumeGrid(choices.pixels, choices.half_width, np.array(choices.region_center))
        region = region_in_space(choices.settings())
        return cls(facts.detectors, region, grid, radii, facts.upside_down)

    @property
    def shown_region(self) -> BallPart | TurnedOver:
        return TurnedOver(self.region) if self.upside_down else self.region

    def layout(self, choices: Choices) -> CapLayout:
        return cap_layout(
            self.detectors,
            self.region,
            self.grid,
            self.radii,
            max_frequency=choices.max_frequency,
        )

    def volumes(
        self, layout: CapLayout, choices: Choices, g: Array
    ) -> tuple[Float[Array, "*frames x1 x2 x3"], SolveReport]:
        """Volumes of spherical integrals (..., detectors, radii)."""
        g = g.reshape(*g.shape[:-2], *self.detectors.shape, g.shape[-1])
        found = reconstruct_cap(
            self.detectors,
            self.region,
            self.grid,
            self.radii,
            g,
            choices.alpha,
            low_pass=LOW_PASSES[choices.low_pass],
            inversion=choices.inversion,
            layout=layout,
        )
        volume = found.volume[..., ::-1] if self.upside_down else found.volume
        return volume, found.report


def region_in_space(settings: Mapping[str, Any]) -> BallPart:
    """Ball, or its part below the cut, about the detectors' centre; by choices' names."""
    radius, cut = settings["region_radius"], settings["region_cut"]
    center = jax.device_put(np.array(settings["region_center"]))
    if cut >= radius:
        return ball_part(radius, center=center)
    n_boundary = enough_boundary(radius, cut, settings["max_frequency"])
    return ball_part(radius, cut, n_boundary, center=center)
