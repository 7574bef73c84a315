"""What of a problem is a size: decided outside `jax.jit`, once for all geometries alike."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .checks import Numbers, by_library, constants, is_concrete, real_array, require_objects
from .cost import Systems, require_room, systems_cost
from .geometry import DetectorCurve, ImageGrid, Region, near_circle, visibility
from .harmonic import frequency_groups, harmonic_orders, polar_geometry, waves_reach
from .problem import polar_grid, require_boundary, require_problem
from .sampling import sampled_frequency
from .special import enough_orders

GROUPS = 6  # of frequencies with as many orders; each is compiled by itself
MOST_ORDERS = 5000  # up to which Cholesky decompositions are faster: extrapolated, see benchmarks/


class Layout(eqx.Module):
    """Everything about a reconstruction that is a size, and so cannot be traced.

    Attributes:
        max_frequency: lambda_max [rad/length].
        n_frequencies, n_directions: of the polar grid.
        groups: (first frequency, last + 1, orders) of frequencies that are solved alike; none on
            the boundary.
        norm_orders: that N(lambda) needs; 0 for detectors off a circle, see `unit_norm`.
        solver: "cholesky" or "cg".
        basis: "cylindrical", or "boundary" where cylindrical waves do not reach.
        reached: whether they do, whatever the basis.
        as_in_the_paper: see the function.
        sampled: share of max_frequency up to which the detectors sample waves of the region, in
            quarters of an octave; at most 1.
    """

    max_frequency: float = eqx.field(static=True)
    n_frequencies: int = eqx.field(static=True)
    n_directions: int = eqx.field(static=True)
    groups: tuple[tuple[int, int, int], ...] = eqx.field(static=True)
    norm_orders: int = eqx.field(static=True)
    solver: str = eqx.field(static=True)
    basis: str = eqx.field(static=True)
    reached: bool = eqx.field(static=True)
    as_in_the_paper: bool = eqx.field(static=True)
    sampled: float = eqx.field(static=True)

    @property
    def frequencies(self) -> Float[Array, " frequencies"]:
        """lambda_i [rad/length]."""
        return by_library(_frequencies, (), self.max_frequency, self.n_frequencies)

    @property
    def angles(self) -> Float[Array, " directions"]:
        """theta [rad]."""
        return by_library(_angles, (), self.n_directions)


def _frequencies(xp: Any, highest: float, n: int) -> Any:
    return highest / n * xp.arange(1, n + 1)


def _angles(xp: Any, n: int) -> Any:
    return xp.arange(n) * (np.pi / n)


def problem_layout(
    curve: DetectorCurve,
    region: Region,
    grid: ImageGrid,
    radii: Numbers,
    *,
    max_frequency: Numbers | None = None,
    n_directions: int | None = None,
    solver: str = "auto",
    method: str = "auto",
    n_groups: int = GROUPS,
) -> Layout:
    """The sizes that `reconstruct_direct` and `build_plan` would choose, checked, for `jax.jit`.

    Orders are rounded up to fours, so that small changes of the geometry keep the layout.

    Args:
        curve, region, grid, radii: concrete, as in `reconstruct_direct`.
        max_frequency, n_directions, solver: likewise.
        method: of `build_plan`; "collocation" needs no waves about a centre, "auto" goes without
            them where it must.
        n_groups: of frequencies that are solved alike: fewer compile sooner and run longer.

    Raises:
        ValueError: as `reconstruct_direct`, and for a traced geometry.
    """
    require_objects(curve=curve, region=region, grid=grid)
    radii = real_array("radii", radii, ("radii",))
    curve, region, grid, radii = constants((curve, region, grid, radii))
    if not is_concrete(curve, region, grid, radii, max_frequency):
        raise ValueError(
            "curve, region, grid or radii are traced by jax.jit, and sizes depend on them: make "
            "layout = problem_layout(...) of typical ones outside, and pass layout=layout."
        )
    if solver not in ("auto", "cholesky", "cg"):
        raise ValueError(f"solver is {solver!r}, expected 'auto', 'cholesky' or 'cg'.")
    with jax.ensure_compile_time_eval():  # of constants, inside jax.jit too
        polar = polar_grid(region, grid, radii, max_frequency, n_directions)
        frequencies, angles = map(np.asarray, polar)
        require_problem(curve, region, grid, radii)
        geometry = polar_geometry(curve, region)
        reached = waves_reach(curve, region)
        harmonic = method == "harmonic" or (method == "auto" and reached)
        if not (harmonic and geometry.disk):
            require_boundary(region, float(frequencies[-1]))
        systems_fit(curve, region, radii, polar, harmonic)
        groups = ()
        if harmonic:
            orders = harmonic_orders(geometry, frequencies)
            groups = tuple(
                (part.start, part.stop, -(-n // 4) * 4)
                for part, n in frequency_groups(orders, n_groups)
            )
        if solver == "auto" and not harmonic:
            solver = "cholesky"
        elif solver == "auto" and groups:
            rows = groups[-1][-1] * (1 if geometry.mirror else 2)
            cheap = geometry.on_circle and geometry.disk
            solver = "cg" if cheap and rows > MOST_ORDERS else "cholesky"
        farthest = float(frequencies[-1]) * float(np.asarray(geometry.detector_radius).max())
        return Layout(
            max_frequency=float(frequencies[-1]),
            n_frequencies=frequencies.shape[0],
            n_directions=angles.shape[0],
            groups=groups,
            norm_orders=enough_orders(1.1 * farthest) if near_circle(curve) else 0,
            solver=solver,
            basis="cylindrical" if harmonic else "boundary",
            reached=reached,
            as_in_the_paper=as_in_the_paper(curve, region),
            sampled=_sampled_share(curve, region, float(frequencies[-1])),
        )


def systems_fit(
    curve: DetectorCurve,
    region: Region,
    radii: Array,
    polar: tuple[Any, Any],
    harmonic: bool,
    plan: bool = False,
) -> None:
    """Raise ValueError unless the systems of step 1 fit into memory, or the densities of a plan.

    Args:
        curve, region, radii: concrete.
        polar: frequencies and angles.
        harmonic: in cylindrical waves, or on the boundary.
        plan: whether densities are kept.
    """
    highest, n_all, n_directions = float(polar[0][-1]), len(polar[0]), len(polar[1])
    geometry = polar_geometry(curve, region) if harmonic else None
    mirror, disk, on_circle = False, True, False
    if geometry is not None:
        mirror, disk, on_circle = geometry.mirror, geometry.disk, geometry.on_circle

    def sizes(n: int) -> Systems:
        """Up to the n-th frequency."""
        rows = region.points.shape[0]
        if geometry is not None:
            rows = 2 * int(harmonic_orders(geometry, np.array([highest * n / n_all]))[0])
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
        if fits == 0:
            return "use fewer detectors, radii or boundary points"
        return f"pass max_frequency={highest * fits / n_all:.4g}"

    kept = ("harmonic" if harmonic else "sampled") if plan else None
    what = f"frequencies for {curve.n_detectors} detectors and {radii.shape[0]} radii"
    require_room(lambda n: systems_cost(sizes(max(n, 1)), kept), n_all, what, advice)


def _sampled_share(curve: DetectorCurve, region: Region, highest: float) -> float:
    """Rounded down, so that small changes of the geometry keep the layout."""
    octaves = np.log2(float(sampled_frequency(curve, region, np)) / highest)
    return float(2 ** (np.floor(4 * min(octaves, 0.0) + 1e-9) / 4))


def as_in_the_paper(curve: DetectorCurve, region: Region) -> bool:
    """Whether detectors are on a circle and see all of the region: what its rule assumes.

    Its norm N(lambda) is that of a circle, and a bound on the norm admits noise without limit in
    directions that are not seen.
    """
    return near_circle(curve) and float(visibility(curve, region).invisible_fraction) == 0
