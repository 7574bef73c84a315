"""Reconstruction plans: the densities of a geometry, computed once for all its data."""

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from tqdm import tqdm

from ..base.checks import (
    is_concrete,
    is_number,
    named,
    real_array,
    require_positive,
    require_x64,
)
from ..base.threads import one_blas_thread
from ..densities import (
    Densities,
    DensityReport,
    SampledDensities,
    collocation_densities,
    find_mirror,
    phases_from,
    series_densities,
)
from ..densities.cylindrical_waves import (
    CylindricalDensities,
    PolarGeometry,
    alpha_units,
    cylindrical_densities,
    frequency_groups,
    group_of,
    polar_geometry,
    sampled_cylindrical_densities,
    wave_orders,
    wave_table,
)
from ..geometry import Circle, DetectorCurve, ImageGrid, Region, fit_circle
from ..regularization import (
    DEFAULT_KAPPA,
    NormBound,
    Regularization,
    RelativeCutoff,
    Tikhonov,
    per_frequency,
    single_crossing,
    unit_norms,
)
from ..steps import UnreachedWaves, require_boundary
from .plane_bases import StoredDensities, data_kernels
from .setup import Setup, plane_of, require_complete, require_one_speed
from .sizes import PlaneSizes, systems_fit

METHODS = ("auto", "cylindrical", "collocation", "series")
_FREQUENCIES_AT_A_TIME = 4
_GROUPS = 4  # of frequencies with as many orders; each is compiled by itself

PAPER_K = 1.5 * float(np.sqrt(2 * np.pi * 1.3))
"""Kunyansky's K = 1.5 at R_g = 1.3, in the true norm of the full circle, see `NormBound`."""


class ReconstructionPlan(eqx.Module):
    """Everything steps 2 to 5 need to turn circular integrals into an image.

    Attributes:
        setup: the problem the plan was built for.
        densities: (rho_J, rho_Y) of all directions and frequencies.
        regularization: the one that was used; None where the densities are in closed form.
        report: accuracy and norm of the densities.
        kernels: of step 2, from the radii of data to the frequencies.
        totals: by which data are summed to the total mass.
    """

    setup: Setup
    densities: Densities
    regularization: Regularization | None
    report: DensityReport
    kernels: Float[Array, "frequencies 2 radii"]
    totals: Float[Array, " radii"]

    @property
    def curve(self) -> DetectorCurve:
        """The detectors of its setup."""
        return plane_of(self.setup)[0]

    @property
    def region(self) -> Region:
        """The region of interest of its setup."""
        return plane_of(self.setup)[1]

    @property
    def grid(self) -> ImageGrid:
        """The grid of its setup."""
        assert isinstance(self.setup.grid, ImageGrid)
        return self.setup.grid

    @property
    def radii(self) -> Float[Array, " radii"]:
        """The radii of its setup [length]."""
        return self.setup.radii

    @property
    def frequencies(self) -> Float[Array, " frequencies"]:
        """lambda_i = i d lambda > 0 [rad/length]."""
        return self.setup.sizes.frequencies

    @property
    def frequency_step(self) -> Float[Array, ""]:
        """d lambda [rad/length]."""
        return self.frequencies[0]

    @property
    def angles(self) -> Float[Array, " directions"]:
        """theta of the directions, equispaced over half a turn [rad]."""
        return plane_of(self.setup)[3].angles

    @property
    def basis(self) -> StoredDensities:
        """The densities, as `images_of` takes them."""
        curve, region, _, sizes = plane_of(self.setup)
        return StoredDensities(curve, region, sizes, self.kernels, self.totals, self.densities)


def require_plan(plan: Any) -> None:
    """Raise ValueError for what is no `ReconstructionPlan`."""
    if not isinstance(plan, ReconstructionPlan):
        raise ValueError(
            f"plan is {named(plan)}, expected a ReconstructionPlan: build_plan(setup, rule)."
        )


def build_plan(
    setup: Setup,
    rule: Any = None,
    *,
    method: str = "auto",
    precision: str = "double",
    progress: bool = False,
) -> ReconstructionPlan:
    """Densities of the plane waves exp(-i xi·x) for all xi on a polar grid: step 1 of the paper.

    Args:
        setup: detectors, region, grid and radii, in the plane.
        rule: which singular components are kept: `NormBound`, `FixedRank`, `SingularValueCutoff` or
            `RelativeCutoff`, or one of Tikhonov's, `Tikhonov`, `RelativeTikhonov` or
            `TikhonovNormBound`, with a number or one for each frequency; a number without a rule is
            the alpha of `Tikhonov`, as in `solve`. By default the paper's
            bound, ``NormBound(PAPER_K)``, where its assumptions hold: detectors on a circle (within
            5 % of its radius) that see all of the region. Else ``RelativeCutoff(0.1)``: it asks for
            no norm, and leaves out what no detector records instead of magnifying it.
        method: "cylindrical": singular value decomposition in cylindrical waves, for detectors that
            are all farther from some centre than the region; "collocation": of the potentials on
            the boundary, as in the paper, for any geometry, slower; "auto": the first if it can,
            else the second; "series": the closed form for a full circle of equispaced detectors.
        precision: "single" halves the memory and costs about 1e-7 of accuracy.
        progress: show a progress bar.

    Returns:
        ReconstructionPlan: differentiable with respect to all positions and sizes of curve, region
        and grid, to radii and to the number in the rule. Where the geometry is traced the densities
        are stored one by one (as for "collocation").

    Raises:
        ValueError: for a rule that only `solve` takes, too few boundary points, waves that do not
            reach, or 64-bit arithmetic off.

    Warns:
        AccuracyWarning: if many plane waves are not reached, for want of detectors or norm.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms, reconstruct
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> plan = build_plan(setup)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> image = reconstruct(plan, bell.circular_integrals(setup.curve, setup.radii))
    >>> inside = setup.region.contains(setup.grid.points)
    >>> bool(jnp.abs(image - bell.image(setup.grid))[inside].max() < 1e-2)
    True
    """
    require_x64()
    if precision not in ("double", "single"):
        raise ValueError(f"precision is {precision!r}, expected 'double' or 'single'.")
    rule = _checked(rule)
    if method not in METHODS:
        raise ValueError(f"method is {method!r}, expected one of {', '.join(METHODS)}.")
    curve, region, _, sizes = plane_of(setup)
    require_complete(setup)
    if method == "auto":
        method = "cylindrical" if sizes.reached else "collocation"
    if method != "cylindrical":
        require_one_speed(setup, f"method {method!r}")
    rule = _rule(method, rule, sizes.as_in_the_paper)
    if is_concrete(setup):
        # inside jax.jit too: only the rule's number may be traced
        with jax.ensure_compile_time_eval():
            if method != "cylindrical":
                require_boundary(region, sizes.max_frequency)
            polar = sizes.frequencies, sizes.angles
            systems_fit(
                curve, region, setup.radii, polar, method == "cylindrical", True, setup.medium
            )
            norms = unit_norms(
                curve, region, sizes.frequencies, sizes.norm_orders, angles=sizes.angles
            )
        bar = tqdm(total=sizes.n_frequencies, desc="densities", unit="freq", disable=not progress)
        with bar, one_blas_thread():
            built = _BUILD[method](setup, norms, rule, precision == "single", bar)
            densities, report = jax.block_until_ready(built)
    else:
        densities, report = _traced(setup, method, rule)
        densities = densities.in_single_precision() if precision == "single" else densities
    if all(leaf.ndim == 0 for leaf in jax.tree.leaves(rule)):
        _warn_of_residuals(report)  # a rule made for every frequency leaves out what it wants to
    kernels = data_kernels(setup.radii, sizes, setup.medium)
    return ReconstructionPlan(setup, densities, rule, report, *kernels)


def _geometry(setup: Setup) -> PolarGeometry:
    """About the centre of the waves."""
    curve, region, _, sizes = plane_of(setup)
    return polar_geometry(curve, region, sizes.n_nodes, sizes.wave_offset, setup.medium)


def _checked(rule: Any) -> Regularization | None:
    """What a user passes as the rule of a plan, a number as Tikhonov's alpha."""
    if rule is None or isinstance(rule, Regularization):
        return rule
    if not is_number(rule):
        raise ValueError(
            f"rule is {named(rule)}, expected one such as NormBound(4.0), or a number, alpha."
        )
    alpha = real_array("alpha", rule, None)
    require_positive("alpha", alpha)
    return Tikhonov(alpha)


def _rule(
    method: str, regularization: Regularization | None, as_in_the_paper: bool
) -> Regularization | None:
    """The regularisation that will be used, None for the closed form."""
    if method == "series":
        if regularization is not None:
            raise ValueError("method 'series' is a closed form: it takes no regularization.")
        return None
    if regularization is None:
        return NormBound(PAPER_K) if as_in_the_paper else RelativeCutoff(DEFAULT_KAPPA)
    return regularization


def _warn_of_residuals(report: DensityReport) -> None:
    """Warn if many plane waves are approximated badly: the image will be wrong there."""
    if not is_concrete(report):
        return
    failed = float((report.residual > 0.3).mean())
    if failed > 0.1:
        warnings.warn(
            f"{100 * failed:.0f} % of the plane waves are off by more than 30 % on the region's "
            "boundary: use more detectors, less regularization (a larger K or rank, a smaller "
            "alpha), a lower max_frequency or a smaller region.",
            UnreachedWaves,
            stacklevel=3,
        )


def _traced(
    setup: Setup, method: str, rule: Regularization | None
) -> tuple[SampledDensities, DensityReport]:
    """Densities where arrays are traced: no progress bar, and all components are kept."""
    curve, region, _, sizes = plane_of(setup)
    if rule is None:
        raise ValueError("method 'series' needs a geometry that is not traced.")
    frequencies, angles = sizes.frequencies, sizes.angles
    norms = unit_norms(curve, region, frequencies, sizes.norm_orders, angles)
    if method == "cylindrical":
        geometry = _geometry(setup)
        offset = region.center - geometry.center
        values, report = _traced_cylindrical(geometry, offset, norms, rule, sizes)
    else:
        if rule.has_unit and sizes.reached:
            raise ValueError(
                "the unit of alpha is measured in cylindrical waves: with method 'collocation' "
                "Tikhonov needs a geometry that is not traced."
            )
        units = single_crossing(frequencies) ** 2
        rules = per_frequency(rule, len(frequencies)).in_units_of(units, frequencies)
        where = angles, curve, region
        values, report = collocation_densities(
            frequencies, norms, *where, rules, n_nodes=sizes.n_nodes
        )
    return SampledDensities(values), report


@eqx.filter_jit
def _traced_cylindrical(
    geometry: PolarGeometry,
    offset: Array,
    norms: Array,
    regularization: Regularization,
    sizes: PlaneSizes,
) -> tuple[Array, DensityReport]:
    frequencies, angles = sizes.frequencies, sizes.angles
    table = wave_table(geometry, frequencies, sizes.groups[-1][-1])
    each = table, norms, per_frequency(regularization, frequencies.shape[0])
    pieces, reports = [], []
    for start, stop, n_max in sizes.groups:
        few, its_norms, rules = jax.tree.map(lambda leaf: leaf[start:stop], each)  # noqa: B023
        values, report = sampled_cylindrical_densities(
            geometry, few, n_max, its_norms, angles - geometry.axis, rules
        )
        pieces.append(values)
        reports.append(report)
    phases = phases_from(frequencies, angles, offset)
    return jnp.concatenate(pieces) * phases[..., None, None], _joined(reports)


def _cylindrical(
    setup: Setup, norms: Array, regularization: Regularization, single: bool, bar: tqdm
) -> tuple[Densities, DensityReport]:
    """Groups of frequencies with the same number of orders; within a group a few at a time."""
    _, region, _, sizes = plane_of(setup)
    frequencies, angles = sizes.frequencies, sizes.angles
    with jax.ensure_compile_time_eval():
        geometry = _geometry(setup)
        orders = wave_orders(geometry, np.asarray(frequencies))
        # numpy, of which parts can be taken without a compilation for each
        table = wave_table(geometry, frequencies, int(orders.max()))
        offset = region.center - geometry.center
        local = jax.device_put(np.asarray(angles) - np.asarray(geometry.axis))
    each = _divisible((table, norms, per_frequency(regularization, len(frequencies))))
    # of a traced rule one loop for each group, or its program would be written once for each piece
    at_a_time = _FREQUENCIES_AT_A_TIME if is_concrete(regularization) else len(frequencies)
    groups, reports = [], []
    for part, n_max in frequency_groups(orders, _GROUPS):
        steps = []
        for start in range(part.start, part.stop, at_a_time):
            chosen = slice(start, min(start + at_a_time, part.stop))
            few, its_norms, rules = _part(each, chosen)
            step, report = cylindrical_densities(geometry, few, n_max, its_norms, local, rules)
            steps.append(step)
            reports.append(report)
            bar.update(chosen.stop - chosen.start)
        groups.append(group_of(steps))
    phases = phases_from(frequencies, angles, offset)
    densities = CylindricalDensities(tuple(groups), local, phases, geometry.mirror)
    return densities.in_single_precision() if single else densities, _joined(reports)


def _collocation(
    setup: Setup, norms: Array, regularization: Regularization, single: bool, bar: tqdm
) -> tuple[Densities, DensityReport]:
    curve, region, _, sizes = plane_of(setup)
    frequencies, angles = sizes.frequencies, sizes.angles
    rules = per_frequency(regularization, len(frequencies))
    with jax.ensure_compile_time_eval():
        mirror = find_mirror(curve, region)
        units = single_crossing(frequencies) ** 2
        if regularization.has_unit and sizes.reached:
            geometry = _geometry(setup)
            n_max = int(wave_orders(geometry, np.asarray(frequencies)).max())
            units = alpha_units(geometry, wave_table(geometry, frequencies, n_max))
        rules = rules.in_units_of(units, frequencies)

    def solve(few: Array, norms: Array, rules: Regularization) -> tuple[Array, DensityReport]:
        where = angles, curve, region
        return collocation_densities(few, norms, *where, rules, mirror, sizes.n_nodes)

    return _sampled(solve, (frequencies, norms, rules), single, bar)


def _series(
    setup: Setup, norms: Array, regularization: None, single: bool, bar: tqdm
) -> tuple[Densities, DensityReport]:
    curve, region, _, sizes = plane_of(setup)
    with jax.ensure_compile_time_eval():  # inside jax.jit too
        frequencies, angles = sizes.frequencies, sizes.angles
        circle = _full_circle(curve)
        # 40 + 12 % beyond lambda R_g the terms have fallen below rounding
        n_orders = int(1.12 * float(frequencies[-1] * circle.radius)) + 40
    solve = partial(
        series_densities,
        angles=angles,
        curve=curve,
        region=region,
        circle=circle,
        n_orders=n_orders,
    )
    return _sampled(solve, (frequencies, norms), single, bar)


_BUILD: dict[str, Callable[..., tuple[Densities, DensityReport]]] = {
    "cylindrical": _cylindrical,
    "collocation": _collocation,
    "series": _series,
}


def _full_circle(curve: DetectorCurve) -> Circle:
    """The circle of equispaced point detectors, or ValueError if they are not."""
    if curve.element_width is not None:
        raise ValueError(
            "method 'series' is for point detectors, this curve has an element_width: use method "
            "'cylindrical'."
        )
    circle = fit_circle(curve.points)
    off = jnp.abs(jnp.linalg.norm(curve.points - circle.center, axis=1) / circle.radius - 1)
    uneven = jnp.abs(curve.weights / (2 * jnp.pi * circle.radius / curve.n_detectors) - 1)
    if not (curve.closed and off.max() < 1e-9 and uneven.max() < 1e-9):
        raise ValueError(
            "method 'series' is for equispaced detectors on a full circle; this curve is "
            f"{'closed' if curve.closed else 'open'}, off a circle by {float(off.max()):.2g} and "
            f"uneven by {float(uneven.max()):.2g} (relative): use method 'collocation'."
        )
    return circle


def _sampled(
    solve: Callable[..., tuple[Array, DensityReport]],
    each: tuple[Any, ...],
    single: bool,
    bar: tqdm,
) -> tuple[Densities, DensityReport]:
    """All frequencies, a few at a time: a progress bar, and little memory besides the result."""
    each, n_frequencies = _divisible(each), len(each[0])
    pieces, reports = [], []
    for start in range(0, n_frequencies, _FREQUENCIES_AT_A_TIME):
        values, report = solve(*_part(each, slice(start, start + _FREQUENCIES_AT_A_TIME)))
        piece = SampledDensities(values)
        pieces.append(piece.in_single_precision() if single else piece)
        reports.append(report)
        bar.update(values.shape[0])
    return SampledDensities(jnp.concatenate([piece.values for piece in pieces])), _joined(reports)


def _divisible(each: Any) -> Any:
    """Arrays in numpy, unless traced: parts of those can be taken without a compilation each."""
    return jax.tree.map(lambda leaf: np.asarray(leaf) if is_concrete(leaf) else leaf, each)


def _part(each: Any, chosen: slice) -> Any:
    return jax.tree.map(lambda leaf: jax.device_put(leaf[chosen]), each)


def _joined(reports: list[DensityReport]) -> DensityReport:
    """One report; singular values padded with zeros where a frequency has fewer."""
    library = np if is_concrete(reports) else jnp
    rank = max(report.singular_values.shape[-1] for report in reports)

    def padded(report: DensityReport) -> DensityReport:
        short = rank - report.singular_values.shape[-1]
        values = library.pad(report.singular_values, ((0, 0), (0, short)))
        return eqx.tree_at(lambda tree: tree.singular_values, report, values)

    joined = jax.tree.map(lambda *parts: library.concatenate(parts), *map(padded, reports))
    return jax.device_put(joined) if library is np else joined
