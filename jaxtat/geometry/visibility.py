"""Visibility: which lines through the region of interest meet the acquisition curve.

An edge in the image sends a wave along its normal, both ways. It is recorded, and can be
reconstructed stably, if the line along that normal meets the curve. The paper's theorem asks that
every line through the region does.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .curves import DetectorCurve
from .regions import Region


class VisibilityWarning(UserWarning):
    """Part of the region of interest sends waves that no detector records."""


class Visibility(eqx.Module):
    """How much of a region a curve sees.

    Attributes:
        invisible_fraction: share of the lines through the region that miss the curve.
        angles: directions of the lines' normals, (lines,) [rad].
        invisible_width: for each, the width of the region's shadow that no line from the curve
            covers, (lines,) [length].
    """

    invisible_fraction: Float[Array, ""]
    angles: Float[Array, " lines"]
    invisible_width: Float[Array, " lines"]

    def __str__(self) -> str:
        worst = jnp.argmax(self.invisible_width)
        if self.invisible_fraction == 0:
            return "every line through the region meets the curve"
        return (
            f"{100 * float(self.invisible_fraction):.2g} % of the lines through the region miss "
            f"the curve; worst are those with normal at "
            f"{float(jnp.degrees(self.angles[worst])):.0f} degrees, over a width of "
            f"{float(self.invisible_width[worst]):.3g}"
        )


def visibility(curve: DetectorCurve, region: Region, n_angles: int = 360) -> Visibility:
    """Share of lines {x: x·w = s} through the region that miss a connected curve.

    A connected curve meets the line exactly if min_k z_k·w <= s <= max_k z_k·w (intermediate
    values), so for each direction w only two shadows on an axis are compared. The curve is taken
    to reach half a detector spacing beyond its end detectors.

    Args:
        curve, region: the geometry.
        n_angles: number of directions w over half a turn.

    Returns:
        Visibility.

    >>> from jaxtat import circular_arc, truncated_disk
    >>> half = circular_arc(1.3, 0.0, 500)
    >>> print(visibility(half, truncated_disk(1.0, 0.0, 1000)))
    every line through the region meets the curve
    >>> print(float(visibility(half, truncated_disk(1.0, 1.0, 1000)).invisible_fraction) > 0.1)
    True
    """
    angles = jnp.arange(n_angles) * jnp.pi / n_angles
    w = jnp.stack([jnp.cos(angles), jnp.sin(angles)])
    seen = _shadow(curve.points, w)
    if not curve.closed:
        seen = _shadow(jnp.concatenate([curve.points, _tips(curve)]), w)
    shadow = _shadow(region.points, w)
    below = jnp.clip(seen[0] - shadow[0], 0, shadow[1] - shadow[0])
    above = jnp.clip(shadow[1] - seen[1], 0, shadow[1] - shadow[0])
    missing = jnp.minimum(below + above, shadow[1] - shadow[0])
    # below a thousandth of the region's width it is the sampling of the two curves
    missing = jnp.where(missing < 1e-3 * region.reach, 0.0, missing)
    fraction = missing.sum() / (shadow[1] - shadow[0]).sum()
    return Visibility(fraction, angles, missing)


def _shadow(points: Array, w: Array) -> tuple[Array, Array]:
    offsets = points @ w
    return offsets.min(axis=0), offsets.max(axis=0)


def _tips(curve: DetectorCurve) -> Array:
    """The two ends of an open curve, half a step beyond its end detectors."""
    first, second, *_ = curve.points
    *_, before_last, last = curve.points
    return jnp.stack([first + (first - second) / 2, last + (last - before_last) / 2])
