"""Reconstruction without a plan: curve, radii and alpha may be new in every call."""

import warnings
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Complex, Float

from ..boundary import BoundaryGeometry, geometry_for, solve_on_boundary
from ..checks import Numbers, data_array, is_concrete, real_array, require_objects, require_x64
from ..geometry import DetectorCurve, ImageGrid, Region
from ..harmonic import (
    AlphaRule,
    Data,
    PolarGeometry,
    SolveReport,
    alpha_rule,
    circular_harmonics_at,
    solve_harmonics,
)
from ..layout import Layout, problem_layout
from ..parallel import checked_mesh, replicated
from ..problem import UNSAMPLED, AccuracyWarning, warn_of_detectors
from ..regularization import DEFAULT_KAPPA, RelativeTikhonov
from ..unit_norm import unit_norms
from .inversion import invert, require_inversion
from .polar_fourier import with_origin
from .radial_transform import noise_power, radial_transform, total_integrals
from .radon import LowPass, low_pass_values

DEFAULT_ALPHA = 1e-6  # of detectors on a circle that see all of the region
# Where there are about as many data as unknown waves, a smaller one magnifies all errors: the
# worst number of detectors is neither the least nor the largest.
UNSAMPLED_ALPHA = 1e-3
FINER = 2  # waves that the detectors sample in the inner half of the region only
MAGNIFIED = 3  # times as much detail as the data hold
DEFAULT_TOLERANCE = 1e-10  # of conjugate gradients


class DirectReconstruction(eqx.Module):
    """An image and how it was come by.

    Attributes:
        image: f, (..., x1, x2), the unit of g per length.
        report: alpha, residual and convergence at every frequency.
        basis: in which the densities were found: "cylindrical" waves, or the "boundary" itself.
    """

    image: Float[Array, "*batch x1 x2"]
    report: SolveReport
    basis: str = eqx.field(static=True)

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether every frequency was solved as accurately as was asked."""
        return self.report.converged.all()


def reconstruct_direct(
    curve: DetectorCurve,
    region: Region,
    grid: ImageGrid,
    radii: Numbers,
    g: Numbers,
    alpha: Any = None,
    *,
    low_pass: LowPass | None = None,
    max_frequency: Numbers | None = None,
    n_directions: int | None = None,
    solver: str = "auto",
    tolerance: float = DEFAULT_TOLERANCE,
    inversion: str = "fbp",
    layout: Layout | None = None,
    mesh: Mesh | None = None,
) -> DirectReconstruction:
    """The image f from circular integrals g, with nothing computed beforehand.

    In cylindrical waves the potentials of the curve are a small matrix A(lambda), and one solution
    of (A A^T + alpha) y = A √w G serves all directions: fhat(xi) = (1/2π) y·u_xi. Around detectors
    that are too near for waves about a centre, on an L or U, A is taken on the boundary itself, see
    `boundary`; the result tells its basis. Steps 4 and 5 follow as in `reconstruct`. Linear in g;
    differentiable, through implicit derivatives, with respect to g, alpha, radii, and all positions
    and sizes of curve, region and grid; a number as alpha makes a kink where a closed ring begins
    to open, see `alpha_unit`.

    Args:
        curve: the detectors, all outside the region.
        region: region of interest; outside it the image means nothing.
        grid: where the image is wanted.
        radii: r > 0 of the data, increasing, covering region and sources, (radii,) [length].
        g: circular integrals, float32 or float64, (..., detectors, radii).
        alpha: above zero, relative to the strongest wave at each frequency, `alpha_unit` (on the
            boundary: to 8/lambda²); a number or one per frequency. 1e-12 for exact data, 1e-3 for
            poor ones. Or a rule: ``RelativeCutoff(kappa)``, alpha = 8 kappa²/lambda², ``NoiseLevel(
            sigma)`` for data with noise of known size, ``NormBound(K)`` for densities with root
            mean square norm K N(lambda). By default ("auto" or None) 1e-6 for detectors on a
            circle that see all of the region (1e-3 at frequencies that they do not sample), else
            ``RelativeCutoff(0.1)``, which holds whatever they see: `build_plan`.
        low_pass: eta(lambda / lambda_max), such as `cosine_filter` or "cosine"; none by default.
        max_frequency, n_directions: as in `build_plan`.
        solver: "cholesky", "cg" (preconditioned conjugate gradients), or by size ("auto").
        tolerance: relative residual at which conjugate gradients stop.
        inversion: "fbp" or "fourier", see `inversion.invert`.
        layout: of `problem_layout`; needed where the geometry is traced by `jax.jit`. It has
            decided max_frequency, n_directions and solver.
        mesh: devices among which the frequencies are divided, see `jaxtat.parallel`.

    Returns:
        DirectReconstruction: image, and a report with ``converged``.

    Raises:
        ValueError: for detectors in the region, radii that do not cover it, wrong shapes, NaN,
            alpha not above zero, or 64-bit arithmetic off.

    Warns:
        VisibilityWarning: if lines through the region miss the curve.
        AccuracyWarning: if a frequency was not solved, if the data hold finer detail than the
            detectors sample, or alpha is too small for that.

    Source: Kunyansky 2008 for the method; the basis: DLMF 10.23.7.

    >>> from jaxtat import circular_arc, data_radii, phantoms, truncated_disk
    >>> curve, region = circular_arc(1.3, 1.0, 80), truncated_disk(1.0, 1.0, 160)
    >>> grid = ImageGrid(21)
    >>> radii = data_radii(curve, region, grid.spacing[0])
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> g = bell.circular_integrals(curve, radii)
    >>> found = reconstruct_direct(curve, region, grid, radii, g, alpha=1e-10)
    >>> inside = region.contains(grid.points)
    >>> bool(found.converged), bool(jnp.abs(found.image - bell.image(grid))[inside].max() < 1e-2)
    (True, True)
    """
    require_x64()
    require_objects(curve=curve, region=region, grid=grid)
    require_inversion(inversion)
    mesh = checked_mesh(mesh)
    radii = real_array("radii", radii, ("radii",))
    values = data_array(g, curve.n_detectors, radii.shape[0])
    if layout is None:
        layout = problem_layout(
            curve,
            region,
            grid,
            radii,
            max_frequency=max_frequency,
            n_directions=n_directions,
            solver=solver,
        )
    given = direct_arguments(curve, region, grid, radii, values, alpha, low_pass, layout)
    arguments = replicated(given, mesh)
    found, energies = _direct(arguments, layout, tolerance, inversion, mesh)
    if is_concrete(found):
        _warn_of_solution(found)
        if energies is not None:
            _warn_of_detail(layout, np.asarray(energies))
    return found


def _warn_of_solution(found: DirectReconstruction) -> None:
    bad = ~np.asarray(found.report.converged)
    if bad.any():
        warnings.warn(
            f"{int(bad.sum())} of {bad.size} frequencies were not solved to the tolerance "
            f"(worst residual {float(found.report.residual.max()):.1e}): use solver='cholesky' or "
            "a larger alpha.",
            AccuracyWarning,
            stacklevel=3,
        )


def _warn_of_detail(layout: Layout, energies: np.ndarray) -> None:
    """Say so if detectors are too few for the data, or for so small an alpha.

    Waves that they sample in less than the inner half of the region come out wrong, those between
    do if nothing holds their densities down.
    """
    highest, frequencies = layout.max_frequency, np.asarray(layout.frequencies)
    of_data, of_image = energies / np.maximum(energies.sum(axis=1, keepdims=True), 1e-300)
    possible = layout.sampled * highest
    beyond = frequencies > possible
    finer = np.sqrt(of_data[frequencies > FINER * possible].sum())
    in_data, in_image = np.sqrt([of_data[beyond].sum(), of_image[beyond].sum()])
    if finer > UNSAMPLED:
        said = f"{100 * finer:.0f} % of what the data hold is at least {FINER} times as fine"
        warn_of_detectors(highest, possible, said, stacklevel=3)
    elif in_image > MAGNIFIED * in_data + UNSAMPLED:
        said = (
            f"of detail beyond that the image holds {100 * in_image:.0f} %, the data "
            f"{100 * in_data:.0f} % (a larger alpha magnifies it less)"
        )
        warn_of_detectors(highest, possible, said, stacklevel=3)


class DirectArguments(eqx.Module):
    """What of a direct reconstruction is traced, checked beforehand."""

    geometry: PolarGeometry | BoundaryGeometry
    grid: ImageGrid
    radii: Float[Array, " radii"]
    g: Float[Array, "*batch detectors radii"]
    rule: AlphaRule
    eta: Float[Array, " frequencies"]
    unit_norm: Float[Array, " fewer"]


def direct_arguments(
    curve: DetectorCurve,
    region: Region,
    grid: ImageGrid,
    radii: Array,
    g: Array,
    alpha: Any,
    low_pass: LowPass | None,
    layout: Layout,
) -> DirectArguments:
    """Rules made of what a user gives as alpha and low_pass; the other arguments are checked."""
    n = layout.n_frequencies
    if alpha is None or (isinstance(alpha, str) and alpha == "auto"):
        alpha = RelativeTikhonov(DEFAULT_KAPPA)
        if layout.as_in_the_paper:
            sampled = layout.frequencies <= layout.sampled * layout.max_frequency * (1 + 1e-9)
            alpha = jnp.where(sampled, DEFAULT_ALPHA, UNSAMPLED_ALPHA)
    rule = alpha_rule(alpha, n)
    eta = low_pass_values(low_pass, n)
    unit_norm = jnp.ones(n)  # not asked for
    if rule.needs_matrix:
        unit_norm = unit_norms(curve, region, layout.frequencies, layout.norm_orders)
    geometry = geometry_for(curve, region, layout)
    return DirectArguments(geometry, grid, radii, g, rule, eta, unit_norm)


def _direct(
    given: DirectArguments, layout: Layout, tolerance: float, inversion: str, mesh: Mesh | None
) -> tuple[DirectReconstruction, Array | None]:
    """And the energies of data and image at every frequency, if detectors do not sample all."""
    # several programs: as one, XLA has been seen to wait for ever with two devices on one CPU
    data = _transformed(given, layout)
    if isinstance(given.geometry, BoundaryGeometry):
        fhat, report = _solve_on_boundary(given.geometry, data, layout, tolerance, mesh)
    else:
        harmonics, report = _solve(given.geometry, data, layout, tolerance, mesh)
        fhat = _on_polar_grid(given.geometry, harmonics, layout)
    energies = None if layout.sampled == 1 else _energies(data, fhat, layout)
    fhat = _with_origin(given, fhat)
    step = jnp.asarray(layout.max_frequency / layout.n_frequencies)
    center, angles = given.geometry.region.center, layout.angles
    image = invert(fhat, step, angles, given.grid, center, given.eta, inversion)
    image = image.reshape(*given.g.shape[:-2], *given.grid.shape)
    return DirectReconstruction(image, report, layout.basis), energies


@eqx.filter_jit
def _energies(data: Data, fhat: Array, layout: Layout) -> Float[Array, "2 frequencies"]:
    """Of the image, ∫ |fhat|² lambda dtheta, up to a factor: as the data tell, and as it came out.

    A wave's integrals (G_J, G_Y) have the mean square |fhat|²/lambda, times what of it is seen.
    """
    of_data = layout.frequencies**2 * jnp.mean(data.transformed**2, axis=(1, 2, 3))
    return jnp.stack([of_data, layout.frequencies * jnp.mean(jnp.abs(fhat) ** 2, axis=(0, 2))])


def direct_image(given: DirectArguments, layout: Layout) -> Float[Array, "*batch x1 x2"]:
    """The image alone, of arguments that have been checked; everything may be traced."""
    return _direct(given, layout, DEFAULT_TOLERANCE, "fbp", None)[0].image


def _images(g: Float[Array, "*batch detectors radii"]) -> Float[Array, "images detectors radii"]:
    return g.reshape(-1, *g.shape[-2:])


@eqx.filter_jit
def _transformed(given: DirectArguments, layout: Layout) -> Data:
    """Step 2."""
    frequencies = layout.frequencies
    found = radial_transform(_images(given.g), given.radii, frequencies)
    return Data(
        transformed=jnp.moveaxis(found, 1, 0),
        noise_power=noise_power(given.radii, frequencies, given.geometry.weights),
        unit_norm=given.unit_norm,
        rule=given.rule,
    )


@eqx.filter_jit
def _solve(
    geometry: PolarGeometry, data: Data, layout: Layout, tolerance: float, mesh: Mesh | None
) -> tuple[Float[Array, "images frequencies 2 orders"], SolveReport]:
    """Steps 1 and 3, up to the sum of the circular harmonics."""
    frequencies = layout.frequencies
    return solve_harmonics(
        geometry, frequencies, layout.groups, data, layout.solver, tolerance, mesh
    )


@eqx.filter_jit
def _solve_on_boundary(
    geometry: BoundaryGeometry, data: Data, layout: Layout, tolerance: float, mesh: Mesh | None
) -> tuple[Complex[Array, "images frequencies directions"], SolveReport]:
    """Steps 1 and 3."""
    return solve_on_boundary(
        geometry, layout.frequencies, layout.angles, data, layout.solver, tolerance, mesh
    )


@eqx.filter_jit
def _on_polar_grid(
    geometry: PolarGeometry, harmonics: Array, layout: Layout
) -> Complex[Array, "images frequencies directions"]:
    """fhat on the polar grid, phases counted from the region's centre."""
    angles = layout.angles
    fhat = circular_harmonics_at(harmonics, angles - geometry.axis)
    if not geometry.disk:  # the harmonics count them from the centre of the waves
        directions = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
        along = directions @ (geometry.region.center - geometry.center)
        fhat = fhat * jnp.exp(1j * layout.frequencies[:, None] * along)
    return fhat


@eqx.filter_jit
def _with_origin(
    given: DirectArguments, fhat: Array
) -> Complex[Array, "images all_frequencies directions"]:
    """With frequency 0 in front."""
    mass = total_integrals(_images(given.g), given.radii)
    return with_origin(fhat, mass, given.geometry.weights)
