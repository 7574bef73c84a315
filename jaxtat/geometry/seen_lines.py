"""Visibility: which lines through the region of interest meet the acquisition curve.

An edge in the image sends a wave along its normal, both ways. It is recorded, and can be
reconstructed stably, if the line along that normal meets the curve. The paper's theorem asks that
every line through the region does.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import is_concrete, require_objects
from .curves import DetectorCurve
from .measured_curves import behind_gap
from .regions import Region


class VisibilityWarning(UserWarning):
    """Some lines through the region of interest meet no detector: edges along them are lost."""


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


def visibility(
    curve: DetectorCurve, region: Region, n_angles: int = 360, n_offsets: int = 1000
) -> Visibility:
    """Share of lines {x: x·w = s} through the region that miss the curve.

    A connected piece of the curve meets the line exactly if min z·w <= s <= max z·w over its
    detectors (intermediate values), so for each direction w only shadows on an axis are compared.
    The curve falls into pieces at steps more than four times as wide as those beside them; each
    piece is taken to reach half a detector spacing beyond its end detectors.

    Args:
        curve, region: the geometry, concrete.
        n_angles: number of directions w over half a turn.
        n_offsets: number of lines across the region in each direction.

    Returns:
        Visibility.

    Raises:
        ValueError: for a traced geometry.

    >>> from jaxtat import circular_arc, disk
    >>> half = circular_arc(1.3, 0.0, 500)
    >>> print(visibility(half, disk(1.0, 0.0, n_boundary=1000)))
    every line through the region meets the curve
    >>> print(float(visibility(half, disk(1.0, n_boundary=1000)).invisible_fraction) > 0.1)
    True
    """
    require_objects(curve=curve, region=region)
    if not is_concrete(curve, region):
        raise ValueError(
            "curve and region are traced, expected known ones: visibility counts lines. "
            "transverse_weight and visibility_map can be traced."
        )
    angles = np.arange(n_angles) * np.pi / n_angles
    w = np.stack([np.cos(angles), np.sin(angles)])
    low, high = _shadow(np.asarray(region.points), w)
    inner = (np.arange(n_offsets) + 0.5) / n_offsets
    offsets = low[:, None] + (high - low)[:, None] * inner
    through = _covered(offsets, [np.asarray(part.points) for part in region.components], w)
    missed = through & ~_covered(offsets, connected_pieces(curve), w)
    share = missed.mean(axis=1)
    # two lines in a thousand are the sampling of boundary and curve
    missing = np.where(share * n_offsets <= 2, 0.0, share) * (high - low)
    fraction = missing.sum() / (through.mean(axis=1) * (high - low)).sum()
    return Visibility(*jax.device_put((fraction, angles, missing)))


def _covered(offsets: np.ndarray, parts: list[np.ndarray], w: np.ndarray) -> np.ndarray:
    """Which lines meet one of several connected parts."""
    meets = np.zeros(offsets.shape, bool)
    for part in parts:
        first, last = _shadow(part, w)
        meets |= (offsets >= first[:, None]) & (offsets <= last[:, None])
    return meets


def _shadow(points: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    offsets = points @ w
    return offsets.min(axis=0), offsets.max(axis=0)


def connected_pieces(curve: DetectorCurve) -> list[np.ndarray]:
    """Connected pieces of the curve, each with its two tips."""
    points = np.asarray(curve.points)
    steps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    wide = behind_gap(steps, curve.closed)
    if not wide.any():
        return [np.concatenate([points, points[:1]])]
    after = (np.flatnonzero(wide) + 1) % len(points)
    turned = np.roll(points, -after[-1], axis=0)
    return [_with_tips(p) for p in np.split(turned, np.sort((after - after[-1]) % len(points))[1:])]


def _with_tips(points: np.ndarray) -> np.ndarray:
    """A piece that reaches half a step beyond its end detectors."""
    if len(points) < 2:
        return points
    first = points[0] + (points[0] - points[1]) / 2
    last = points[-1] + (points[-1] - points[-2]) / 2
    return np.concatenate([first[None], points, last[None]])
