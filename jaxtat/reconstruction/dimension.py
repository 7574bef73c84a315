"""Problems in the plane and in space: what differs between them, in one table."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from ..base.checks import named
from ..densities import Basis
from ..forward import CircleSizes, circle_integrals, sizes_inside, sphere_integrals
from ..geometry import (
    BallBody,
    Body,
    DetectorCurve,
    DiskBody,
    ImageGrid,
    OutlineBody,
    Region,
    VolumeGrid,
    data_radii,
    require_outside,
    require_surrounded,
    uncovered,
)
from ..geometry.balls import Ball
from ..geometry.caps import DetectorPoints, SphericalCap
from ..geometry.regions import DEFAULT_BOUNDARY
from ..regularization import Tikhonov, TikhonovRule
from ..spherical.basis import spherical_basis
from ..spherical.sizes import cap_radii, require_fitting, space_sizes, uncovered_in_space
from .plane_bases import default_rule, plane_basis
from .sizes import plane_sizes

DEFAULT_ALPHA_IN_SPACE = 1e-6


class Kind(NamedTuple):
    """What a problem is made of and how it is answered, in the plane or in space.

    Functions of a curve take the medium as one argument more, if there is one.

    Attributes:
        where: in words.
        data: what the integrals are called.
        parts: for curve, region, grid and medium the class, and what makes it, in words.
        radii: (curve, region, step) -> radii that the data need.
        radii_per_pixel: of the default ones.
        sizes: (curve, region, grid, radii, max_frequency, n_directions, n_groups) -> sizes, and the
            region with enough boundary points.
        require_fitting: (curve, region): raise ValueError where they do not go together.
        uncovered: (curve, region, radii) -> in words, which circles of the region have no data.
        basis: (curve, region, radii, sizes, mesh) -> the waves to solve in.
        default_rule: of sizes.
        tolerance: relative error of the non-uniform FFTs of the forward operator. In space the
            error of the image's band limit is larger, and digits cost more.
        fast_integrals: (curve, grid, radii, sizes, eta, tolerance) -> over circles or spheres of
            images that are band-limited, see `forward_operator`.
        sizes_inside: of a setup, those of the forward operator on images that are zero outside of
            the region.
        measure: of a circle or sphere, by its radius.
    """

    where: str
    data: str
    parts: Mapping[str, tuple[Any, str]]
    radii: Callable[..., Array]
    radii_per_pixel: int
    sizes: Callable[..., tuple[Any, Any]]
    require_fitting: Callable[..., None]
    uncovered: Callable[..., str]
    basis: Callable[..., Basis]
    default_rule: Callable[[Any], TikhonovRule]
    tolerance: float
    fast_integrals: Callable[..., Any]
    sizes_inside: Callable[[Any], Any]
    measure: Callable[[Array], Array]

    def require(self, name: str, part: Any) -> None:
        """Raise ValueError for a curve, region or grid of another kind."""
        expected, maker = self.parts[name]
        if not isinstance(part, expected):
            raise ValueError(
                f"{name} is {named(part)}, expected for detectors in {self.where} what {maker} "
                "makes."
            )


def _plane_radii(
    curve: DetectorCurve, region: Region, step: Array, medium: Body | None = None
) -> Array:
    if region.automatic:  # the same, whichever setup the region has been in
        region = region.with_counts(region.shared_out(DEFAULT_BOUNDARY))
    return data_radii(curve, region, step, medium=medium)


def _require_plane(curve: DetectorCurve, region: Region, medium: Body | None = None) -> None:
    require_outside(curve.points, region)
    if medium is not None:
        require_surrounded(curve, region, medium)


def _inside_in_plane(setup: Any) -> CircleSizes:
    where = setup.curve, setup.grid, setup.region, setup.medium
    return sizes_inside(setup.sizes.operator, *where)


PLANE = Kind(
    where="the plane",
    data="circular",
    parts={
        "curve": (DetectorCurve, "detector_curve(positions) or circular_arc"),
        "region": (Region, "disk(radius), polygon or rectangle"),
        "grid": (ImageGrid, "ImageGrid(n)"),
        "medium": (DiskBody | OutlineBody, "DiskBody or OutlineBody"),
    },
    radii=_plane_radii,
    radii_per_pixel=1,
    sizes=plane_sizes,
    require_fitting=_require_plane,
    uncovered=uncovered,
    basis=plane_basis,
    default_rule=default_rule,
    tolerance=1e-9,
    fast_integrals=circle_integrals,
    sizes_inside=_inside_in_plane,
    measure=lambda radii: 2 * jnp.pi * radii,
)

SPACE = Kind(
    where="space",
    data="spherical",
    parts={
        "curve": (SphericalCap | DetectorPoints, "spherical_cap or DetectorPoints"),
        "region": (Ball, "spherical.ball(radius)"),
        "grid": (VolumeGrid, "VolumeGrid(n)"),
        "medium": (BallBody, "spherical.BallBody"),
    },
    radii=cap_radii,
    radii_per_pixel=2,
    sizes=space_sizes,
    require_fitting=require_fitting,
    uncovered=uncovered_in_space,
    basis=spherical_basis,
    default_rule=lambda sizes: Tikhonov(DEFAULT_ALPHA_IN_SPACE),
    tolerance=1e-7,
    fast_integrals=sphere_integrals,
    sizes_inside=lambda setup: setup.sizes.inside,
    measure=lambda radii: 4 * jnp.pi * radii**2,
)


def kind_of(curve: Any) -> Kind:
    """SPACE for detectors around a volume, else PLANE."""
    return SPACE if isinstance(curve, SPACE.parts["curve"][0]) else PLANE
