"""Diagnosis of one reconstruction: visibility, residual, accuracy and uncertainty."""

import time

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, real_array, require_positive, require_x64
from ..geometry import ImageGrid, Visibility, visibility, visibility_map
from ..reconstruction import Reconstruction, ReconstructionPlan, Setup, build_plan, reconstruct
from ..reconstruction.setup import plane_of
from ..regularization import RelativeTikhonov, Tikhonov
from ..steps.radon import LowPass, low_pass_values
from .data_noise import DataNoise, NoiseSource, noise_of_residual
from .residual import DataResidual, data_residual
from .uncertainty import BLOCK, pixel_standard_deviation

UNCERTAINTY_PIXELS = 3 * BLOCK  # nodes per axis, of plans that are not too large for it
MOST_WORK = 1e11  # multiplications for standard deviations that were not asked for: half a minute


class WaveAccuracy(eqx.Module):
    """How well plane waves are approximated by potentials of the curve, and how they amplify noise.

    Attributes:
        frequencies: lambda, (frequencies,) [rad/length].
        angles: theta, (directions,) [rad].
        residual: relative L2 error of exp(-i xi·x) on the region's boundary, 1 where nothing of a
            wave is left, (frequencies, directions).
        noise_gain: norm of its densities over lambda √b / 2, b the breadth of the region across
            the wave: about 1 for a wave that the curve records on both sides, √2 on one side only,
            more where densities nearly cancel, (frequencies, directions).
        low_pass: eta at the frequencies, by which fhat is multiplied besides, (frequencies,).
    """

    frequencies: Float[Array, " frequencies"]
    angles: Float[Array, " directions"]
    residual: Float[Array, "frequencies directions"]
    noise_gain: Float[Array, "frequencies directions"]
    low_pass: Float[Array, " frequencies"]


class Uncertainty(eqx.Module):
    """Standard deviations of pixels.

    Attributes:
        grid: its nodes, fewer than the image has.
        deviation: (x1, x2), NaN outside the region [unit of f].
        sigma: standard deviation of independent noise in every sample of g that does as much to
            the image as the noise of the data.
        seconds: that it took.
    """

    grid: ImageGrid
    deviation: Float[Array, "x1 x2"]
    sigma: Float[Array, ""]
    seconds: float = eqx.field(static=True)


class Diagnosis(eqx.Module):
    """The result of `diagnose`.

    Attributes:
        setup, g: the problem and the data.
        image: NaN outside the region, (x1, x2).
        lines: which lines through the region meet the curve.
        visible: share of edge directions seen at each pixel, NaN outside the region, (x1, x2).
        residual: what the image does not explain.
        noise: how much of that is noise.
        waves, uncertainty: None without a plan.
    """

    setup: Setup
    g: Float[Array, "detectors radii"]
    image: Float[Array, "x1 x2"]
    lines: Visibility
    visible: Float[Array, "x1 x2"]
    residual: DataResidual
    noise: DataNoise
    waves: WaveAccuracy | None
    uncertainty: Uncertainty | None


def diagnose(
    setup: Setup,
    g: Numbers,
    image: Numbers,
    *,
    plan: ReconstructionPlan | None = None,
    sigma: Numbers | None = None,
    noise: Numbers | None = None,
    low_pass: LowPass | None = None,
    inversion: str = "fourier",
    uncertainty_pixels: int | None = None,
    progress: bool = False,
) -> Diagnosis:
    """Visibility, residual, accuracy of plane waves and standard deviations of one image.

    Args:
        setup: in the plane, concrete.
        g: circular integrals of one image, (detectors, radii).
        image: what was reconstructed, (x1, x2).
        plan: the plan of the reconstruction, or `plan_of`. Without one there is nothing on
            plane waves and uncertainty.
        sigma: standard deviation of the noise in every sample of g; by default that of
            `noise_of_residual`.
        noise: in place of sigma, a sample of the data's noise, (detectors, radii), which need not
            be white: what the record holds without sound, made into circular integrals.
        low_pass, inversion: of the reconstruction.
        uncertainty_pixels: nodes per axis at which standard deviations are computed, 0 for none; by
            default `affordable_pixels` of the plan.
        progress: show progress bars.

    Returns:
        Diagnosis.

    Raises:
        ValueError: for shapes that do not fit each other, NaN, sigma not above zero, or sigma
            beside noise.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 0.2, 12), disk(1.0, 0.0), ImageGrid(41), max_frequency=10.0)
    >>> bell = phantoms.Bells([[-0.5, 0.0]], [0.5])
    >>> g = bell.circular_integrals(setup.curve, setup.radii)
    >>> result = diagnose(setup, g, bell.image(setup.grid))
    >>> bool(result.residual.relative < 2e-3), bool(result.lines.invisible_fraction == 0)
    (True, True)
    """
    require_x64()
    curve, region, _, _ = plane_of(setup)
    if sigma is not None and noise is not None:
        raise ValueError("sigma and noise are both given, expected one of them at most.")
    if sigma is not None:
        sigma = real_array("sigma", sigma, ())
        require_positive("sigma", sigma)
    residual = data_residual(setup, g, image)
    if noise is not None:
        noise = real_array("noise", noise, residual.values.shape)
    data_noise = _noise(setup, residual, sigma, noise)
    inside = region.contains(setup.grid.points)
    uncertainty = None
    if uncertainty_pixels is None:
        uncertainty_pixels = 0 if plan is None else affordable_pixels(plan)
    if plan is not None and uncertainty_pixels:
        options = {"low_pass": low_pass, "inversion": inversion, "progress": progress}
        uncertainty = _uncertainty(plan, data_noise, noise, uncertainty_pixels, options)
    return Diagnosis(
        setup=setup,
        g=jnp.asarray(g, float),
        image=jnp.where(inside, jnp.asarray(image, float), jnp.nan),
        lines=visibility(curve, region),
        visible=jnp.where(inside, visibility_map(curve, setup.grid), jnp.nan),
        residual=residual,
        noise=data_noise,
        waves=None if plan is None else wave_accuracy(plan, low_pass),
        uncertainty=uncertainty,
    )


def wave_accuracy(plan: ReconstructionPlan, low_pass: LowPass | None = None) -> WaveAccuracy:
    """Accuracy of every plane wave, from a plan's report.

    The least norm of densities is known for short waves: a line along the wave that crosses the
    curve with the transverse weight W takes lambda²/(2 W) per unit of offset, and W is 2 for a line
    that crosses it squarely on both sides.
    """
    report, n = plan.report, plan.frequencies.shape[0]
    across = jnp.stack([-jnp.sin(plan.angles), jnp.cos(plan.angles)])
    breadth = jnp.ptp(plan.region.points @ across, axis=0)
    gain = report.norm / (plan.frequencies[:, None] * jnp.sqrt(breadth) / 2)
    eta = low_pass_values(low_pass, n)[1:]
    return WaveAccuracy(plan.frequencies, plan.angles, report.residual, gain, eta)


def affordable_pixels(plan: ReconstructionPlan) -> int:
    """24 nodes per axis, 16 or 8 of plans so large that standard deviations would take too long.

    For each pixel the kernels, the densities and the ramp are multiplied with once.
    """
    n_detectors, n_radii = plan.setup.data_shape
    return _affordable(n_detectors, n_radii, len(plan.frequencies), len(plan.angles))


def _affordable(n_detectors: int, n_radii: int, n: int, n_directions: int) -> int:
    """`affordable_pixels` of a plan with n frequencies."""
    ramp = 12 * n * n_directions  # from 2 n offsets to three times as many nodes, over n
    work = n * (2 * n_detectors * (n_radii + n_directions) + ramp)
    blocks = int(np.sqrt(MOST_WORK / work)) // BLOCK
    return BLOCK * int(np.clip(blocks, 1, UNCERTAINTY_PIXELS // BLOCK))


def plan_of(
    setup: Setup, solution: Reconstruction, *, progress: bool = False
) -> ReconstructionPlan:
    """The plan with the same images as `solve`.

    `solve` never forms densities, and so cannot report their accuracy and norm. A plan with its
    alpha at every frequency does, and takes the time of a plan.

    Args:
        setup: of the reconstruction.
        solution: from `solve`.
        progress: show a progress bar.
    """
    relative = solution.report.relative_alpha
    cylindrical = solution.basis == "cylindrical"
    rule = Tikhonov(relative) if cylindrical else RelativeTikhonov(jnp.sqrt(relative))
    method = "cylindrical" if cylindrical else "collocation"
    return build_plan(setup, rule, method=method, progress=progress)


def _noise(
    setup: Setup, residual: DataResidual, sigma: Array | None, sample: Array | None
) -> DataNoise:
    if sigma is not None:
        return DataNoise(sigma, NoiseSource.GIVEN)
    if sample is None:
        return noise_of_residual(setup, residual)
    square = jnp.sum(residual.meets * sample**2) / jnp.sum(residual.meets)
    return DataNoise(jnp.sqrt(square), NoiseSource.RECORD)


def _uncertainty(
    plan: ReconstructionPlan, noise: DataNoise, sample: Array | None, n: int, options: dict
) -> Uncertainty:
    """Standard deviations for white noise, as strong as the noise in the sample's image."""
    grid = ImageGrid(n, plan.grid.half_width, plan.grid.center)
    start = time.perf_counter()
    unit = pixel_standard_deviation(plan, 1.0, grid=grid, **options).block_until_ready()
    sigma = noise.sigma
    if sample is not None:
        here = eqx.tree_at(lambda tree: tree.setup.grid, plan, grid)  # noise differs between pixels
        made = reconstruct(
            here, sample, low_pass=options["low_pass"], inversion=options["inversion"]
        )
        inside = jnp.isfinite(unit)
        sigma = jnp.sqrt(jnp.sum(made**2, where=inside) / jnp.nansum(unit**2))
    return Uncertainty(grid, sigma * unit, sigma, time.perf_counter() - start)
