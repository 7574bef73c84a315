"""Regions of interest in space: a ball about the centre of the detectors, or its lower part."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..base.checks import Numbers, is_concrete, real_array, require_positive
from ..base.hashable_methods import ComparedByIdentity, compiled
from .curves import opening_angle
from .regions import Disk, disk


class Ball(ComparedByIdentity, eqx.Module):
    """|x| < R, x_3 < cut, moved to ``center``.

    Attributes:
        center, radius, cut: as in `ball` [length].
        whole: whether it is not cut at all.
    """

    center: Float[Array, "3"]
    radius: Float[Array, ""]
    cut: Float[Array, ""]
    whole: bool = eqx.field(static=True)

    @property
    def meridian(self) -> Disk:
        """The section with a plane through the axis, in (x_3, rho) from the centre; concrete."""
        return disk(self.radius, None if self.whole else self.cut, n_boundary=64)

    @compiled
    def contains(self, points: Float[Array, "*n 3"]) -> Bool[Array, "*n"]:
        """Whether each point lies inside (the boundary does not)."""
        local = points - self.center
        inside = jnp.sum(local**2, axis=-1) < self.radius**2
        return inside if self.whole else inside & (local[..., 2] < self.cut)

    def boundary(self, counts: tuple[int, int]) -> "Boundary":
        """Points of a meridian from pole to rim and along the flat part, for ∫ dS over all.

        Args:
            counts: Gauss points on the curved and on the flat part, see `enough_boundary`.
        """
        half_opening = opening_angle(self.cut / self.radius)
        node, weight = np.polynomial.legendre.leggauss(counts[0])
        theta = half_opening + (jnp.pi - half_opening) * (node + 1) / 2
        curved = self.radius**2 * jnp.sin(theta) * (jnp.pi - half_opening) / 2 * weight
        node, weight = np.polynomial.legendre.leggauss(counts[1])
        rim = self.radius * jnp.sin(half_opening)
        rho = rim * (node + 1) / 2
        distance = jnp.sqrt(rho**2 + self.cut**2)
        flat = np.repeat([0.0, 1.0], counts)
        return Boundary(
            distance=jnp.concatenate([jnp.full_like(theta, self.radius), distance]),
            cosine=jnp.concatenate([jnp.cos(theta), self.cut / distance]),
            weights=2 * jnp.pi * jnp.concatenate([curved, rho * rim / 2 * weight]),
            flat=jnp.asarray(flat),
        )


class Boundary(eqx.Module):
    """Points of a surface of revolution.

    Attributes:
        distance, cosine: |x| [length] and cos theta.
        weights: area of the surface that belongs to each [length²].
        flat: 1 where the normal is e_3, 0 where it is e_r.
    """

    distance: Float[Array, " points"]
    cosine: Float[Array, " points"]
    weights: Float[Array, " points"]
    flat: Float[Array, " points"]


def ball(radius: Numbers, cut: Numbers | None = None, *, center: Numbers = (0.0, 0.0, 0.0)) -> Ball:
    """The ball |x| < R, or its part below x_3 = cut, which a cap up to the same height sees.

    Args:
        radius: R > 0 [length].
        cut: height of the cut above the centre, between -radius and radius; None for the ball
            [length].
        center: (3,), the centre of the detectors [length].

    Raises:
        ValueError: for radius <= 0, or a cut that misses the ball.

    >>> half = ball(1.0, 0.0)
    >>> half.contains(jnp.array([[0.5, 0.0, -0.1], [0.5, 0.0, 0.1]])).tolist()
    [True, False]
    >>> round(float(half.boundary((60, 40)).weights.sum()) / np.pi, 12)  # 2 π R² + π R²
    3.0
    """
    radius, center = real_array("radius", radius, ()), real_array("center", center, (3,))
    require_positive("radius", radius)
    if cut is None:
        return Ball(center, radius, radius, True)
    cut = real_array("cut", cut, ())
    if is_concrete(radius, cut) and not abs(float(cut)) < float(radius):
        raise ValueError(
            f"cut is {float(cut)}, expected between -radius and radius = {float(radius)}; "
            "leave it out for the whole ball."
        )
    return Ball(center, radius, cut, False)


def enough_boundary(radius: float, cut: float, frequency: float) -> tuple[int, int]:
    """Numbers of Gauss points on both parts of a meridian, enough for waves up to lambda.

    Products of two waves along a piece of length L take lambda L/2 Gauss points, and a few more.

    Args:
        radius, cut: of the cut ball [length].
        frequency: lambda [rad/length].

    >>> enough_boundary(1.0, 0.0, 50.0)
    (49, 34)
    """
    angle = np.pi - np.arccos(cut / radius)
    arc, rim = (np.ceil(frequency * radius * k / 2) + 8 for k in (angle, np.sin(angle)))
    n = int(np.ceil(max(5 * arc / 3, 5 * rim / 2)))  # shared as 3 to 2
    return 3 * n // 5, n - 3 * n // 5
