"""Sizes of a problem in the plane, chosen once, outside of `jax.jit`."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, by_library
from ..base.cost import Systems, available_memory, most_that_fit, require_room, systems_cost
from ..densities.cylindrical_waves import (
    frequency_groups,
    polar_geometry,
    require_resolved,
    wave_offset,
    wave_orders,
    waves_reach,
)
from ..forward import CircleSizes, circle_sizes
from ..geometry import (
    Body,
    DetectorCurve,
    ImageGrid,
    Region,
    near_circle,
    require_radii,
    require_surrounded,
    visibility,
)
from ..geometry.elements import enough_nodes
from ..records import sampled_frequency
from ..special import enough_orders
from ..steps import (
    enough_boundary,
    polar_grid,
    require_boundary,
    require_pixels,
    require_problem,
)

GROUPS = 6  # of frequencies with as many orders; each is compiled by itself


class PlaneSizes(eqx.Module):
    """Everything about a problem in the plane that is a size, and so cannot be traced.

    Attributes:
        max_frequency: lambda_max [rad/length].
        n_frequencies, n_directions: of the polar grid.
        groups: (first frequency, last + 1, orders) of frequencies that are solved alike; none
            where cylindrical waves do not reach.
        wave_offset: of the waves' centre, see `cylindrical_waves.wave_offset`.
        norm_orders: that N(lambda) needs; 0 for detectors off a circle, see `unit_norm`.
        operator: of the forward operator.
        as_in_the_paper: detectors on a circle that see all of the region: what its rule assumes.
            Its norm N(lambda) is that of a circle, and a bound on the norm admits noise without
            limit in directions that are not seen.
        n_nodes: on elements of finite width, by which their means are taken where they are no arcs.
        sampled: share of max_frequency up to which the detectors sample waves of the region, in
            quarters of an octave; at most 1.
        n_samples: of frequencies in arrays of sizes on the ladder, where the last one is there
            again, and counts nothing, until they are so many, see `laddered`; else None.
    """

    max_frequency: float = eqx.field(static=True)
    n_frequencies: int = eqx.field(static=True)
    n_directions: int = eqx.field(static=True)
    groups: tuple[tuple[int, int, int], ...] = eqx.field(static=True)
    wave_offset: tuple[float, float] = eqx.field(static=True)
    norm_orders: int = eqx.field(static=True)
    operator: CircleSizes
    as_in_the_paper: bool = eqx.field(static=True)
    n_nodes: int = eqx.field(static=True)
    sampled: float = eqx.field(static=True)
    n_samples: int | None = eqx.field(static=True, default=None)

    @property
    def reached(self) -> bool:
        """Whether cylindrical waves reach; elsewhere the boundary itself is the basis."""
        return bool(self.groups)

    @property
    def frequencies(self) -> Float[Array, " frequencies"]:
        """lambda_i [rad/length]."""
        n = self.n_frequencies
        return by_library(_frequencies, (), self.max_frequency, n, self.n_samples or n)

    @property
    def angles(self) -> Float[Array, " directions"]:
        """theta [rad]."""
        return by_library(_angles, (), self.n_directions)


def _frequencies(xp: Any, highest: float, n: int, n_samples: int) -> Any:
    return highest / n * xp.minimum(xp.arange(1, n_samples + 1), n)


def _angles(xp: Any, n: int) -> Any:
    return xp.arange(n) * (np.pi / n)


def plane_sizes(
    curve: DetectorCurve,
    region: Region,
    grid: ImageGrid,
    radii: Float[Array, " radii"],
    max_frequency: Numbers | None,
    n_directions: int | None,
    n_groups: int,
    medium: Body | None = None,
) -> tuple[PlaneSizes, Region]:
    """Sizes of a concrete problem, which is checked, and the region with enough boundary points.

    Orders are rounded up to fours, so that small changes of the geometry keep them.
    """
    with jax.ensure_compile_time_eval():  # of constants, inside jax.jit too
        require_pixels(grid, float(region.reach))  # by which default radii are chosen
        require_radii(radii)  # before anything is made of their steps
        outside = radii if medium is None else radii * medium.speed_ratio
        frequencies, angles = polar_grid(region, grid, outside, max_frequency, n_directions)
        highest = float(np.asarray(frequencies)[-1])
        if region.automatic:
            length = float(np.asarray(region.weights).sum())
            region = region.with_counts(region.shared_out(enough_boundary(length, highest)))
        require_problem(curve, region, grid)
        groups: tuple[tuple[int, int, int], ...] = ()
        if medium is not None:
            require_surrounded(curve, region, medium)
        geometry = polar_geometry(curve, region, medium=medium)
        reached = waves_reach(curve, region, medium)
        systems_fit(curve, region, radii, (frequencies, angles), reached, medium=medium)
        if reached or medium is not None:  # or say that nothing else goes through a body
            orders = wave_orders(geometry, np.asarray(frequencies))
            groups = tuple(
                (part.start, part.stop, -(-n // 4) * 4)
                for part, n in frequency_groups(orders, n_groups)
            )
            require_resolved(geometry, highest, groups[-1][-1])
        if not (groups and geometry.disk):
            require_boundary(region, highest)
        on_quadrature = near_circle(curve)
        farthest = highest * float(np.asarray(geometry.detector_radius).max())
        return PlaneSizes(
            max_frequency=highest,
            n_frequencies=frequencies.shape[0],
            n_directions=angles.shape[0],
            groups=groups,
            wave_offset=wave_offset(curve, region),
            norm_orders=enough_orders(1.1 * farthest) if on_quadrature else 0,
            operator=circle_sizes(curve, grid, medium),
            as_in_the_paper=on_quadrature
            and float(visibility(curve, region).invisible_fraction) == 0,
            n_nodes=enough_nodes(curve.element_width, highest),
            sampled=_sampled_share(curve, region, highest),
        ), region


def _sampled_share(curve: DetectorCurve, region: Region, highest: float) -> float:
    """Rounded down, so that small changes of the geometry keep the sizes."""
    octaves = np.log2(float(sampled_frequency(curve, region, np)) / highest)
    return float(2 ** (np.floor(4 * min(octaves, 0.0) + 1e-9) / 4))


def systems_fit(
    curve: DetectorCurve,
    region: Region,
    radii: Array,
    polar: tuple[Any, Any],
    cylindrical: bool,
    plan: bool = False,
    medium: Body | None = None,
) -> None:
    """Raise ValueError unless the systems of step 1 fit into memory, or the densities of a plan.

    Args:
        curve, region, radii: concrete.
        polar: frequencies and angles.
        cylindrical: in cylindrical waves, or on the boundary.
        plan: whether densities are kept.
        medium: a body of another speed of sound.
    """
    highest, n_all, n_directions = float(np.asarray(polar[0])[-1]), len(polar[0]), len(polar[1])
    geometry = polar_geometry(curve, region, medium=medium) if cylindrical else None
    mirror, disk, on_circle = False, True, False
    if geometry is not None:
        mirror, disk, on_circle = geometry.mirror, geometry.disk, geometry.on_circle

    def sizes(n: int) -> Systems:
        """Sizes of the systems up to the n-th frequency."""
        rows = region.points.shape[0]
        if geometry is not None:
            rows = 2 * int(wave_orders(geometry, np.array([highest * n / n_all]))[0])
        return Systems(
            n_detectors=curve.n_detectors,
            n_radii=radii.shape[0],
            n_frequencies=n,
            n_directions=32 * -(-n_directions * n // (32 * n_all)),  # as `polar_grid` rounds them
            rows=rows,
            blocks=2 if mirror else 1,
            n_boundary=0 if disk else region.points.shape[0],
            on_circle=on_circle,
        )

    def advice(fits: int) -> str:
        if fits:
            return f"pass max_frequency={highest * fits / n_all:.4g}"
        n_radii = most_that_fit(
            lambda n: systems_cost(one._replace(n_radii=n), kept),
            radii.shape[0],
            available_memory(),
        )
        if n_radii < 4:
            return "use fewer detectors or boundary points"
        share = n_radii / radii.shape[0]
        return f"{n_radii} radii would: take pixels {1 / share:.2g} times as large, or more"

    kept, one = ("cylindrical" if cylindrical else "sampled") if plan else None, sizes(1)
    what = f"frequencies for {curve.n_detectors} detectors and {radii.shape[0]} radii"
    require_room(lambda n: systems_cost(sizes(max(n, 1)), kept), n_all, what, advice)
