"""Penalties P(f), which are added to the misfit of the data.

All but `Ridge` are P(f) = Σ_i h(|(D f)_i|), with D a linear map to differences, (D f)_i all of them
at pixel i, and h(t) = t beyond a small delta and t²/2 delta + delta/2 below (Huber's function): so
the image that minimises is a smooth function of the data.
"""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.checks import real_array, require_positive
from ..special import root


class Penalty(eqx.Module):
    """P(f), of images (..., x1, x2) or volumes (..., x1, x2, x3).

    P is a sum of norms of D f: a subclass has ``parts``, the linear map D, and ``order``, of the
    differences in it.

    Attributes:
        smoothing: delta, as a fraction of the image's size (`model_based` says which).
        joint: whether the images of a stack share their edges: |.| goes over all of them.
        needs_floor: of a kind; whether a weight that is found must not fall with the noise.
        order: of a kind, of its differences.
    """

    needs_floor: ClassVar[bool] = True
    order: ClassVar[int] = 1
    smoothing: Float[Array, ""] = eqx.field(
        converter=lambda value: real_array("smoothing", value, ()), default=1e-3, kw_only=True
    )
    joint: bool = eqx.field(static=True, default=False, kw_only=True)

    def __check_init__(self) -> None:
        require_positive("smoothing", self.smoothing)

    @abc.abstractmethod
    def parts(self, images: Float[Array, "stack *space"]) -> Float[Array, "parts stack *space"]:
        """D f, of each pixel of each image."""

    def sizes(self, parts: Float[Array, "parts stack *space"]) -> Float[Array, "_ _ *space"]:
        """|(D f)_i|, with derivative 0 at 0."""
        return root(jnp.sum(parts**2, axis=(0, 1) if self.joint else 0, keepdims=True))

    def value(
        self, images: Float[Array, "stack *space"], delta: Float[Array, ""] | float
    ) -> Float[Array, ""]:
        """P(f) with its corner rounded off below delta [unit of f]."""
        sizes = self.sizes(self.parts(images))
        below = sizes**2 / (2 * delta) + delta / 2
        return jnp.sum(jnp.where(sizes > delta, sizes, below))

    def shrunk(
        self,
        parts: Float[Array, "parts stack *space"],
        weight: Float[Array, ""] | float,
        delta: Float[Array, ""] | float,
    ) -> Float[Array, "parts stack *space"]:
        """The u that minimises |u - parts|² / 2 + weight Σ h(|u|): shorter by the weight."""
        sizes = self.sizes(parts)
        kept = 1 - weight / jnp.where(sizes > 0, sizes, 1.0)
        return parts * jnp.where(sizes > weight + delta, kept, delta / (delta + weight))


class TotalVariation(Penalty):
    """P(f) = Σ √((d_1 f)² + (d_2 f)²), differences to the next pixel, for images with edges.

    The length of all edges times their height. With ``joint=True`` the root is taken over a whole
    stack, such as wavelengths: they share their edges.

    Source: Rudin, Osher and Fatemi, Physica D 60 (1992) 259-268; joint: Blomgren and Chan, IEEE
    Trans. Image Process. 7 (1998) 304-309.

    >>> step = jnp.zeros((1, 4, 6)).at[..., 3:].set(2.0)
    >>> round(float(TotalVariation().value(step, 1e-12)), 9)  # height times length
    8.0
    """

    def parts(self, images: Array) -> Array:
        axes = range(1, images.ndim)
        return jnp.stack([_forward(images, axis) for axis in axes])


class SecondOrderVariation(Penalty):
    """P(f) = Σ √((d_11 f)² + 2 (d_12 f)² + (d_22 f)²): for smooth images.

    Slopes stay slopes, where total variation makes steps of them; edges are less sharp.

    Source: Lysaker, Lundervold and Tai, IEEE Trans. Image Process. 12 (2003) 1579-1590.
    """

    needs_floor: ClassVar[bool] = False
    order: ClassVar[int] = 2

    def parts(self, images: Array) -> Array:
        axes = range(1, images.ndim)
        first = [_forward(images, axis) for axis in axes]
        mixed = [
            (1.0 if i == j else jnp.sqrt(2.0))
            * (_backward if i == j else _forward)(first[i], j + 1)
            for i in range(len(first))
            for j in range(i, len(first))
        ]
        return jnp.stack(mixed)


class Ridge(eqx.Module):
    """P(f) = ||f||² / 2, for images of least norm.

    Source: Hoerl and Kennard, Technometrics 12 (1970) 55-67.
    """

    order: ClassVar[int] = 0


class NoPenalty(eqx.Module):
    """P(f) = 0: the data alone, with f >= 0 if asked."""

    order: ClassVar[int] = 0


def is_known(penalty: Any) -> bool:
    """Whether it is a penalty of this file, smooth and the same on all grids, or a user's map."""
    return isinstance(penalty, Penalty | Ridge | NoPenalty)


def _forward(images: Array, axis: int) -> Array:
    """Difference to the next pixel, 0 at the last."""
    last = jnp.take(images, jnp.array([-1]), axis)
    return jnp.diff(images, axis=axis, append=last)


def _backward(images: Array, axis: int) -> Array:
    """Difference to the pixel before, 0 at the first."""
    first = jnp.take(images, jnp.array([0]), axis)
    return jnp.diff(images, axis=axis, prepend=first)
