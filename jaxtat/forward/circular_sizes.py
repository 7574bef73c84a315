"""Sizes of the fast integrals over circles, chosen once from concrete positions."""

from bisect import bisect_left
from dataclasses import replace
from itertools import pairwise
from typing import Any

import equinox as eqx
import numpy as np
import scipy.special
from jaxtyping import Float

from ..base.checks import is_concrete
from ..base.size_ladder import rung
from ..geometry import (
    Body,
    CircularArc,
    DetectorCurve,
    DiskBody,
    ImageGrid,
    OutlineBody,
    Region,
    circle_through,
)
from ..geometry.circles import ROUNDING
from ..geometry.elements import enough_nodes
from .circular_harmonics import LARGE, turn_for

# Of a body's radius, up to which images are taken at least: all of a region that may reach to 1.25
# has orders enough, and beyond it the waves of the body grow without meaning.
IN_BODY = 1.1
ECHOES = 2.0  # radii of a body after the last direct wave, before the period ends
MARGIN = 1.04  # of the period over the farthest pixel from a detector: positions may change by that
# at most so many groups of frequencies with as many orders; off a circle each has its own table
GROUPS, GROUPS_OFF_CIRCLE = 8, 4
WORTH_A_GROUP = 60  # frequencies: each group is compiled by itself
LEFT_OUT = 1e-11  # of waves about the detectors' circle, where Y is large


class CircleSizes(eqx.Module):
    """Frequencies and orders of `CircleIntegrals`.

    Attributes:
        period: T, beyond which no circle about a detector meets the image [length].
        n_frequencies: of the zeros j_k of J_0 with about j_k / T <= π / pixel.
        groups: (first, last + 1, highest order M, directions over a whole turn, highest order
            about the detectors' circle) of frequencies that share them. The last is 0 where waves
            are not moved there, see `circular_harmonics`.
        n_nodes: on elements of finite width.
        reach: of the image from the centre of the waves, times its frequencies over lambda
            [length].
        ratio: those frequencies over lambda: c_2/c_1 of a body, else 1.
        moved: from the centre of the waves to that of the detectors' circle, and the least radius
            of this; none where waves are not moved [length].
    """

    period: float = eqx.field(static=True)
    n_frequencies: int = eqx.field(static=True)
    groups: tuple[tuple[int, int, int, int, int], ...] = eqx.field(static=True)
    n_nodes: int = eqx.field(static=True)
    reach: float = eqx.field(static=True)
    ratio: float = eqx.field(static=True)
    moved: tuple[float, ...] = eqx.field(static=True, default=())

    def with_period(self, period: float) -> "CircleSizes":
        """As many frequencies more as another period needs up to the same highest one."""
        n, period = _on_ladder(period, float(self.frequencies[-1]))
        groups = _groups(zeros_of_j0(n) / period, self.reach, len(self.groups), self.moved)
        return replace(self, period=period, n_frequencies=n, groups=groups)

    def with_fewer_orders(self) -> "CircleSizes":
        """Orders up to where J_m(x) is below 1e-5, x to 400, for criteria of outlines.

        Equations at an outline take as much as the cube of the highest order.
        """
        groups = []
        for first, last, orders, turn, outer in self.groups:
            x = float(self.frequencies[last - 1]) * self.reach
            groups.append((first, last, min(orders, int(x + 3 * np.cbrt(x) + 8)), turn, outer))
        return replace(self, groups=tuple(groups))

    @property
    def zeros(self) -> Float[np.ndarray, " frequencies"]:
        """j_k, the zeros of J_0."""
        return zeros_of_j0(self.n_frequencies)

    @property
    def frequencies(self) -> Float[np.ndarray, " frequencies"]:
        """lambda_k = j_k / T [rad/length]."""
        return self.zeros / self.period

    @property
    def highest(self) -> float:
        """Up to which images have a spectrum [rad/length]."""
        return self.ratio * float(self.frequencies[-1])

    def first(self, n: int) -> "CircleSizes":
        """The sizes of the first n frequencies alone, for an image on coarser pixels."""
        groups = tuple((a, min(b, n), *more) for a, b, *more in self.groups if a < n)
        return replace(self, n_frequencies=n, groups=groups)


def circle_sizes(
    curve: DetectorCurve,
    grid: ImageGrid,
    medium: Body | None = None,
) -> CircleSizes:
    """The sizes of a concrete geometry: T by its farthest pixel, orders by the image's reach.

    Numbers of frequencies and orders are on the ladder, and T is as long as goes with them.

    The circular harmonics of the transform of an image that reaches to |x - c| <= a are those of
    J_m(lambda a), which fall faster than exponentially from m = lambda a on.

    Through a body lambda is that of the water: the image has c_2/c_1 times as many waves.
    """
    half_width, center = np.asarray(grid.half_width), np.asarray(grid.center)
    spacing, points = np.asarray(grid.spacing), np.asarray(curve.points)
    corners = center + half_width * np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    reach = farthest = 0.0
    ratio, slow, moved = 1.0, 1.0, ()
    circle = _circle_center(curve)
    centers = _centers(curve, circle, center, medium)
    if medium is not None:
        moved = _moved(curve, circle, medium)
        ratio = 1 / float(medium.speed_ratio)
        slow = max(1.0, ratio)
    for about in centers:
        reach = max(reach, float(np.hypot(*(corners - about).T).max()))
        farthest = max(farthest, float(np.hypot(*(points - about).T).max()))
    period = farthest + reach
    if medium is not None:
        reach = min(reach, IN_BODY * float(medium.radius))
        period = farthest + slow * reach + ECHOES * float(medium.radius)
    period, highest = MARGIN * period, np.pi / float(spacing.max()) / ratio
    n, period = _on_ladder(period, highest)
    off = circle is None or isinstance(medium, OutlineBody)
    most = GROUPS_OFF_CIRCLE if off else GROUPS
    n_groups = min(most, 1 + n // WORTH_A_GROUP)
    groups = _groups(zeros_of_j0(n) / period, ratio * reach, n_groups, moved)
    # more than densities need: the error is 1e-9 instead of 5e-6
    n_nodes = 1 if curve.element_width is None else 4 + enough_nodes(curve.element_width, highest)
    return CircleSizes(period, n, groups, n_nodes, ratio * reach, ratio, moved)


def sizes_inside(
    sizes: CircleSizes,
    curve: DetectorCurve,
    grid: ImageGrid,
    region: Region,
    medium: Body | None = None,
) -> CircleSizes:
    """The same frequencies with the orders of images that are zero outside a region.

    A disk reaches less far than the square about it. With traced positions the sizes as they are.
    """
    if not is_concrete(curve, grid, region, medium):
        return sizes
    centers = _centers(curve, _circle_center(curve), np.asarray(grid.center), medium)
    away = max(float(np.hypot(*(np.asarray(region.center) - about))) for about in centers)
    reach = min(sizes.reach, sizes.ratio * (away + float(np.asarray(region.reach))))
    frequencies, groups = sizes.frequencies, []
    for first, last, _, _, outer in sizes.groups:
        orders = rung(highest_order(float(frequencies[last - 1]) * reach))
        groups.append((first, last, orders, turn_for(orders), outer))
    return replace(sizes, reach=reach, groups=tuple(groups))


def _centers(curve: DetectorCurve, circle: Any, center: Any, medium: Body | None) -> list[Any]:
    """About which waves are taken, of known positions and of traced ones."""
    if medium is not None:
        return [np.asarray(medium.center)]
    if circle is None:
        return [center]
    return [circle] if isinstance(curve, CircularArc) else [circle, center]


def _moved(curve: DetectorCurve, circle: Any, medium: Body) -> tuple[float, ...]:
    """`CircleSizes.moved`, with room for other positions."""
    if circle is None or not isinstance(medium, DiskBody):
        return ()
    away = float(np.hypot(*(circle - np.asarray(medium.center))))
    radius = float(np.hypot(*(np.asarray(curve.points) - circle).T).min())
    return () if away <= ROUNDING * radius else (MARGIN * away, radius)


def _on_ladder(period: float, highest: float) -> tuple[int, float]:
    """How many frequencies there are up to the highest one, and the period, no shorter, of them."""
    most = highest * period
    n = rung(max(1, int(np.sum(zeros_of_j0(int(most / np.pi) + 2) <= most))))
    return n, max(period, float(zeros_of_j0(n)[-1]) / highest)


def _groups(
    frequencies: Float[np.ndarray, " frequencies"],
    reach: float,
    n_groups: int,
    moved: tuple[float, ...],
) -> tuple[tuple[int, int, int, int, int], ...]:
    n = len(frequencies)
    low = 0 if not moved else _first_moved(frequencies, reach + moved[0], moved[1])
    bounds = np.linspace(low, n, n_groups + 1).round().astype(int)
    groups = []
    for first, last in pairwise(np.unique([0, *bounds])):
        highest = float(frequencies[last - 1])
        orders, outer = rung(highest_order(highest * reach)), 0
        if moved and last > low:
            outer = rung(highest_order(highest * (reach + moved[0])))
        groups.append((int(first), int(last), orders, turn_for(orders), outer))
    return tuple(groups)


def _first_moved(
    frequencies: Float[np.ndarray, " frequencies"], reach: float, radius: float
) -> int:
    """From which frequency on orders with a large Y_n(k radius) have a J_n(k reach) of nothing."""

    def exact(frequency: float) -> bool:
        n = np.arange(highest_order(frequency * max(reach, radius)) + 1)
        large = scipy.special.yv(n, frequency * radius) < -LARGE
        lost = np.abs(scipy.special.jv(n, frequency * reach))[large]
        return bool(LARGE * lost.max(initial=0.0) < LEFT_OUT)

    return bisect_left(frequencies, True, key=exact)


def highest_order(x: float) -> int:
    """The order from which on J_m(x) is below 1e-12: DLMF 10.19.8; faster decay for small x."""
    return int(np.ceil(x + 6 * np.cbrt(x) + 10))


def zeros_of_j0(n: int) -> Float[np.ndarray, " n"]:
    """The first n zeros of J_0, by McMahon's series (DLMF 10.21.19) and Newton's method."""
    b = (np.arange(n) + 0.75) * np.pi
    zeros = b + 1 / (8 * b) - 31 / (384 * b**3)
    for _ in range(2):
        zeros = zeros + scipy.special.j0(zeros) / scipy.special.j1(zeros)
    return zeros


def _circle_center(curve: DetectorCurve) -> Any:
    """Centre of the circle on which the detectors lie; None if they lie on none."""
    if isinstance(curve, CircularArc):
        return np.asarray(curve.center)
    circle = circle_through(curve)
    return None if circle is None else np.asarray(circle.center)
