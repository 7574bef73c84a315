"""What of a problem in space is a size: decided once, outside of `jax.jit`."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete
from ..densities.cylindrical_waves.orders import highest_orders
from ..forward import SphereSizes, sphere_sizes
from ..geometry import (
    BallBody,
    DetectorCurve,
    DiskBody,
    VolumeGrid,
    around_body,
    data_radii,
    require_radii,
    require_surrounded,
    uncovered,
)
from ..geometry.balls import Ball, enough_boundary
from ..geometry.caps import DetectorPoints, Detectors, SphericalCap
from ..steps import polar_grid, require_pixels, warn_of_detectors
from .visible import covered_share, warn_of_visibility

NEAR = 0.99  # of a detector's distance, which the region may not reach
MOST_GROUPS = 4  # of frequencies: one table of detectors' moments is in memory for each
MOST_SIZES = 10  # of systems; each is compiled by itself, which small problems do not repay
TABLE = 2**22  # entries of a table of Legendre functions, of some orders m at a time
LEAST_FREQUENCIES = 8  # with fewer the projections between the stages of step 5 are cut short
OF_FITS = 1e-6  # of what is left out of the waves of a volume that is fitted, as for its FFTs
PLANES = 64  # meridian planes inverted together, which bounds the memory


class SpaceSizes(eqx.Module):
    """Everything about a reconstruction in space that is a size, and so cannot be traced.

    Attributes:
        max_frequency: lambda_max [rad/length].
        groups: highest degree l of each group of neighbouring frequencies.
        in_group: frequencies in each group.
        n_directions: of the meridian planes, and in each of them, over half a turn.
        n_orders: m = 0 .. n_orders - 1.
        piece: how many orders m are worked on together.
        n_sizes: of the systems; numbers of degrees are rounded up to one of them.
        operator: of the forward operator.
        inside: of that on volumes that are zero outside the region, for fits.
        n_nodes: of Gauss's rule on an element of finite size.
        boundary: Gauss points on both parts of a meridian of a cut ball; none of a whole one.
    """

    max_frequency: float = eqx.field(static=True)
    groups: tuple[int, ...] = eqx.field(static=True)
    in_group: int = eqx.field(static=True)
    n_directions: int = eqx.field(static=True)
    n_orders: int = eqx.field(static=True)
    piece: int = eqx.field(static=True)
    n_sizes: int = eqx.field(static=True)
    operator: SphereSizes
    inside: SphereSizes
    n_nodes: int = eqx.field(static=True)
    boundary: tuple[int, int] | None = eqx.field(static=True)

    @property
    def n_frequencies(self) -> int:
        return len(self.groups) * self.in_group

    @property
    def frequency_step(self) -> float:
        """d lambda [rad/length]."""
        return self.max_frequency / self.n_frequencies

    @property
    def frequencies(self) -> Float[Array, " frequencies"]:
        """lambda_i = i d lambda, i >= 1 [rad/length]."""
        return self.frequency_step * jnp.arange(1, self.n_frequencies + 1)

    @property
    def n_pieces(self) -> int:
        return -(-self.n_orders // self.piece)

    @property
    def degrees(self) -> tuple[tuple[int, ...], ...]:
        """How many degrees l = m, m + 1, ... there are, for every group and piece; 0 for none."""
        most = self.groups[-1] + 1
        step = -(-self.n_pieces // self.n_sizes) * self.piece

        def rounded(needed: int) -> int:
            smaller = min((most - needed) // step, self.n_sizes - 1)
            return most - smaller * step if needed > 0 else 0

        firsts = range(0, self.n_pieces * self.piece, self.piece)
        return tuple(tuple(rounded(l_max + 1 - m) for m in firsts) for l_max in self.groups)


def space_sizes(
    detectors: Detectors,
    region: Ball,
    grid: VolumeGrid,
    radii: Float[Array, " radii"],
    max_frequency: Numbers | None,
    n_directions: int | None,
    n_groups: int,
    medium: BallBody | None = None,
) -> tuple[SpaceSizes, Ball]:
    """Sizes of a concrete problem, which is checked, and the region.

    Args:
        n_groups: of frequencies, at most.

    Warns:
        VisibilityWarning, AccuracyWarning: see `Setup`.
    """
    require_fitting(detectors, region, medium)
    with jax.ensure_compile_time_eval():  # of constants, inside jax.jit too
        disk, detectors = region.meridian, around_body(detectors, medium)
        require_radii(radii)
        outside = radii if medium is None else radii * medium.speed_ratio
        frequencies, angles = polar_grid(disk, grid, outside, max_frequency, n_directions)
        _require_nodes(region, grid)
        warn_of_visibility(detectors, region)
        n, highest, reach = len(frequencies), float(frequencies[-1]), float(region.radius)
        n_groups = min(n_groups, MOST_GROUPS, max(1, n // 8))
        ends = highest * np.arange(1, n_groups + 1) / n_groups
        distance = float(np.asarray(detectors.distance).min())
        orders = highest_orders(ends, reach, distance)
        n_orders = int(orders[-1]) + 1
        _warn_of_sampling(detectors, highest, reach)
        if isinstance(detectors, SphericalCap):
            n_orders = min(n_orders, detectors.n_azimuths // 2)
    n_degrees, points = int(orders[-1]) + 1, max(detectors.shape[0], len(angles) // 2 + 1)
    n_sizes = min(MOST_SIZES, max(1, n_degrees // 24 - 4))
    pieces = max(n_sizes, -(-n_orders * n_degrees * points // TABLE))
    boundary = None
    if not region.whole:
        boundary = enough_boundary(reach, float(region.cut), highest)
    sizes = SpaceSizes(
        max_frequency=highest,
        groups=tuple(int(order) for order in orders),
        in_group=max(-(-n // n_groups), LEAST_FREQUENCIES),
        n_directions=len(angles),
        n_orders=n_orders,
        piece=-(-n_orders // pieces),
        n_sizes=n_sizes,
        operator=sphere_sizes(detectors, grid, medium),
        inside=sphere_sizes(detectors, grid, medium, within=reach, tolerance=OF_FITS),
        n_nodes=detectors.enough_nodes(highest),
        boundary=boundary,
    )
    return sizes, region


def cap_radii(
    detectors: Detectors,
    region: Ball,
    step: Numbers,
    medium: BallBody | None = None,
    *,
    sources: Ball | None = None,
) -> Float[Array, " radii"]:
    """Equispaced radii that the data need, see `jaxtat.data_radii`.

    Half the step of the grid is right: G takes the product of the data and a kernel that both
    oscillate as fast as the grid allows.

    Args:
        detectors, region: the geometry, concrete.
        step: distance between radii [length].
        medium: a body of another speed of sound; radii are then paths in water that take as long.
        sources: where f may differ from zero, if that is not inside the region of interest.

    Raises:
        ValueError: for a step that is not above zero, or a traced geometry.

    >>> from jaxtat.geometry import ball, spherical_cap
    >>> radii = cap_radii(spherical_cap(1.3, 1.0, 48, 64), ball(1.0), 1 / 64)
    >>> radii.shape, round(float(radii[0]), 3), round(float(radii[-1]), 3)
    ((129,), 0.3, 2.3)
    """
    with jax.ensure_compile_time_eval():  # of constants, inside jax.jit too
        require_fitting(detectors, region, medium)
        more = None if sources is None else sources.meridian
        curve, section = _sections(detectors, medium)
        return data_radii(curve, region.meridian, step, sources=more, medium=section)


def uncovered_in_space(
    detectors: Detectors,
    region: Ball,
    radii: Float[Array, " radii"],
    medium: BallBody | None = None,
) -> str:
    """Text about spheres that meet the region but have no data, as `geometry.uncovered`."""
    curve, section = _sections(detectors, medium)
    return uncovered(curve, region.meridian, radii, section)


def _sections(
    detectors: Detectors, medium: BallBody | None
) -> tuple[DetectorCurve, DiskBody | None]:
    """Detectors and body in a plane through the axis; they have one centre."""
    curve = around_body(detectors, medium).meridian
    return curve, None if medium is None else medium.meridian


def require_fitting(detectors: Detectors, region: Ball, medium: BallBody | None = None) -> None:
    """Raise ValueError unless detectors, region and body share the centre of waves, and fit it."""
    waves = around_body(detectors, medium)
    if isinstance(waves, DetectorPoints) and not region.whole:
        raise ValueError(
            "a cut region needs detectors on rings, and a body about their centre that is not "
            "traced: use ball(radius)."
        )
    if not is_concrete(waves, region, medium):
        return
    offset = np.abs(np.asarray(waves.center) - np.asarray(region.center)).max()
    if offset > 1e-9 * float(region.radius):
        other = "detectors" if medium is None else "body"
        raise ValueError(
            f"the region is centred at {np.asarray(region.center)}, the {other} at "
            f"{np.asarray(waves.center)}: give both the same center."
        )
    with jax.ensure_compile_time_eval():  # of constants, inside jax.jit too
        if medium is not None:
            require_surrounded(waves, region, medium)
        _require_beyond(waves, region)


def _require_beyond(detectors: Detectors, region: Ball) -> None:
    """Raise ValueError unless all detectors are farther from the centre than the region reaches."""
    points, reach = np.asarray(detectors.points).reshape(-1, 3), float(region.radius)
    distance = np.linalg.norm(points - np.asarray(detectors.center), axis=1)
    near = np.flatnonzero(NEAR * distance <= reach)
    if near.size:
        raise ValueError(
            f"{near.size} of {len(points)} detectors are not outside of the region, which reaches "
            f"{reach:.6g} from its centre: the first is number {near[0]} at {points[near[0]]}, "
            f"{distance[near[0]]:.6g} from it. Shrink the region, leave these detectors out, and "
            "check that both use the same unit of length."
        )


def _require_nodes(region: Ball, grid: VolumeGrid) -> None:
    require_pixels(grid, float(region.radius))
    center = np.asarray(region.center)
    local = [np.asarray(grid.axis(k)) - center[k] for k in range(3)]
    low, high = (center + [f(x) for x in local] for f in (np.min, np.max))
    local[2] = local[2][local[2] < float(region.cut)]
    # the node nearest to the centre, axis by axis: all nodes of a large grid are many
    if sum(np.min(x**2, initial=np.inf) for x in local) >= float(region.radius) ** 2:
        raise ValueError(
            f"no node of the grid (from {low} to {high}) lies in the region of interest, within "
            f"{float(region.radius):.6g} of {center} and below {float(region.cut):.6g}: move or "
            "widen the grid."
        )


def resolved_frequency(detectors: Detectors, reach: float) -> float:
    """The lambda up to which the detectors sample waves from within ``reach`` [rad/length].

    Rings by their azimuths and the widest gap between them. Detectors off rings by their number,
    which must be that of the waves, (lambda reach + 1)² on the whole sphere.
    """
    if isinstance(detectors, DetectorPoints):
        on_sphere = detectors.shape[0] / covered_share(detectors)
        return max(np.sqrt(on_sphere) - 1, 1.0) / reach
    return min(detectors.n_azimuths / (2 * reach), 1.1 * np.pi / (_widest_gap(detectors) * reach))


def _widest_gap(cap: SphericalCap) -> float:
    """Between rings, or from the lowest one to the end of its area [rad]."""
    theta = np.append(float(cap.lowest_angle), np.arccos(np.asarray(cap.cosines)))
    return float(np.abs(np.diff(theta)).max())


def _warn_of_sampling(detectors: Detectors, highest: float, reach: float) -> None:
    possible, waves = resolved_frequency(detectors, reach), highest * reach
    if highest <= possible * (1 + 1e-3):  # the bound is not as sharp as that
        return
    if isinstance(detectors, DetectorPoints):
        n_wanted = int(np.ceil(covered_share(detectors) * (waves + 1) ** 2))
        problem = f"here are {detectors.shape[0]}, and {n_wanted} are needed for that"
    else:
        problem = (
            f"rings are up to {_widest_gap(detectors):.3g} rad apart, with {detectors.n_azimuths} "
            f"azimuths, and {1.1 * np.pi / waves:.3g} rad with {int(np.ceil(2 * waves))} are needed"
        )
    warn_of_detectors(highest, possible, problem, stacklevel=6)
