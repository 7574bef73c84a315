"""Reconstruction plans: the densities of a geometry, computed once for all its data."""

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float
from tqdm import tqdm

from .checks import Numbers, is_concrete, real_array, require_positive, require_x64, whole_number
from .densities import DensityReport, collocation_densities, series_densities
from .geometry import (
    Circle,
    DetectorCurve,
    ImageGrid,
    Region,
    VisibilityWarning,
    fit_circle,
    require_cover,
    require_outside,
    visibility,
)
from .regularization import NormBound, Regularization
from .special import full_circle_norm
from .symmetry import find_mirror

Solver = Callable[[Array, Array, Array], tuple[Array, DensityReport]]
_COMPLEX = {"double": jnp.complex128, "single": jnp.complex64}
_FREQUENCIES_AT_A_TIME = 4

# Kunyansky's K = 1.5 at R_g = 1.3, in the true norm of the full circle (see NormBound)
PAPER_K = 1.5 * float(np.sqrt(2 * np.pi * 1.3))


class AccuracyWarning(UserWarning):
    """Many plane waves could not be written as potentials of the curve."""


class ReconstructionPlan(eqx.Module):
    """Everything steps 2 to 5 need to turn circular integrals into an image.

    Attributes:
        curve, region, grid, radii: the geometry the plan was built for.
        frequencies: lambda_i = i d lambda > 0, (frequencies,) [rad/length].
        angles: theta of the directions, equispaced over half a turn, (directions,) [rad].
        densities: (rho_J, rho_Y), (frequencies, directions, 2, detectors) [1/length].
        regularization: the one that was used; None where the densities are in closed form.
        report: accuracy and norm of the densities.
    """

    curve: DetectorCurve
    region: Region
    grid: ImageGrid
    radii: Float[Array, " radii"]
    frequencies: Float[Array, " frequencies"]
    angles: Float[Array, " directions"]
    densities: Complex[Array, "frequencies directions 2 detectors"]
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
    method: str = "collocation",
    max_frequency: Numbers | None = None,
    n_directions: int | None = None,
    precision: str = "double",
    progress: bool = True,
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
        regularization: `NormBound`, `FixedRank` or `SingularValueCutoff`; by default the paper's
            bound, ``NormBound(PAPER_K)``.
        method: "collocation": singular value decomposition of the potentials on the boundary, for
            any geometry; "series": the closed form for a full circle of equispaced detectors.
        max_frequency: lambda_max [rad/length]; by default π over the larger of pixel and radial
            step, beyond which neither data nor image hold anything.
        n_directions: by default enough for lambda_max, a multiple of 32.
        precision: "single" halves the memory and costs about 1e-7 of accuracy.
        progress: show a progress bar.

    Returns:
        ReconstructionPlan.

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
    radii = real_array("radii", radii, ("radii",))
    if precision not in _COMPLEX:
        raise ValueError(f"precision is {precision!r}, expected 'double' or 'single'.")
    regularization = _rule(method, regularization)
    _require_concrete(curve, region, grid, radii, max_frequency)
    # inside jax.jit too: only the rule's number may be traced
    with jax.ensure_compile_time_eval():
        frequencies, angles = _polar_grid(region, grid, radii, max_frequency, n_directions)
        _require_geometry(curve, region, grid, radii, frequencies[-1])
        solve = _solver(curve, region, regularization, frequencies[-1])
        unit_norms = full_circle_norm(frequencies, fit_circle(curve.points).radius)
    if is_concrete(regularization):
        densities, report = _in_pieces(solve, frequencies, unit_norms, angles, precision, progress)
    else:  # K, j_max or sigma_min is being differentiated: one traced call
        densities, report = solve(frequencies, unit_norms, angles)
        densities = densities.astype(_COMPLEX[precision])
    _warn_of_residuals(report)
    return ReconstructionPlan(
        curve, region, grid, radii, frequencies, angles, densities, regularization, report
    )


def _polar_grid(
    region: Region,
    grid: ImageGrid,
    radii: Array,
    max_frequency: Numbers | None,
    n_directions: int | None,
) -> tuple[Array, Array]:
    """Frequencies i d lambda, i = 1..n, and directions."""
    if max_frequency is None:
        max_frequency = jnp.pi / jnp.maximum(grid.spacing.max(), jnp.diff(radii).max())
    highest = real_array("max_frequency", max_frequency, ())
    require_positive("max_frequency", highest)
    waves = float(highest * region.reach)  # radians across the region's radius
    n_frequencies = max(1, int(np.ceil(2 * waves / np.pi - 1e-6)))
    if n_directions is None:
        # projections and image turn through 2 * waves radians in half a turn; a quarter to spare
        n_directions = 32 * max(1, int(np.ceil(1.25 * waves / 32)))
    n_directions = whole_number("n_directions", n_directions, 1)
    frequencies = highest / n_frequencies * jnp.arange(1, n_frequencies + 1)
    return frequencies, jnp.linspace(0.0, jnp.pi, n_directions, endpoint=False)


def _require_geometry(
    curve: DetectorCurve, region: Region, grid: ImageGrid, radii: Array, highest: Array
) -> None:
    require_outside(curve, region)
    require_cover(curve, region, radii)
    if not bool(region.contains(grid.points).any()):
        raise ValueError(
            f"no node of the image grid (from {grid.points[0, 0]} to {grid.points[-1, -1]}) lies "
            f"in the region of interest, within {float(region.reach):.6g} of {region.center}: "
            "move or widen the grid."
        )
    spacing, half_wave = float(region.weights.max()), float(jnp.pi / highest)
    if spacing > half_wave:
        n_least = int(np.ceil(1.5 * region.points.shape[0] * spacing / half_wave))
        raise ValueError(
            f"boundary points are {spacing:.4g} apart, more than half the shortest wavelength "
            f"({half_wave:.4g}): use n_collocation >= {n_least} or a lower max_frequency."
        )
    seen = visibility(curve, region)
    if seen.invisible_fraction > 0:
        warnings.warn(str(seen), VisibilityWarning, stacklevel=3)


def _rule(method: str, regularization: Regularization | None) -> Regularization | None:
    """The regularisation that will be used, None for the closed form."""
    if method not in ("collocation", "series"):
        raise ValueError(f"method is {method!r}, expected 'collocation' or 'series'.")
    if not (regularization is None or isinstance(regularization, Regularization)):
        raise ValueError(
            f"regularization is {regularization!r}, expected a rule such as NormBound(4.0)."
        )
    if method == "collocation":
        return NormBound(PAPER_K) if regularization is None else regularization
    if regularization is not None:
        raise ValueError("method 'series' is a closed form: it takes no regularization.")
    return None


def _require_concrete(*geometry: Any) -> None:
    if not is_concrete(*geometry):
        raise ValueError(
            "build_plan got traced geometry: its sizes and checks need concrete values; only K, "
            "j_max or sigma_min of the regularization may be traced."
        )


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


def _solver(
    curve: DetectorCurve,
    region: Region,
    regularization: Regularization | None,
    highest: Array,
) -> Solver:
    """Densities and report as a function of (frequencies, unit norms, angles)."""
    if regularization is not None:
        return partial(
            collocation_densities,
            curve=curve,
            region=region,
            regularization=regularization,
            mirror=find_mirror(curve, region),
        )
    circle = _full_circle(curve)
    # 40 + 12 % beyond lambda R_g the terms have fallen below rounding
    n_orders = int(1.12 * float(highest * circle.radius)) + 40
    return partial(series_densities, curve=curve, region=region, circle=circle, n_orders=n_orders)


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


def _in_pieces(
    solve: Solver,
    frequencies: Array,
    unit_norms: Array,
    angles: Array,
    precision: str,
    progress: bool,
) -> tuple[Array, DensityReport]:
    """All frequencies, a few at a time: a progress bar, and little memory besides the result."""
    n = frequencies.shape[0]
    densities, reports = None, []
    with tqdm(total=n, desc="densities", unit="freq", disable=not progress) as bar:
        for start in range(0, n, _FREQUENCIES_AT_A_TIME):
            part = slice(start, start + _FREQUENCIES_AT_A_TIME)
            piece, report = solve(frequencies[part], unit_norms[part], angles)
            if densities is None:
                densities = np.empty((n, *piece.shape[1:]), _COMPLEX[precision])
            densities[part] = piece
            reports.append(report)
            bar.update(piece.shape[0])
    report = jax.tree.map(lambda *pieces: jnp.concatenate(pieces), *reports)
    return jnp.asarray(densities), report
