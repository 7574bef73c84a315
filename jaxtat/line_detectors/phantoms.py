"""Balls and smooth bells in space, whose projections along lines have exact circular integrals.

The projection of a radial power (1 - |x|²/r²)^q is again one, in the plane and with q + 1/2, and
what its integral over a circle leaves is the integral of an analytic periodic function.
"""

from math import gamma, pi, sqrt
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_positive, whole_number
from ..base.hashable_methods import compiled
from ..geometry import DetectorCurve, ImageGrid
from ..phantoms import Phantom, RadialParts
from ..special import j0
from .scan import LineDetectorScan


class PolynomialBalls(RadialParts):
    """f(x) = Σ_m a_m (1 - |x - c_m|²/r_m²)^q inside the balls |x - c_m| < r_m, 0 outside them.

    q = 0 gives balls of constant value, q >= 1 bells with q - 1 continuous derivatives.

    Args:
        centers: c_m, (parts, 3), the third coordinate along the axis of rotation [length].
        radii: r_m > 0, (parts,) [length].
        amplitudes: a_m, (parts,), ones by default.
        exponent: q, a whole number.

    Raises:
        ValueError: for wrong shapes, radii that are not positive or q < 0.

    >>> bell = PolynomialBalls([[0.0, 0.0, 0.2]], [0.5], exponent=2)
    >>> round(float(bell(jnp.array([0.3, 0.0, 0.2]))), 12)  # (1 - 0.36)²
    0.4096
    """

    exponent: int = eqx.field(static=True)

    dimension = 3

    def __init__(
        self,
        centers: Numbers,
        radii: Numbers,
        amplitudes: Numbers | None = None,
        exponent: Any = 0,
    ):
        super().__init__(centers, radii, amplitudes)
        self.exponent = whole_number("exponent", exponent, 0)

    def _profile(self, t: Array) -> Array:
        return jnp.where(t < 1, (1 - jnp.minimum(t, 1.0) ** 2) ** self.exponent, 0.0)

    @compiled
    def volume(self, slices: ImageGrid, heights: Numbers) -> Float[Array, "x1 x2 x3"]:
        """f at the nodes (x1, x2) of a grid and at heights x3, (heights,) [length]."""

        def at(height: Array) -> Array:
            third = jnp.broadcast_to(height, (*slices.shape, 1))
            return self(jnp.concatenate([slices.points, third], axis=-1))

        return jnp.moveaxis(jax.lax.map(at, jnp.asarray(heights)), 0, -1)

    def projection(self, angle: Numbers, axis: Numbers = 0.0) -> "ProjectedBalls":
        """P(x1, x2) = ∫ f(s cos φ - t sin φ, s sin φ + t cos φ, x2) dt, s = x1 - axis.

        Args:
            angle: φ [rad].
            axis: where the axis of rotation crosses the plane of the 2-D problem [length].

        Returns:
            ProjectedBalls, amplitudes [length, for a dimensionless f].
        """
        return self._projection(real_array("angle", angle, ()), real_array("axis", axis, ()))

    @eqx.filter_jit
    def _projection(self, angle: Array, axis: Array) -> "ProjectedBalls":
        x, y, z = self.centers.T
        centers = jnp.stack([axis + x * jnp.cos(angle) + y * jnp.sin(angle), z], axis=-1)
        depth = _chord_power(self.exponent) * self.radii
        return ProjectedBalls(centers, self.radii, self.amplitudes * depth, self.exponent)

    def circular_integrals(
        self, scan: LineDetectorScan, curve: DetectorCurve, radii: Numbers
    ) -> Float[Array, "rotations detectors radii"]:
        """g(φ, z, r) = ∫_{|x - z| = r} P_φ dl: what line detectors measure, exact up to rounding.

        Args:
            scan: angles φ and axis.
            curve: the points z where the line detectors cross the plane of the 2-D problem, all
                outside the projected balls.
            radii: r > 0, (radii,) [length].

        Returns:
            (rotations, detectors, radii) [length², for a dimensionless f].

        Raises:
            ValueError: for detectors within a projected ball, or radii that are not positive.

        >>> from jaxtat import circular_arc
        >>> scan, curve = LineDetectorScan([0.0, 0.5 * jnp.pi]), circular_arc(1.3, 1.0, 8)
        >>> balls = PolynomialBalls([[0.1, 0.2, 0.3]], [0.4])
        >>> balls.circular_integrals(scan, curve, [0.9, 1.3]).shape
        (2, 8, 2)
        """
        radii = real_array("radii", radii, ("radii",))
        require_positive("radii", radii)
        if is_concrete(self, scan, curve):
            x, y, z = np.asarray(self.centers).T
            angles = np.asarray(scan.angles)[:, None]
            along = np.asarray(scan.axis) + x * np.cos(angles) + y * np.sin(angles)
            _require_outside(curve, np.stack(np.broadcast_arrays(along, z), -1), self.radii)
        return self._rotated_integrals(scan, curve, radii)

    @eqx.filter_jit
    def _rotated_integrals(
        self, scan: LineDetectorScan, curve: DetectorCurve, radii: Array
    ) -> Array:
        def at(angle: Array) -> Array:
            return self._projection(angle, scan.axis)._circular_integrals(curve, radii)

        return jax.lax.map(at, scan.angles)


class ProjectedBalls(Phantom):
    """P(x) = Σ_m a_m (1 - |x - c_m|²/r_m²)^(q + 1/2) in the plane.

    Arguments as for `PolynomialBalls`.

    With d = |z - c| > r0 the distance of a detector, the circle of radius r cuts the disk of a part
    where k² = (r0² - (d - r)²) / (4 d r) > 0, and sin(φ/2) = k sin ψ turns its integral into

        2 r0 √(r/d) (1 - (d - r)²/r0²)^(q+1) ∫_0^{π/2} cos^(2q+2) ψ / √(1 - k² sin² ψ) dψ,

    k² <= 1/2: periodic and analytic, so that the trapezoid rule converges geometrically.
    """

    exponent: int = eqx.field(static=True)

    def __init__(self, centers: Numbers, radii: Numbers, amplitudes: Numbers, exponent: Any):
        super().__init__(centers, radii, amplitudes)
        self.exponent = whole_number("exponent", exponent, 0)

    def circular_integrals(
        self, curve: DetectorCurve, radii: Numbers, *, n_nodes: int = 16
    ) -> Float[Array, "detectors radii"]:
        """As for every phantom; detectors must lie outside all parts (ValueError)."""
        if is_concrete(self, curve):
            _require_outside(curve, np.asarray(self.centers), self.radii)
        return super().circular_integrals(curve, radii, n_nodes=n_nodes)

    def _profile(self, t: Array) -> Array:
        inside = t < 1
        square = jnp.where(inside, 1 - t**2, 1.0)
        return jnp.where(inside, jnp.sqrt(square) * square**self.exponent, 0.0)

    def _arc_integral(self, distance: Array, r: Array, part_radius: Array) -> Array:
        gap = (distance - r) / part_radius
        cap = jnp.maximum((1 - gap) * (1 + gap), 0.0)
        k2 = cap * part_radius**2 / (4 * distance * r)
        n = 16 + self.exponent  # of a quarter turn: error below 1e-16 for k² <= 1/2
        psi = np.arange(n) * (pi / (2 * n))
        weights = np.cos(psi) ** (2 * self.exponent + 2) * (pi / (2 * n))
        weights[0] /= 2  # cos vanishes at the other end
        quarter = weights / jnp.sqrt(1 - k2[..., None] * np.sin(psi) ** 2)
        scale = 2 * part_radius * jnp.sqrt(r / distance) * cap ** (self.exponent + 1)
        return scale * jnp.sum(quarter, axis=-1)

    def _line_integral(self, t: Array) -> Array:
        square = jnp.maximum(1 - t**2, 0.0)
        return _chord_power(self.exponent + 0.5) * square ** (self.exponent + 1)

    def _hankel(self, k: Array) -> Array:
        nodes, weights = np.polynomial.legendre.leggauss(512)  # resolves k up to several hundred
        psi = (nodes + 1) * (pi / 4)  # t = sin ψ
        weights = weights * (pi / 4) * np.cos(psi) ** (2 * self.exponent + 2) * np.sin(psi)
        return j0(k[:, None] * np.sin(psi)) @ weights


def _chord_power(q: int | float) -> float:
    """∫ (1 - t²)^q dt over -1 < t < 1, q > -1."""
    return sqrt(pi) * gamma(q + 1) / gamma(q + 1.5)


def _require_outside(curve: DetectorCurve, centers: np.ndarray, radii: Array) -> None:
    """ValueError if a detector lies within a projected part; centers (..., parts, 2)."""
    for k, point in enumerate(np.asarray(curve.points)):
        distance = np.hypot(*np.moveaxis(centers - point, -1, 0))
        inside = np.argwhere(distance < np.asarray(radii))
        if inside.size:
            part = int(inside[0, -1])
            raise ValueError(
                f"detector {k} at {point} lies inside the projection of part {part} (radius "
                f"{float(radii[part]):.6g}): line detectors must pass the object, so use a larger "
                "curve or smaller parts nearer to the axis."
            )
