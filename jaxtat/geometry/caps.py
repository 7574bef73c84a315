"""Detectors in space: rings on a spherical cap, or points at any positions about a centre.

The axis of the cap is x_3, and it opens upwards. Its meridian section is an arc of the plane
(x_3, rho), rho the signed distance from the axis, which opens towards x_3 as the paper's arcs do
towards x_1: what can be seen from the cap, and at which distances, is asked of that arc.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
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
from .curves import CircularArc, DetectorCurve, SampledCurve, opening_angle
from .elements import (
    checked_element_radius,
    checked_normals,
    enough_nodes,
    mean_over_nodes,
    nodes_on_disks,
    nodes_on_sphere,
    round_factor,
)

T = TypeVar("T")

RULES = ("gauss", "equal")


def _distance(xp: Any, points: Any, center: Any) -> Any:
    return xp.linalg.norm(points - center, axis=-1)


class RoundElements(ComparedByIdentity, eqx.Module):
    """Detectors in space whose elements may have a size.

    Attributes:
        element_radius: a of elements that take the mean over a round piece of the sphere about the
            centre on which they lie, one number (or one for each of scattered detectors); None of
            point detectors [length]. Square ones of the side w record the same as round ones of
            w/√3, with the same second moment, up to the fourth power of the phase along them: 1 %
            where sound comes so far from the side that it goes half a wave farther to one edge than
            to the other. Flat ones of either kind are farther from the centre, by w²/12R in the
            mean.
    """

    element_radius: Float[Array, "*one_or_detectors"] | None = eqx.field(default=None, kw_only=True)
    points: eqx.AbstractVar[Float[Array, "*detectors 3"]]
    center: eqx.AbstractVar[Float[Array, "3"]]

    @property
    def distance(self) -> Float[Array, "*one_or_detectors"]:
        """Distances of the detectors from their centre [length]."""
        return by_library(_distance, (self.points, self.center))

    def element_factor(
        self, n_degrees: int, n_nodes: int
    ) -> Float[Array, "degrees *one_or_detectors"] | None:
        """Mean of a spherical harmonic over an element, over its value in the middle, by degree.

        None of point detectors; n_nodes as in `elements.round_factor`.
        """
        if self.element_radius is None:
            return None
        return round_factor(n_degrees, self.element_radius / self.distance, n_nodes)

    def enough_nodes(self, highest_frequency: float) -> int:
        """Number of nodes on an element, as `elements.enough_nodes`; detectors are concrete."""
        radius = self.element_radius
        return enough_nodes(None if radius is None else 2 * np.asarray(radius), highest_frequency)

    def element_nodes(
        self, n_nodes: int
    ) -> tuple[Float[Array, "nodes *detectors 3"], Float[np.ndarray, " nodes"]]:
        """Points on n_nodes circles of each element, and weights that add up to 1."""
        assert self.element_radius is not None
        distance = self.distance[..., None]
        middles, angle = (self.points - self.center) / distance, self.element_radius / self.distance
        units, weights = nodes_on_sphere(middles, angle, n_nodes)
        return self.center + distance * units, weights

    def mean_over_elements(self, compute: Callable[[Array], T], n_nodes: int) -> T:
        """Mean over each element of a function of points, (*detectors, 3), by `element_nodes`."""
        if self.element_radius is None:
            return compute(self.points)
        nodes, weights = self.element_nodes(n_nodes)
        return mean_over_nodes(compute, nodes, jnp.asarray(weights))


class SphericalCap(RoundElements):
    """Detectors on rings of a spherical cap, equispaced in azimuth from the plane x_2 = 0 on.

    Attributes:
        element_radius: of round elements, or None, see `RoundElements` [length].
        center, radius: of the sphere, (3,) and R_g [length].
        half_opening: half the angle under which the opening is seen from the centre [rad].
        n_rings, n_azimuths: of the detectors; data are (..., rings, azimuths, radii), rings from
            the lowest to the highest.
        rule: "gauss" or "equal", see `spherical_cap`.
    """

    center: Float[Array, "3"]
    radius: Float[Array, ""]
    half_opening: Float[Array, ""]
    n_rings: int = eqx.field(static=True)
    n_azimuths: int = eqx.field(static=True)
    rule: str = eqx.field(static=True)

    @property
    def distance(self) -> Float[Array, ""]:
        return self.radius

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the detectors: (rings, azimuths)."""
        return self.n_rings, self.n_azimuths

    @property
    @eqx.filter_jit
    def cosines(self) -> Float[Array, " rings"]:
        """cos theta of the rings, theta counted from the opening's axis."""
        return self._rings()[0]

    @property
    @eqx.filter_jit
    def ring_areas(self) -> Float[Array, " rings"]:
        """Area of the sphere that belongs to each ring [length²]."""
        return 2 * jnp.pi * self.radius**2 * self._rings()[1]

    @property
    def first_azimuths(self) -> Float[Array, " rings"]:
        """Azimuth of the first detector of each ring [rad]."""
        return jnp.zeros(self.n_rings)

    @property
    @eqx.filter_jit
    def points(self) -> Float[Array, "rings azimuths 3"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Detector positions [length]."""
        azimuths = 2 * np.pi / self.n_azimuths * np.arange(self.n_azimuths)
        azimuths = self.first_azimuths[:, None] + azimuths
        cosine = self.cosines[:, None]
        sine = jnp.sqrt(1 - cosine**2)
        parts = sine * jnp.cos(azimuths), sine * jnp.sin(azimuths), cosine
        return self.center + self.radius * jnp.stack(jnp.broadcast_arrays(*parts), axis=-1)

    @property
    @eqx.filter_jit
    def weights(self) -> Float[Array, "rings azimuths"]:
        """Area of each detector [length²]."""
        return jnp.broadcast_to(self.ring_areas[:, None] / self.n_azimuths, self.shape)

    @property
    def lowest_angle(self) -> Float[Array, ""]:
        """theta up to which the area of the lowest ring reaches [rad]."""
        return jnp.asarray(jnp.pi)

    @property
    def closed(self) -> bool:
        """Whether there is no opening."""
        return is_concrete(self.half_opening) and not float(self.half_opening) > 0

    @property
    def meridian(self) -> DetectorCurve:
        """The section with a plane through the axis, in (x_3, rho) from the centre."""
        return CircularArc(  # pyright: ignore[reportCallIssue] (abstract variables are no arguments)
            *(jnp.zeros(2), self.radius, jnp.zeros(()), self.half_opening),
            *(2 * self.n_rings, self.closed),
        )

    def _rings(self) -> tuple[Array, Array]:
        """cos theta, and the share ∫ dcos(theta) of each ring."""
        top = jnp.cos(self.half_opening)
        if self.rule == "gauss":
            nodes, weights = np.polynomial.legendre.leggauss(self.n_rings)
            return -1 + (1 + top) / 2 * (1 + nodes), (1 + top) / 2 * weights
        step = (jnp.pi - self.half_opening) / self.n_rings
        bounds = jnp.cos(jnp.pi - step * jnp.arange(self.n_rings + 1))
        middle = jnp.cos(jnp.pi - step * (jnp.arange(self.n_rings) + 0.5))
        return middle, jnp.diff(bounds)


def spherical_cap(
    radius: Numbers,
    cut: Numbers,
    n_rings: int,
    n_azimuths: int,
    *,
    center: Numbers = (0.0, 0.0, 0.0),
    rule: str = "gauss",
    element_radius: Numbers | None = None,
    element_size: Numbers | None = None,
) -> SphericalCap:
    """The cap |z| = R_g, z_3 < cut with detectors on rings.

    A frequency lambda needs rings at most π/(lambda R) apart, as seen from the centre, and
    2.5 lambda R azimuths, with R the reach of the region of interest.

    Args:
        radius: R_g > 0 [length].
        cut: the cap ends at this height above the centre, more than -radius; the whole sphere
            from radius on [length].
        n_rings: "gauss": at Gauss-Legendre nodes in cos theta; "equal": in the middle of equal
            steps of theta, each with its own area.
        n_azimuths: detectors on each ring, an even number.
        center: of the sphere, (3,) [length].
        rule: "gauss" or "equal".
        element_radius: of round elements over which detectors take the mean [length].
        element_size: the side of square ones in its place, see `RoundElements` [length].

    Raises:
        ValueError: for an empty cap, radius <= 0, fewer than 2 rings, an odd number of azimuths, or
            a size that no element can have.

    >>> cap = spherical_cap(1.3, 0.0, 24, 64)
    >>> cap.points.shape, round(float(cap.weights.sum() / (2 * jnp.pi * 1.3**2)), 12)
    ((24, 64, 3), 1.0)
    """
    radius, cut = real_array("radius", radius, ()), real_array("cut", cut, ())
    center = real_array("center", center, (3,))
    require_positive("radius", radius)
    if is_concrete(radius, cut) and float(cut) <= -float(radius):
        raise ValueError(
            f"the cap |z| = {float(radius)}, z_3 < {float(cut)} is empty: "
            "cut must be above -radius."
        )
    n_rings = whole_number("n_rings", n_rings, 2)
    n_azimuths = whole_number("n_azimuths", n_azimuths, 4)
    if n_azimuths % 2:
        raise ValueError(f"n_azimuths is {n_azimuths}, expected an even number.")
    if rule not in RULES:
        raise ValueError(f"rule is {rule!r}, expected one of {', '.join(RULES)}.")
    half_opening = opening_angle(cut / radius)
    elements = checked_element_radius(element_radius, radius, element_size)
    return SphericalCap(  # pyright: ignore[reportCallIssue] (abstract variables are no arguments)
        *(center, radius, half_opening, n_rings, n_azimuths, rule), element_radius=elements
    )


class DetectorPoints(RoundElements):
    """Detectors at any positions outside the ball about ``center`` that holds the region.

    Attributes:
        points: z_k, (detectors, 3) [length]; data are (..., detectors, radii).
        weights: how much each counts, (detectors,), for instance the area it stands for.
        center: about which waves are taken, (3,) [length].
        element_radius: of round elements, or None, see `RoundElements`.
        normals: of flat elements, unit vectors to either side, (detectors, 3); None of elements
            that face the centre, which cost nothing: means over others are sums over some twenty
            points of each.

    >>> squares = DetectorPoints([[1.3, 0.0, 0.0], [0.0, 0.0, -1.3]], element_size=0.03)
    >>> squares.shape, round(float(squares.element_radius), 6)  # 0.03 / √3
    ((2,), 0.017321)
    """

    points: Float[Array, "detectors 3"]
    weights: Float[Array, " detectors"]
    center: Float[Array, "3"]
    normals: Float[Array, "detectors 3"] | None

    def __init__(
        self,
        points: Numbers,
        weights: Any = None,
        center: Numbers = (0.0, 0.0, 0.0),
        *,
        element_radius: Numbers | None = None,
        element_size: Numbers | None = None,
        normals: Numbers | None = None,
    ):
        """points, weights (equal ones by default), center, element_radius and normals as above.

        Of square elements element_size is the side, in place of element_radius: one number or one
        for each. Without normals they face the centre.

        Raises:
            ValueError: for wrong shapes, NaN, weights that are not positive, a size that no element
                can have, normals without a direction, or of points.
        """
        self.points = real_array("points", points, ("detectors", 3))
        n = whole_number("the number of detectors", self.points.shape[0], 1)
        self.weights = real_array("weights", np.ones(n) if weights is None else weights, (n,))
        require_positive("weights", self.weights)
        self.center = real_array("center", center, (3,))
        self.element_radius = checked_element_radius(element_radius, self.distance, element_size)
        self.normals = None if normals is None else checked_normals(normals, n)
        if normals is not None and self.element_radius is None:
            raise ValueError(
                "normals are given without element_radius or element_size: points have none."
            )

    def element_factor(
        self, n_degrees: int, n_nodes: int
    ) -> Float[Array, "degrees *one_or_detectors"] | None:
        """As of `RoundElements`; None of flat elements, too."""
        return None if self.normals is not None else super().element_factor(n_degrees, n_nodes)

    def element_nodes(
        self, n_nodes: int
    ) -> tuple[Float[Array, "nodes detectors 3"], Float[np.ndarray, " nodes"]]:
        """As of `RoundElements`, of the sphere, or on flat elements."""
        if self.normals is None:
            return super().element_nodes(n_nodes)
        assert self.element_radius is not None
        return nodes_on_disks(self.points, self.normals, self.element_radius, n_nodes)

    def enough_nodes(self, highest_frequency: float) -> int:
        """Circles of nodes: of flat elements fewer, as each is a detector to be computed."""
        enough = super().enough_nodes(highest_frequency)
        return enough if self.normals is None else 1 + -(-(enough - 4) // 2)

    @property
    def shape(self) -> tuple[int]:
        """Shape of the detectors: (detectors,)."""
        return (self.points.shape[0],)

    @property
    @eqx.filter_jit
    def meridian(self) -> DetectorCurve:
        """All detectors turned into the plane (x_3, rho), on both sides of the axis."""
        local = self.points - self.center
        distance = jnp.linalg.norm(local[:, :2], axis=1)
        points = jnp.stack([jnp.tile(local[:, 2], 2), jnp.concatenate([distance, -distance])], 1)
        normals = points / jnp.linalg.norm(points, axis=1, keepdims=True)
        return SampledCurve(points, jnp.tile(self.weights, 2), normals, False)


Detectors = SphericalCap | DetectorPoints
