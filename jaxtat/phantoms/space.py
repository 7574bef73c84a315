"""Phantoms in space whose volume, spherical integrals and Fourier transform are exact.

f(x) = Σ_m a_m b(|x - c_m| / r_m) with b = 0 beyond 1. On the sphere |x - z| = r the distance s
to c_m has the density 2π r s ds / d, d = |z - c_m|, so that

    g(z, r) = Σ_m a_m (2π r r_m² / d) [Q(|d - r|/r_m) - Q((d + r)/r_m)],  Q(t) = ∫_t^1 b(s) s ds.
"""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..base.checks import Numbers, real_array, require_objects, require_positive
from ..base.hashable_methods import compiled
from ..base.rows import map_rows
from ..geometry import VolumeGrid
from ..geometry.caps import Detectors
from ..special import spherical_sequence
from .radial import RadialParts, gauss_legendre, sin8_integral

_AT_CENTER = 1e-6  # of a part's radius: detectors nearer than that are in its centre


class SolidPhantom(RadialParts):
    """Σ_m a_m b(|x - c_m| / r_m) in space, see `Balls` for the arguments."""

    dimension = 3

    def __init__(self, centers: Numbers, radii: Numbers, amplitudes: Numbers | None = None):
        super().__init__(centers, radii, amplitudes)

    @abstractmethod
    def _moment(self, t: Array) -> Array:
        """Q(t) = ∫_t^1 b(s) s ds, 0 <= t <= 1."""

    @abstractmethod
    def _hankel(self, k: Array) -> Array:
        """∫_0^1 b(t) j_0(k t) t² dt."""

    @compiled
    def volume(self, grid: VolumeGrid) -> Float[Array, "x1 x2 x3"]:
        """f at the nodes of the grid, (x1, x2, x3)."""
        require_objects(volume_grid=grid)
        return jax.lax.map(self, grid.points)

    def spherical_integrals(
        self, detectors: Detectors, radii: Numbers, *, n_nodes: int = 8
    ) -> Float[Array, "*detectors radii"]:
        """g(z, r) = ∫_{|x - z| = r} f dS, exact up to rounding.

        Args:
            detectors: z, at any positions.
            radii: r > 0, (radii,) [length].
            n_nodes: on round elements it is the mean over so many circles of twice as many points:
                enough for smooth parts as wide as an element.

        Returns:
            (rings, azimuths, radii) of a cap, (detectors, radii) of points [length², for a
            dimensionless f].

        Raises:
            ValueError: for radii that are not above zero, NaN, or a wrong shape.
        """
        radii = real_array("radii", radii, ("radii",))
        require_positive("radii", radii)
        return self._spherical_integrals(detectors, radii, n_nodes)

    @eqx.filter_jit
    def _spherical_integrals(self, detectors: Detectors, radii: Array, n_nodes: int) -> Array:
        def of_detector(point: Array) -> Array:
            def one(center: Array, radius: Array, amplitude: Array) -> Array:
                square = jnp.sum((point - center) ** 2)
                # at the centre the difference of Q over d is 2 b(r/r_m) r/r_m²; even in d, it is
                # that near by too, where the difference cancels
                there = square < (_AT_CENTER * radius) ** 2
                distance = jnp.sqrt(jnp.where(there, radius**2, square))
                near = self._moment(jnp.minimum(jnp.abs(distance - radii) / radius, 1.0))
                far = self._moment(jnp.minimum((distance + radii) / radius, 1.0))
                apart = 2 * jnp.pi * radii * radius**2 / distance * (near - far)
                around = 4 * jnp.pi * radii**2 * self._profile(radii / radius)
                return amplitude * jnp.where(there, around, apart)

            return self._sum_over_parts(one)

        def of_points(points: Array) -> Array:
            integrals = map_rows(of_detector, points.reshape(-1, 3), 256)
            return integrals.reshape(*points.shape[:-1], -1)

        return detectors.mean_over_elements(of_points, n_nodes)

    @compiled
    def fourier(self, xi: Numbers) -> Complex[Array, "..."]:
        """fhat(xi) = (2π)^(-3/2) ∫ f(x) exp(-i xi·x) dx; xi (..., 3) [rad/length] to (...)."""
        xi = jnp.asarray(xi)
        size = jnp.linalg.norm(xi, axis=-1)

        def one(center: Array, radius: Array, amplitude: Array) -> Array:
            phase = jnp.exp(-1j * (xi @ center))
            return amplitude * radius**3 * self._hankel(radius * size) * phase

        return 4 * jnp.pi / (2 * jnp.pi) ** 1.5 * self._sum_over_parts(one)


class Balls(SolidPhantom):
    """Sum of balls: f(x) = Σ_m a_m [|x - c_m| < r_m].

    Args:
        centers: c_m, (parts, 3) [length].
        radii: r_m > 0, (parts,) [length].
        amplitudes: a_m, (parts,), ones by default.

    Raises:
        ValueError: for wrong shapes or radii that are not positive.

    >>> from jaxtat.geometry import DetectorPoints
    >>> ball, z = Balls([[0.0, 0.0, 0.0]], [0.5]), DetectorPoints([[0.0, 0.0, 1.0]])
    >>> g = ball.spherical_integrals(z, jnp.array([1.0]))[0, 0]  # a cap 1/8 high: 2π r/8
    >>> round(float(g / jnp.pi), 12)
    0.25
    """

    def __init__(self, centers: Numbers, radii: Numbers, amplitudes: Numbers | None = None):
        super().__init__(centers, radii, amplitudes)

    def _profile(self, t: Array) -> Array:
        return jnp.where(t < 1, 1.0, 0.0)

    def _moment(self, t: Array) -> Array:
        return (1 - t) * (1 + t) / 2

    def _hankel(self, k: Array) -> Array:
        # j_1(k)/k = (j_0(k) + j_2(k))/3
        j, _ = spherical_sequence(2, k)
        return (j[0] + j[2]) / 3


class SolidBells(SolidPhantom):
    """Sum of the paper's C_0^8 bells, in space: f(x) = Σ_m a_m h(|x - c_m| / r_m).

    Arguments as for `Balls`; h as in `jaxtat.phantoms.Bells`.

    >>> float(SolidBells([[0.3, 0.3, 0.0]], [0.55])(jnp.array([0.3, 0.3, 0.0])))
    1.0
    """

    def __init__(self, centers: Numbers, radii: Numbers, amplitudes: Numbers | None = None):
        super().__init__(centers, radii, amplitudes)

    def _profile(self, t: Array) -> Array:
        return jnp.where(t < 1, sin8_integral(1 - jnp.minimum(t, 1.0)), 0.0)

    def _moment(self, t: Array) -> Array:
        # ∫_0^{1-t} h(1 - v) (1 - v) dv, term by term of the series of `sin8_integral`:
        # ∫_0^u sin(k v) (1 - v) dv = (1 - (1 - u) cos(k u)) / k - sin(k u) / k²
        u = 1 - t
        total = u**2 / 2 - u**3 / 3
        for wave, amplitude in ((1, -56.0), (2, 14.0), (3, -8 / 3), (4, 0.25)):
            k = 2 * np.pi * wave
            part = (1 - t * jnp.cos(k * u)) / k - jnp.sin(k * u) / k**2
            total += amplitude / (70 * np.pi) * part
        return total

    def _hankel(self, k: Array) -> Array:
        nodes, weights = gauss_legendre(512)  # resolves k up to several hundred
        t = jnp.asarray((nodes + 1) / 2)
        j0 = jnp.sinc(k[..., None] * t / jnp.pi)
        return j0 @ (weights * self._profile(t) * t**2 / 2)
