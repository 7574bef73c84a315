"""From circular integrals to the image, with a plan or without."""

import warnings
from functools import partial
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float

from ..base.checks import Numbers, data_array, is_concrete, require_x64
from ..base.parallel import checked_mesh, map_shards, replicated
from ..base.rows import in_groups
from ..base.size_ladder import reshaped
from ..base.threads import one_blas_thread
from ..densities import Basis
from ..geometry import ImageGrid
from ..regularization import SolveReport, TikhonovRule, tikhonov_rule
from ..steps import UNSAMPLED, AccuracyWarning, warn_of_detectors
from ..steps.inversion import IMAGES, require_inversion
from ..steps.radon import LowPass, low_pass_values
from .pipeline import images_of
from .plan import ReconstructionPlan
from .plane_bases import StoredDensities
from .setup import Setup, require_complete, require_setup
from .sizes import PlaneSizes

FINER = 2  # waves that the detectors sample in the inner half of the region only
TOO_FINE = 0.1  # of the data that is finer than that: images of less were right, to 5 %
MAGNIFIED = 3  # times as much detail as the data hold


class Reconstruction(eqx.Module):
    """An image and a report on its solution.

    Attributes:
        image: f, (..., x1, x2) or (..., x1, x2, x3), the unit of g per length (in space length²).
        report: alpha, residual and convergence at every frequency.
        basis: the waves: "cylindrical", the "boundary" itself, or "spherical".
    """

    image: Float[Array, "..."]
    report: SolveReport
    basis: str = eqx.field(static=True)

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether every frequency has a solution that rounding does not spoil."""
        return self.report.converged.all()


def reconstruct(
    problem: Setup | ReconstructionPlan,
    g: Numbers,
    rule: Any = None,
    *,
    low_pass: LowPass | None = None,
    inversion: str = "fourier",
    mesh: Mesh | None = None,
) -> Float[Array, "..."]:
    """The image f from its integrals g(z, r) = ∫_{|x - z| = r} f over circles or spheres.

    Linear in g for a fixed rule. Meaningful inside the setup's region; mask the rest with
    ``setup.region.contains(setup.grid.points)``.

    Args:
        problem: a `Setup`, solved without precomputation (see `solve`), or a plan of `build_plan`
            or `load_plan`, which takes milliseconds.
        g: float32 or float64, (..., detectors, radii), or (..., rings, azimuths, radii) of a cap.
        rule: as in `solve`; a plan has its own.
        low_pass: eta(lambda / lambda_max), such as `cosine_filter` or "cosine"; none by default.
        inversion: "fourier", or "fbp", the paper's filtered back-projection, which is slower, see
            `steps.inversion.invert`.
        mesh: devices among which the images of a batch (with a plan) or the frequencies are
            divided, see `jaxtat.base.parallel`.

    Returns:
        (..., x1, x2) or (..., x1, x2, x3), the unit of g per length (in space length²).

    Raises:
        ValueError: for data of the wrong shape or dtype, or with NaN, and as `solve`.

    Source: Kunyansky 2008, section 3.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> image = reconstruct(setup, bell.circular_integrals(setup.curve, setup.radii), 1e-10)
    >>> inside = setup.region.contains(setup.grid.points)
    >>> bool(abs(image - bell.image(setup.grid))[inside].max() < 1e-2)
    True
    """
    if isinstance(problem, ReconstructionPlan):
        if rule is not None:
            raise ValueError(
                f"rule is {rule!r}, but the plan has its own: build_plan(setup, rule), or pass the "
                "setup in place of the plan."
            )
        return _by_plan(problem, g, low_pass, inversion, mesh)
    return solve(problem, g, rule, low_pass=low_pass, inversion=inversion, mesh=mesh).image


def solve(
    setup: Setup,
    g: Numbers,
    rule: Any = None,
    *,
    low_pass: LowPass | None = None,
    inversion: str = "fourier",
    mesh: Mesh | None = None,
) -> Reconstruction:
    """The image f from its integrals g without a plan, and a report on the solution.

    In cylindrical (spherical) waves the potentials of the curve are a small matrix A(lambda), and
    one solution of (A A^T + alpha) y = A √w G serves all directions: fhat(xi) = (1/2π) y·u_xi.
    Where detectors are too near for waves about a centre, as on an L or U, A is formed on the
    boundary of the region; the result names the basis. Linear in g for a fixed rule;
    differentiable, through implicit derivatives, with respect to g, the rule's numbers, radii, and
    all positions and sizes of curve, region and grid; a number as rule makes a kink where a closed
    ring begins to open, see `alpha_unit`.

    Args:
        setup: detectors, region, grid and radii.
        g: as in `reconstruct`.
        rule: how much to regularise: a number, relative to the largest diagonal entry of A A^T at
            each frequency (1e-12 for exact data, 1e-3 for poor ones), or one per frequency;
            `NoiseLevel(sigma)` for data with noise of known size, `RelativeTikhonov(kappa)`,
            `TikhonovNormBound(K)` or `Tikhonov(alpha)`. By default ("auto" or None) 1e-6 for
            detectors on a circle that see all of the region (1e-3 at frequencies that they do not
            sample), and in space, else ``RelativeTikhonov(0.1)``, also where lines are missed.
        low_pass, inversion: as in `reconstruct`.
        mesh: devices among which the frequencies are divided, see `jaxtat.base.parallel`.

    Returns:
        Reconstruction: image, report, basis, and whether it converged.

    Raises:
        ValueError: for wrong shapes, NaN, an alpha that is not above zero or so small that rounding
            leaves no image, rules that need a plan, or if 64-bit arithmetic is off.

    Warns:
        AccuracyWarning: if a frequency was not solved, if the data hold finer detail than the
            detectors sample, or alpha is too small for that.

    Source: Kunyansky 2008 for the method; the bases: DLMF 10.23.7 and 10.60.1-3.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> result = solve(setup, bell.circular_integrals(setup.curve, setup.radii), 1e-10)
    >>> bool(result.converged), result.basis
    (True, 'cylindrical')
    """
    require_x64()
    require_setup(setup)
    require_complete(setup)
    require_inversion(inversion)
    mesh = checked_mesh(mesh)
    kind = setup.kind
    data = data_array(g, *setup.data_shape, kind=kind.data)
    automatic = rule is None or (isinstance(rule, str) and rule == "auto")
    used = kind.default_rule(setup.sizes) if automatic else rule
    used = tikhonov_rule(used, setup.sizes.n_frequencies)
    eta = low_pass_values(low_pass, setup.sizes.n_frequencies)
    where = setup.curve, setup.region, setup.radii, setup.sizes
    basis = kind.basis(*where, mesh, *setup.through)
    stack = reshaped(data, (-1, *setup.data_shape))
    basis, stack, grid, used, eta = replicated((basis, stack, setup.grid, used, eta), mesh)
    images, report, energies = solved(basis, stack, grid, used, eta, inversion)
    batch = data.shape[: data.ndim - len(setup.data_shape)]
    images = reshaped(images, (*batch, *setup.grid.shape))
    return judged(setup, Reconstruction(images, report, basis.name), energies)


def solved(
    basis: Basis, stack: Array, grid: Any, rule: TikhonovRule, eta: Array, inversion: str
) -> tuple[Array, SolveReport, Array | None]:
    """`images_of` of a basis that solves, when they are there."""
    with one_blas_thread():
        images, report, energies = jax.block_until_ready(
            images_of(basis, stack, grid, rule, eta, inversion)
        )
    assert report is not None
    return images, report, energies


def judged(setup: Setup, result: Reconstruction, energies: Any) -> Reconstruction:
    """The result, if it is known to be one.

    Args:
        energies: `Basis.energies`, at the frequencies of the setup.

    Raises, warns:
        As `solve`.
    """
    if is_concrete(result):
        _require_finite(result.image)
        _warn_of_solution(result)
        if energies is not None:
            assert isinstance(setup.sizes, PlaneSizes)
            _warn_of_detail(setup.sizes, np.asarray(energies))
    return result


def _require_finite(image: Array) -> None:
    """Raise ValueError where rounding left no solution; the data were finite."""
    if not np.isfinite(np.asarray(image)).all():
        raise ValueError(
            "the image is NaN or infinite: alpha is so small that the systems are singular to "
            "rounding. Take a larger alpha; 1e-12 suits exact data."
        )


def _warn_of_solution(result: Reconstruction) -> None:
    bad = ~np.asarray(result.report.converged)
    if bad.any():
        warnings.warn(
            f"alpha is so small that rounding spoils {int(bad.sum())} of {bad.size} frequencies "
            f"(worst residual {float(result.report.residual.max()):.1e}): take a larger alpha.",
            AccuracyWarning,
            stacklevel=3,
        )


def _warn_of_detail(sizes: PlaneSizes, energies: np.ndarray) -> None:
    """Warn if detectors are too few for the data, or alpha is too small for so few.

    Waves that they sample in less than the inner half of the region come out wrong, those between
    do if nothing holds their densities down.
    """
    highest, frequencies = sizes.max_frequency, np.asarray(sizes.frequencies)
    of_data, of_image = energies / np.maximum(energies.sum(axis=1, keepdims=True), 1e-300)
    possible = sizes.sampled * highest
    beyond = frequencies > possible
    finer = np.sqrt(of_data[frequencies > FINER * possible].sum())
    in_data, in_image = np.sqrt([of_data[beyond].sum(), of_image[beyond].sum()])
    if finer > TOO_FINE:
        said = f"{100 * finer:.0f} % of what the data hold is at least {FINER} times as fine"
        warn_of_detectors(highest, possible, said, stacklevel=3)
    elif in_image > MAGNIFIED * in_data + UNSAMPLED:
        said = (
            f"of detail beyond that the image holds {100 * in_image:.0f} %, the data "
            f"{100 * in_data:.0f} % (a larger alpha magnifies it less)"
        )
        warn_of_detectors(highest, possible, said, stacklevel=3)


def _by_plan(
    plan: ReconstructionPlan, g: Numbers, low_pass: LowPass | None, inversion: str, mesh: Any
) -> Array:
    data = data_array(g, *plan.setup.data_shape)
    eta = low_pass_values(low_pass, plan.setup.sizes.n_frequencies)
    require_inversion(inversion)
    mesh = checked_mesh(mesh)
    # not the whole plan: those of other rules share the program
    basis, grid, data, eta = replicated((plan.basis, plan.grid, data, eta), mesh)
    return _by_densities(basis, grid, data, eta, inversion, mesh)


@eqx.filter_jit
def _by_densities(
    basis: StoredDensities,
    grid: ImageGrid,
    g: Array,
    eta: Array,
    inversion: str,
    mesh: Mesh | None,
) -> Array:
    def of_group(basis: StoredDensities, grid: ImageGrid, eta: Array, g: Array) -> Array:
        return images_of(basis, g, grid, None, eta, inversion)[0]

    stack = g.reshape(-1, *g.shape[-2:])
    images = map_shards(
        lambda common, part: in_groups(partial(of_group, *common), part, IMAGES[inversion]),
        (basis, grid, eta),
        stack,
        mesh,
    )
    return images.reshape(*g.shape[:-2], *grid.shape)
