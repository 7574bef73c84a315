"""Phantoms whose image, circular integrals, Radon projections and Fourier transform are exact.

Both kinds are sums over m radial parts, f(x) = Σ_m a_m b(|x - c_m| / r_m) with b = 0 beyond 1, so
all four quantities are sums over parts of one function of the distance to the part's centre.
"""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ..base.checks import Numbers, real_array, require_objects, require_positive
from ..base.hashable_methods import compiled
from ..base.rows import map_rows
from ..geometry import DetectorCurve, ImageGrid
from ..special import j0, j1, root
from .radial import RadialParts, gauss_legendre, length_of, sin8_integral


class Phantom(RadialParts):
    """Σ_m a_m b(|x - c_m| / r_m) in the plane, see `Disks` for the arguments."""

    dimension = 2

    def __init__(self, centers: Numbers, radii: Numbers, amplitudes: Numbers | None = None):
        super().__init__(centers, radii, amplitudes)

    @abstractmethod
    def _arc_integral(self, distance: Array, r: Array, part_radius: Array) -> Array:
        """Integral of b(|x| / part_radius) over a circle of radius r centred at ``distance``."""

    @abstractmethod
    def _line_integral(self, t: Array) -> Array:
        """∫ b(√(t² + y²)) dy, t >= 0."""

    @abstractmethod
    def _hankel(self, k: Array) -> Array:
        """∫_0^1 b(t) J_0(k t) t dt."""

    @compiled
    def image(self, grid: ImageGrid) -> Float[Array, "x1 x2"]:
        """f at the nodes of the grid, (x1, x2)."""
        require_objects(grid=grid)
        return self(grid.points)

    def circular_integrals(
        self, curve: DetectorCurve, radii: Numbers, *, n_nodes: int = 16
    ) -> Float[Array, "detectors radii"]:
        """g(z, r) = ∫_{|x - z| = r} f dl, exact up to rounding (quadrature below 1e-12 for bells).

        Args:
            curve: the detectors z.
            radii: r > 0, (radii,) [length].
            n_nodes: of elements of finite width it is the mean over so many nodes of each: enough
                for smooth parts as wide as an element.

        Returns:
            (detectors, radii) [length, for a dimensionless f].
        """

        require_objects(curve=curve)
        radii = real_array("radii", radii, ("radii",))
        require_positive("radii", radii)
        return self._circular_integrals(curve, radii, n_nodes)

    @eqx.filter_jit
    def _circular_integrals(self, curve: DetectorCurve, radii: Array, n_nodes: int = 16) -> Array:
        def of_detector(point: Array) -> Array:
            def one(center: Array, radius: Array, amplitude: Array) -> Array:
                distance = length_of(point - center)
                return amplitude * self._arc_integral(distance, radii, radius)

            return self._sum_over_parts(one)

        return curve.mean_over_elements(lambda points: map_rows(of_detector, points, 64), n_nodes)

    @compiled
    def radon(self, angles: Numbers, offsets: Numbers) -> Float[Array, "directions offsets"]:
        """p(theta, s) = ∫_{x·(cos theta, sin theta) = s} f dl, (directions, offsets) [length]."""
        angles, offsets = jnp.asarray(angles), jnp.asarray(offsets)
        normal = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)

        def one(center: Array, radius: Array, amplitude: Array) -> Array:
            t = jnp.abs(offsets[None, :] - (normal @ center)[:, None]) / radius
            return amplitude * radius * self._line_integral(t)

        return self._sum_over_parts(one)

    @compiled
    def fourier(
        self, frequencies: Numbers, angles: Numbers
    ) -> Complex[Array, "frequencies directions"]:
        """fhat(xi) = (1/2π) ∫ f(x) exp(-i xi·x) dx at xi = lambda (cos theta, sin theta).

        Args:
            frequencies: lambda >= 0, (frequencies,) [rad/length].
            angles: theta, (directions,) [rad].

        Returns:
            Complex, (frequencies, directions).
        """
        frequencies, angles = jnp.asarray(frequencies), jnp.asarray(angles)
        normal = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)

        def one(center: Array, radius: Array, amplitude: Array) -> Array:
            radial = radius**2 * self._hankel(radius * frequencies)
            phase = jnp.exp(-1j * frequencies[:, None] * (normal @ center)[None, :])
            return amplitude * radial[:, None] * phase

        return self._sum_over_parts(one)


class Disks(Phantom):
    """Sum of disks: f(x) = Σ_m a_m [|x - c_m| < r_m], all quantities in closed form.

    Args:
        centers: c_m, (parts, 2) [length].
        radii: r_m > 0, (parts,) [length].
        amplitudes: a_m, (parts,), ones by default.

    Raises:
        ValueError: for wrong shapes or radii that are not positive.

    >>> import jax.numpy as jnp
    >>> disk = Disks([[0.0, 0.0]], [0.5])
    >>> round(float(disk.radon(jnp.zeros(1), jnp.array([0.3]))[0, 0]), 12)  # 2 √(0.5² - 0.3²)
    0.8
    """

    def __init__(self, centers: Numbers, radii: Numbers, amplitudes: Numbers | None = None):
        super().__init__(centers, radii, amplitudes)

    def _profile(self, t: Array) -> Array:
        return jnp.where(t < 1, 1.0, 0.0)

    def _arc_integral(self, distance: Array, r: Array, part_radius: Array) -> Array:
        return 2 * r * _half_angle(distance, r, part_radius)

    def _line_integral(self, t: Array) -> Array:
        inside = t < 1
        return jnp.where(inside, 2 * jnp.sqrt(jnp.where(inside, 1 - t**2, 1.0)), 0.0)

    def _hankel(self, k: Array) -> Array:
        small = k < 1e-4  # J_1(k)/k = 1/2 - k²/16 + ...
        safe = jnp.where(small, 1.0, k)
        return jnp.where(small, 0.5 - k**2 / 16, j1(safe) / safe)


class Bells(Phantom):
    """Sum of the paper's C_0^8 bells: f(x) = Σ_m a_m h(|x - c_m| / r_m).

    Arguments as for `Disks`.

    h(t) = I(1 - t) / I(1), I(u) = ∫_0^u sin^8(π v) dv, for t <= 1. The integral of a bell over an
    arc or a line and its Hankel transform are Gauss-Legendre sums; h is a polynomial in t and
    trigonometric functions with a ninth-order zero at t = 1, so they converge fast.

    Source: Kunyansky 2008, section 4.

    >>> float(Bells([[0.3, 0.3]], [0.55])(jnp.array([0.3, 0.3])))
    1.0
    """

    def __init__(self, centers: Numbers, radii: Numbers, amplitudes: Numbers | None = None):
        super().__init__(centers, radii, amplitudes)

    def _profile(self, t: Array) -> Array:
        return jnp.where(t < 1, sin8_integral(1 - jnp.minimum(t, 1.0)), 0.0)

    def _arc_integral(self, distance: Array, r: Array, part_radius: Array) -> Array:
        nodes, weights = gauss_legendre(96)
        a = _half_angle(distance, r, part_radius)
        phi = a[:, None] * (nodes + 1) / 2
        # |x - c|² = (d - r)² + 4 d r sin²(phi/2), free of cancellation
        t2 = (distance - r[:, None]) ** 2 + 4 * distance * r[:, None] * jnp.sin(phi / 2) ** 2
        values = self._profile(root(t2) / part_radius)
        return 2 * r * (a / 2) * (values @ weights)

    def _line_integral(self, t: Array) -> Array:
        nodes, weights = gauss_legendre(96)
        half = root(jnp.maximum(1 - t**2, 0.0))
        y = half[..., None] * (nodes + 1) / 2
        return half * (self._profile(root(t[..., None] ** 2 + y**2)) @ weights)

    def _hankel(self, k: Array) -> Array:
        nodes, weights = gauss_legendre(512)  # resolves k up to several hundred
        t = jnp.asarray((nodes + 1) / 2)
        return j0(k[:, None] * t) @ (weights * self._profile(t) * t / 2)


def noise_like(key: Array, data: Array, level: Numbers) -> Array:
    """White Gaussian noise with ||noise|| = level * ||data|| in the 2-norm.

    Args:
        key: a jax.random key.
        data: any real array.
        level: relative size, 0.15 for 15 %.

    Returns:
        Array of the shape of ``data``.
    """
    level = real_array("level", level, ())
    noise = jax.random.normal(key, data.shape, data.dtype)
    return noise * (level * jnp.linalg.norm(data.ravel()) / jnp.linalg.norm(noise.ravel()))


def _half_angle(distance: Array, r: Array, part_radius: Array) -> Array:
    """Half the angle of that part of a circle (r, at ``distance``) inside a disk at the origin."""
    product = 4 * distance * r
    # sin²(angle/2), in factors that do not cancel for a small part far away
    gap = distance - r
    square = (part_radius - gap) * (part_radius + gap) / jnp.where(product > 0, product, 1.0)
    concentric = jnp.where(r < part_radius, jnp.pi, 0.0)
    proper = (square > 0) & (square < 1)
    angle = 2 * jnp.arcsin(jnp.sqrt(jnp.where(proper, square, 0.25)))
    whole_or_none = jnp.where(square >= 1, jnp.pi, 0.0)
    return jnp.where(product > 0, jnp.where(proper, angle, whole_or_none), concentric)
