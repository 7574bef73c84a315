"""Reconstruction in space: steps 1 to 5 in a row, nothing computed beforehand."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..checks import Numbers, data_array, real_array, require_x64
from ..geometry import VolumeGrid
from ..harmonic.tikhonov import SolveReport
from ..reconstruction.inversion import require_inversion
from ..reconstruction.radial_transform import total_integrals
from ..reconstruction.radon import LowPass, low_pass_values
from .alpha import cap_alpha_rule
from .caps import Detectors, SphericalCap
from .inversion import meridian_projections, slices_of_projections
from .layout import CapLayout, cap_layout, require_fitting
from .regions import BallPart
from .scattered import solve_points
from .tikhonov import solve_rings

DEFAULT_ALPHA = 1e-6


class CapReconstruction(eqx.Module):
    """A volume and how it was come by.

    Attributes:
        volume: f, (..., x1, x2, x3), the unit of g per length².
        report: alpha, residual and convergence at every frequency.

    >>> of_each = jnp.ones(3)
    >>> report = SolveReport(of_each, of_each, 0 * of_each, of_each.astype(int), of_each < 2)
    >>> found = CapReconstruction(jnp.zeros((5, 4, 4, 4)), report)  # five volumes
    >>> bool(found.converged)
    True
    """

    volume: Float[Array, "*batch x1 x2 x3"]
    report: SolveReport

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether every frequency was solved."""
        return self.report.converged.all()


def reconstruct_cap(
    detectors: Detectors,
    region: BallPart,
    grid: VolumeGrid,
    radii: Numbers,
    g: Numbers,
    alpha: Any = DEFAULT_ALPHA,
    *,
    low_pass: LowPass | None = None,
    max_frequency: Numbers | None = None,
    inversion: str = "fourier",
    layout: CapLayout | None = None,
) -> CapReconstruction:
    """The volume f from its integrals g(z, r) = ∫_{|x - z| = r} f dS over spheres about detectors.

    In spherical waves the potentials of the cap are a matrix A(lambda) that falls apart into small
    ones, one for each azimuthal order. One solution of (A A^T + alpha) y = A √w G serves all
    directions: fhat follows on spheres |xi| = lambda, and f by two-dimensional Fourier inversions,
    first in meridian planes, then in horizontal ones. Linear in g; differentiable, through implicit
    derivatives, with respect to g, alpha, radii, and all positions and sizes of detectors, region
    and grid.

    Args:
        detectors: a `spherical_cap`, or `DetectorPoints` for a small number of any positions.
        region: region of interest, `ball_part`, with the centre of the detectors; outside it the
            volume means nothing.
        grid: where the volume is wanted.
        radii: r > 0 of the data, increasing, covering region and sources, (radii,) [length]; see
            `cap_radii`.
        g: spherical integrals, float32 or float64, (..., rings, azimuths, radii) of a cap, (...,
            detectors, radii) of points.
        alpha: above zero, relative to the largest diagonal entry of A A^T at each frequency (see
            `spherical.alpha`); a number or one per frequency: 1e-12 for exact data, 1e-3 for poor
            ones. Or a rule: ``NoiseLevel(sigma)`` for data with noise of known size,
            ``SeenOnce(kappa)`` by how well the cap sees a wave.
        low_pass: eta(lambda / lambda_max), such as `cosine_filter` or "cosine"; none by default.
        max_frequency: lambda_max [rad/length]; by default π over the larger of grid and radial
            step.
        inversion: of both stages. "fourier", for f that vanishes outside the ball about the region,
            or "fbp", slower, if sources lie there.
        layout: of `cap_layout`; needed where the geometry is traced by `jax.jit`. It has decided
            max_frequency.

    Returns:
        CapReconstruction: volume, and a report with ``converged``.

    Raises:
        ValueError: for detectors in the region or with another centre, `DetectorPoints` and a cut
            region, radii that do not cover it, wrong shapes, NaN, alpha not above zero, or 64-bit
            arithmetic off.

    Warns:
        VisibilityWarning: if lines through the region miss the detectors.
        AccuracyWarning: if the detectors are too far apart for max_frequency.

    Source: Kunyansky 2008, sections 3 and 5, for the method; the basis: DLMF 10.60.1-3.

    >>> from jaxtat import VolumeGrid
    >>> from jaxtat.spherical import Bells, ball_part, cap_radii, spherical_cap
    >>> cap, region, grid = spherical_cap(1.5, 1.1, 24, 56), ball_part(1.0), VolumeGrid(17)
    >>> radii = cap_radii(cap, region, grid.spacing[0] / 2)
    >>> bell = Bells([[0.1, 0.0, -0.1]], [0.8])
    >>> g = bell.spherical_integrals(cap, radii)
    >>> found = reconstruct_cap(cap, region, grid, radii, g, alpha=1e-9)
    >>> bool(found.converged), bool(abs(found.volume - bell.volume(grid)).max() < 3e-2)
    (True, True)
    """
    require_x64()
    require_inversion(inversion)
    radii = real_array("radii", radii, ("radii",))
    data = data_array(g, *detectors.shape, radii.shape[0], kind="spherical")
    require_fitting(detectors, region)
    if layout is None:
        layout = cap_layout(detectors, region, grid, radii, max_frequency=max_frequency)
    rule = cap_alpha_rule(alpha, layout.n_frequencies)
    n = layout.n_frequencies
    eta = low_pass_values(low_pass, n)
    if isinstance(detectors, SphericalCap):
        spectra, report = solve_rings(detectors, region, radii, data, rule, layout)
    else:
        spectra, report = solve_points(detectors, region, radii, data, rule, layout)
    volumes = []
    for number, mass in enumerate(total_mass(detectors, radii, data)):
        planes = meridian_projections(
            spectra, jnp.asarray(number), mass, grid, detectors.center, eta, layout, inversion
        )
        volumes.append(slices_of_projections(planes, grid, detectors.center, layout, inversion))
    batch = data.shape[: data.ndim - len(detectors.shape) - 1]
    volume = jnp.stack(volumes).reshape(*batch, *grid.shape)
    return CapReconstruction(volume, report)


@jax.jit
def total_mass(
    detectors: Detectors, radii: Float[Array, " radii"], g: Float[Array, "*images_detectors radii"]
) -> Float[Array, " images"]:
    """∫ f dx = ∫ g dr for every detector, the mean over all."""
    weights = detectors.weights.reshape(-1)
    masses = total_integrals(g, radii).reshape(-1, weights.shape[0])
    return masses @ weights / weights.sum()
