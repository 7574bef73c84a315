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

from .checks import Numbers, is_concrete, real_array, require_objects, require_x64
from .densities import (
    Densities,
    DensityReport,
    SampledDensities,
    collocation_densities,
    series_densities,
)
from .geometry import Circle, DetectorCurve, ImageGrid, Region, fit_circle
from .harmonic import (
    AlphaRule,
    HarmonicDensities,
    PolarGeometry,
    alpha_units,
    frequency_groups,
    group_of,
    harmonic_densities,
    harmonic_orders,
    polar_geometry,
    sampled_harmonic_densities,
    wave_table,
    waves_reach,
)
from .layout import Layout, as_in_the_paper, problem_layout, systems_fit
from .problem import AccuracyWarning, polar_grid, require_boundary, require_problem
from .regularization import (
    DEFAULT_KAPPA,
    NormBound,
    Regularization,
    RelativeCutoff,
    per_frequency,
    seen_once,
)
from .symmetry import find_mirror
from .unit_norm import unit_norms

METHODS = ("auto", "harmonic", "collocation", "series")
_FREQUENCIES_AT_A_TIME = 4
_GROUPS = 4  # of frequencies with as many orders; each is compiled by itself

PAPER_K = 1.5 * float(np.sqrt(2 * np.pi * 1.3))
"""Kunyansky's K = 1.5 at R_g = 1.3, in the true norm of the full circle, see `NormBound`."""


class ReconstructionPlan(eqx.Module):
    """Everything steps 2 to 5 need to turn circular integrals into an image.

    Attributes:
        curve, region, grid, radii: the geometry the plan was built for.
        frequencies: lambda_i = i d lambda > 0, (frequencies,) [rad/length].
        angles: theta of the directions, equispaced over half a turn, (directions,) [rad].
        densities: (rho_J, rho_Y) of all directions and frequencies.
        regularization: the one that was used; None where the densities are in closed form.
        report: accuracy and norm of the densities.
    """

    curve: DetectorCurve
    region: Region
    grid: ImageGrid
    radii: Float[Array, " radii"]
    frequencies: Float[Array, " frequencies"]
    angles: Float[Array, " directions"]
    densities: Densities
    regularization: Regularization | None
    report: DensityReport

    @property
    def frequency_step(self) -> Float[Array, ""]:
        """d lambda [rad/length]."""
        return self.frequencies[0]


def build_plan(
    curve: DetectorCurve,
    region: Region,
    grid: ImageGrid,
    radii: Numbers,
    regularization: Regularization | None = None,
    *,
    method: str = "auto",
    max_frequency: Numbers | None = None,
    n_directions: int | None = None,
    precision: str = "double",
    progress: bool = True,
    layout: Layout | None = None,
) -> ReconstructionPlan:
    """Densities of the plane waves exp(-i xi·x) for all xi on a polar grid: step 1 of the paper.

    Frequencies are i d lambda up to lambda_max, d lambda <= π/(2 R) for a region of reach R, so
    that projections are resolved up to |s| = 2 R; directions cover half a turn.

    Args:
        curve: the detectors, all outside the region.
        region: region of interest; outside it the image means nothing.
        grid: where the image is wanted.
        radii: r > 0 of the data, increasing, covering the region and all other sources, (radii,)
            [length]; see `data_radii`.
        regularization: `NormBound`, `FixedRank`, `SingularValueCutoff`, `RelativeCutoff`,
            `RelativeTikhonov`, `ResidualTarget`, `Tikhonov` or `TikhonovNormBound`, with a number
            or one for each frequency. By default the paper's bound, ``NormBound(PAPER_K)``, where
            its assumptions hold: detectors on a circle (within 5 % of its radius) that see all of
            the region. Else ``RelativeCutoff(0.1)``: it asks for no norm, and leaves out what no
            detector records instead of magnifying it.
        method: "harmonic": singular value decomposition in cylindrical waves, for detectors that
            are all farther from some centre than the region; "collocation": of the potentials on
            the boundary, as in the paper, for any geometry, slower; "auto": the first if it can,
            else the second; "series": the closed form for a full circle of equispaced detectors.
        max_frequency: lambda_max [rad/length]; by default π over the larger of pixel and radial
            step, beyond which neither data nor image hold anything.
        n_directions: by default enough for lambda_max, a multiple of 32.
        precision: "single" halves the memory and costs about 1e-7 of accuracy.
        progress: show a progress bar.
        layout: of `problem_layout`, which has decided max_frequency and n_directions; needed where
            the geometry is traced by `jax.jit`.

    Returns:
        ReconstructionPlan: differentiable with respect to all positions and sizes of curve, region
        and grid, to radii and to the number in the regularisation. Where the geometry is traced the
        densities are stored one by one (as for "collocation").

    Raises:
        ValueError: for detectors in the region, radii that do not cover it, too few boundary
            points, a grid that misses the region, NaN, wrong shapes, or 64-bit arithmetic off.

    Warns:
        VisibilityWarning: if lines through the region miss the curve.
        AccuracyWarning: if many plane waves are not reached, for want of detectors or norm.

    >>> from jaxtat import circular_arc, phantoms, reconstruct, truncated_disk
    >>> curve, region = circular_arc(1.3, 1.0, 80), truncated_disk(1.0, 1.0, 160)
    >>> grid, radii = ImageGrid(21), 0.3 + 0.1 * jnp.arange(21)
    >>> plan = build_plan(curve, region, grid, radii, progress=False)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> image = reconstruct(plan, bell.circular_integrals(curve, radii))
    >>> inside = region.contains(grid.points)
    >>> bool(jnp.abs(image - bell.image(grid))[inside].max() < 1e-2)
    True
    """
    require_x64()
    require_objects(curve=curve, region=region, grid=grid)
    radii = real_array("radii", radii, ("radii",))
    if precision not in ("double", "single"):
        raise ValueError(f"precision is {precision!r}, expected 'double' or 'single'.")
    single = precision == "single"
    if isinstance(regularization, AlphaRule):
        raise ValueError(
            f"regularization is a {type(regularization).__name__}, which looks at the data: it is "
            "for alpha of reconstruct_direct. A plan for noise of known size takes the rule that "
            "choose_regularization finds."
        )
    if not (regularization is None or isinstance(regularization, Regularization)):
        raise ValueError(
            f"regularization is {regularization!r}, expected a rule such as NormBound(4.0)."
        )
    if method not in METHODS:
        raise ValueError(f"method is {method!r}, expected one of {', '.join(METHODS)}.")
    if layout is not None or not is_concrete(curve, region, grid, radii):
        if layout is None:
            options = {"max_frequency": max_frequency, "n_directions": n_directions}
            layout = problem_layout(curve, region, grid, radii, method=method, **options)
        if method == "auto":
            method = "harmonic" if layout.basis == "cylindrical" else "collocation"
        rule = _rule(method, regularization, layout.as_in_the_paper)
        return _traced(curve, region, grid, radii, rule, method, layout, single)
    # inside jax.jit too: only the rule's number may be traced
    with jax.ensure_compile_time_eval():
        frequencies, angles = polar_grid(region, grid, radii, max_frequency, n_directions)
        require_problem(curve, region, grid, radii)
        require_boundary(region, float(frequencies[-1]))
        norms = unit_norms(curve, region, frequencies, angles=angles)
        if method == "auto":
            method = "harmonic" if waves_reach(curve, region) else "collocation"
        systems_fit(curve, region, radii, (frequencies, angles), method == "harmonic", plan=True)
        by_paper = as_in_the_paper(curve, region)
        regularization = _rule(method, regularization, by_paper)
    build = {"harmonic": _harmonic, "collocation": _collocation, "series": _series}[method]
    bar = tqdm(total=len(frequencies), desc="densities", unit="freq", disable=not progress)
    with bar:
        densities, report = build(
            curve, region, frequencies, norms, angles, regularization, single, bar
        )
    if all(leaf.ndim == 0 for leaf in jax.tree.leaves(regularization)):
        _warn_of_residuals(report)  # a rule made for every frequency leaves out what it wants to
    return ReconstructionPlan(
        curve, region, grid, radii, frequencies, angles, densities, regularization, report
    )


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
    """Say so if many plane waves were not reached: the image will be wrong there."""
    if not is_concrete(report):
        return
    failed = float((report.residual > 0.3).mean())
    if failed > 0.1:
        warnings.warn(
            f"{100 * failed:.0f} % of the plane waves are off by more than 30 % on the region's "
            "boundary: use more detectors, a larger K, a lower max_frequency or a smaller region.",
            AccuracyWarning,
            stacklevel=3,
        )


def _traced(
    curve: DetectorCurve,
    region: Region,
    grid: ImageGrid,
    radii: Array,
    regularization: Regularization | None,
    method: str,
    layout: Layout,
    single: bool,
) -> ReconstructionPlan:
    """A plan of sizes known beforehand; everything else may be traced."""
    if regularization is None:
        raise ValueError("method 'series' needs a geometry that is not traced.")
    frequencies, angles = layout.frequencies, layout.angles
    norms = unit_norms(curve, region, frequencies, layout.norm_orders, angles)
    if method == "collocation":
        if regularization.has_unit and layout.reached:
            raise ValueError(
                "the unit of alpha is measured in cylindrical waves: with method 'collocation' "
                "Tikhonov needs a geometry that is not traced."
            )
        units = seen_once(frequencies) ** 2
        rules = per_frequency(regularization, len(frequencies)).in_units_of(units, frequencies)
        values, report = collocation_densities(frequencies, norms, angles, curve, region, rules)
    else:
        geometry = polar_geometry(curve, region)
        offset = region.center - geometry.center
        values, report = _traced_harmonic(geometry, offset, norms, regularization, layout)
    densities = SampledDensities(values)
    return ReconstructionPlan(
        curve,
        region,
        grid,
        radii,
        frequencies,
        angles,
        densities.in_single_precision() if single else densities,
        regularization,
        report,
    )


@eqx.filter_jit
def _traced_harmonic(
    geometry: PolarGeometry,
    offset: Array,
    norms: Array,
    regularization: Regularization,
    layout: Layout,
) -> tuple[Array, DensityReport]:
    frequencies, angles = layout.frequencies, layout.angles
    table = wave_table(geometry, frequencies, layout.groups[-1][-1])
    each = table, norms, per_frequency(regularization, frequencies.shape[0])
    pieces, reports = [], []
    for start, stop, n_max in layout.groups:
        few, its_norms, rules = jax.tree.map(lambda leaf: leaf[start:stop], each)  # noqa: B023
        values, report = sampled_harmonic_densities(
            geometry, few, n_max, its_norms, angles - geometry.axis, rules
        )
        pieces.append(values)
        reports.append(report)
    along = jnp.cos(angles) * offset[0] + jnp.sin(angles) * offset[1]
    phases = jnp.exp(1j * frequencies[:, None] * along)
    return jnp.concatenate(pieces) * phases[..., None, None], _joined(reports)


def _harmonic(
    curve: DetectorCurve,
    region: Region,
    frequencies: Array,
    norms: Array,
    angles: Array,
    regularization: Regularization,
    single: bool,
    bar: tqdm,
) -> tuple[Densities, DensityReport]:
    """Groups of frequencies with alike orders; within a group a few at a time."""
    with jax.ensure_compile_time_eval():
        geometry = polar_geometry(curve, region)
        orders = harmonic_orders(geometry, np.asarray(frequencies))
        # numpy, of which parts can be taken without a compilation for each
        table = wave_table(geometry, frequencies, int(orders.max()))
        offset = np.asarray(region.center - geometry.center)
        local = jax.device_put(np.asarray(angles) - np.asarray(geometry.axis))
    each = _divisible((table, norms, per_frequency(regularization, len(frequencies))))
    groups, reports = [], []
    for part, n_max in frequency_groups(orders, _GROUPS):
        steps = []
        for start in range(part.start, part.stop, _FREQUENCIES_AT_A_TIME):
            chosen = slice(start, min(start + _FREQUENCIES_AT_A_TIME, part.stop))
            few, its_norms, rules = _part(each, chosen)
            step, report = harmonic_densities(geometry, few, n_max, its_norms, local, rules)
            steps.append(step)
            reports.append(report)
            bar.update(chosen.stop - chosen.start)
        groups.append(group_of(steps))
    phases = _phases(frequencies, angles, offset)
    densities = HarmonicDensities(tuple(groups), local, phases, geometry.mirror)
    return densities.in_single_precision() if single else densities, _joined(reports)


def _phases(frequencies: Array, angles: Array, offset: np.ndarray) -> Array:
    """exp(i xi·offset)."""
    theta = np.asarray(angles)
    along = np.cos(theta) * offset[0] + np.sin(theta) * offset[1]
    return jax.device_put(np.exp(1j * np.asarray(frequencies)[:, None] * along))


def _collocation(
    curve: DetectorCurve,
    region: Region,
    frequencies: Array,
    norms: Array,
    angles: Array,
    regularization: Regularization,
    single: bool,
    bar: tqdm,
) -> tuple[Densities, DensityReport]:
    rules = per_frequency(regularization, len(frequencies))
    with jax.ensure_compile_time_eval():
        mirror = find_mirror(curve, region)
        units = seen_once(frequencies) ** 2
        if regularization.has_unit and waves_reach(curve, region):
            geometry = polar_geometry(curve, region)
            n_max = int(harmonic_orders(geometry, np.asarray(frequencies)).max())
            units = alpha_units(geometry, frequencies, n_max)
        rules = rules.in_units_of(units, frequencies)

    def solve(few: Array, norms: Array, rules: Regularization) -> tuple[Array, DensityReport]:
        return collocation_densities(few, norms, angles, curve, region, rules, mirror)

    return _sampled(solve, (frequencies, norms, rules), single, bar)


def _series(
    curve: DetectorCurve,
    region: Region,
    frequencies: Array,
    norms: Array,
    angles: Array,
    regularization: None,
    single: bool,
    bar: tqdm,
) -> tuple[Densities, DensityReport]:
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


def _full_circle(curve: DetectorCurve) -> Circle:
    """The circle of equispaced detectors, or ValueError if they are not."""
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
