"""Regions of interest in space: a ball about the centre of the detectors, or its lower part."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..checks import Numbers, is_concrete, real_array, require_positive, whole_number
from ..geometry import TruncatedDisk, truncated_disk
from ..geometry.curves import opening_angle


class BallPart(eqx.Module):
    """|x| < R, x_3 < x_top, moved to ``center``.

    Attributes:
        center, radius, x_top: as in `ball_part` [length].
        n_boundary: Gauss points on the curved and on the flat part of a meridian; none for a ball.
    """

    center: Float[Array, "3"]
    radius: Float[Array, ""]
    x_top: Float[Array, ""]
    n_boundary: tuple[int, int] | None = eqx.field(static=True)

    @property
    def whole(self) -> bool:
        """Whether it is all of the ball."""
        return self.n_boundary is None

    @property
    def meridian(self) -> TruncatedDisk:
        """The section with a plane through the axis, in (x_3, rho) from the centre; concrete."""
        return truncated_disk(self.radius, self.radius if self.whole else self.x_top, 64)

    def contains(self, points: Float[Array, "*n 3"]) -> Bool[Array, "*n"]:
        """Whether each point lies inside (the boundary does not)."""
        local = points - self.center
        inside = jnp.sum(local**2, axis=-1) < self.radius**2
        return inside if self.whole else inside & (local[..., 2] < self.x_top)

    def boundary(self) -> "Boundary":
        """Points of a meridian from pole to rim and along the flat part, for ∫ dS over all."""
        assert self.n_boundary is not None
        half_opening = opening_angle(self.x_top / self.radius)
        node, weight = np.polynomial.legendre.leggauss(self.n_boundary[0])
        theta = half_opening + (jnp.pi - half_opening) * (node + 1) / 2
        curved = self.radius**2 * jnp.sin(theta) * (jnp.pi - half_opening) / 2 * weight
        node, weight = np.polynomial.legendre.leggauss(self.n_boundary[1])
        rim = self.radius * jnp.sin(half_opening)
        rho = rim * (node + 1) / 2
        distance = jnp.sqrt(rho**2 + self.x_top**2)
        flat = np.repeat([0.0, 1.0], self.n_boundary)
        return Boundary(
            distance=jnp.concatenate([jnp.full_like(theta, self.radius), distance]),
            cosine=jnp.concatenate([jnp.cos(theta), self.x_top / distance]),
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


def ball_part(
    radius: Numbers,
    x_top: Numbers | None = None,
    n_boundary: int | None = None,
    *,
    center: Numbers = (0.0, 0.0, 0.0),
) -> BallPart:
    """The ball |x| < R, or its part below x_3 = x_top, which a cap up to z_top = x_top sees.

    Args:
        radius: R > 0 [length].
        x_top: height of the cut above the centre, between -radius and radius; None for the ball
            [length].
        n_boundary: points on a meridian of the cut ball, shared between its curved and its flat
            part as 3 to 2; see `enough_boundary`.
        center: (3,), the centre of the detectors [length].

    Raises:
        ValueError: for radius <= 0, a cut that misses the ball, or one without n_boundary.

    >>> half = ball_part(1.0, 0.0, 100)
    >>> half.contains(jnp.array([[0.5, 0.0, -0.1], [0.5, 0.0, 0.1]])).tolist()
    [True, False]
    >>> round(float(half.boundary().weights.sum() / jnp.pi), 12)  # 2 π R² + π R²
    3.0
    """
    radius, center = real_array("radius", radius, ()), real_array("center", center, (3,))
    require_positive("radius", radius)
    if x_top is None:
        return BallPart(center, radius, radius, None)
    x_top = real_array("x_top", x_top, ())
    if is_concrete(radius, x_top) and not abs(float(x_top)) < float(radius):
        raise ValueError(
            f"x_top is {float(x_top)}, expected between -radius and radius = {float(radius)}; "
            "leave it out for the whole ball."
        )
    if n_boundary is None:
        raise ValueError("n_boundary is missing: a cut ball needs points on its boundary.")
    n_boundary = whole_number("n_boundary", n_boundary, 16)
    return BallPart(center, radius, x_top, (3 * n_boundary // 5, n_boundary - 3 * n_boundary // 5))


def enough_boundary(radius: float, x_top: float, frequency: float) -> int:
    """The n_boundary that `ball_part` needs for waves up to lambda.

    Products of two waves along a piece of length L take lambda L/2 Gauss points, and a few more.

    Args:
        radius, x_top: of the cut ball [length].
        frequency: lambda [rad/length].

    >>> enough_boundary(1.0, 0.0, 50.0)
    83
    """
    angle = np.pi - np.arccos(x_top / radius)
    arc, rim = (np.ceil(frequency * radius * k / 2) + 8 for k in (angle, np.sin(angle)))
    return int(np.ceil(max(5 * arc / 3, 5 * rim / 2)))  # which share the points as 3 to 2
