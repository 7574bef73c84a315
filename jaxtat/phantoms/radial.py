"""Sums of radially symmetric parts, and integrals of their profiles."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, real_array, require_positive, whole_number
from ..base.hashable_methods import ComparedByIdentity
from ..special import root


class RadialParts(ComparedByIdentity, eqx.Module):
    """Σ_m a_m b(|x - c_m| / r_m) in the plane or in space, see `Disks` for the arguments."""

    centers: Float[Array, "parts dimension"]
    radii: Float[Array, " parts"]
    amplitudes: Float[Array, " parts"]

    dimension: ClassVar[int]

    def __init__(self, centers: Numbers, radii: Numbers, amplitudes: Numbers | None = None):
        self.centers = real_array("centers", centers, ("parts", self.dimension))
        n = whole_number("the number of parts", self.centers.shape[0], 1)
        self.radii = real_array("radii", radii, (n,))
        self.amplitudes = real_array(
            "amplitudes", jnp.ones(n) if amplitudes is None else amplitudes, (n,)
        )
        require_positive("radii", self.radii)

    @abstractmethod
    def _profile(self, t: Array) -> Array:
        """b(t), t >= 0."""

    @eqx.filter_jit
    def __call__(self, points: Numbers) -> Array:
        """f at any points, (..., dimension) [length]; returns (...)."""
        points = jnp.asarray(points)

        def one(center: Array, radius: Array, amplitude: Array) -> Array:
            return amplitude * self._profile(length_of(points - center) / radius)

        return self._sum_over_parts(one)

    def _sum_over_parts(self, one) -> Array:
        def add(total, part):
            return total + one(*part), None

        parts = (self.centers, self.radii, self.amplitudes)
        shape = jax.eval_shape(one, *(leaf[0] for leaf in parts))
        return jax.lax.scan(add, jnp.zeros(shape.shape, shape.dtype), parts)[0]


def sin8_integral(u: Array) -> Array:
    """I(u)/I(1) from sin^8 a = (35 - 56 cos 2a + 28 cos 4a - 8 cos 6a + cos 8a) / 128.

    Where u is small the terms cancel; the exact value is below (πu)^9 and so is the rounding.
    """
    a = 2 * jnp.pi * u
    waves = -56 * jnp.sin(a) + 14 * jnp.sin(2 * a) - 8 / 3 * jnp.sin(3 * a) + jnp.sin(4 * a) / 4
    return u + waves / (70 * jnp.pi)


def length_of(difference: Array) -> Array:
    return root(jnp.sum(difference**2, axis=-1))


def gauss_legendre(n: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(n)
