"""The error that a plan will make of data with noise, frequency by frequency: which rule is best.

For noise of standard deviation sigma in every sample of g, and images of which only the power
P(lambda) = mean |fhat(xi)|² over directions is known, densities with the residual e on the boundary
give, as accurately as e represents the error inside the region,

    E |fhat_image - fhat|² = P(lambda) e² + sigma² p(lambda) ||rho||² / 4π²,

p the power of unit noise in the radial transform: the error that the rule causes, and the noise
that the densities let through. A rule's number moves error from one term to the other.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.checks import Numbers, data_array, real_array, require_positive
from ..reconstruction import ReconstructionPlan
from ..reconstruction.plan import require_plan
from ..steps.radial_transforms import kernel_noise_power, transform_by


def expected_error(
    plan: ReconstructionPlan, sigma: Numbers, power: Numbers
) -> Float[Array, " frequencies"]:
    """E |fhat_image - fhat|² at each frequency of a plan, mean over directions.

    The expected square error of the image, ∫ E|f_image - f|² dx, is 2π ∫ of it lambda dlambda, so
    that the best rule is the one with the least at each frequency. Of all densities Tikhonov's have
    the least: with the best alpha they are the Wiener filter of this problem. Differentiable, also
    through `build_plan`.

    Args:
        plan: of the rule in question.
        sigma: standard deviation of the noise in every sample of g, above zero.
        power: P(lambda), the mean of |fhat|² over directions, from images alike or from
            `image_power` of the data, (frequencies,).

    Returns:
        (frequencies,).

    Raises:
        ValueError: for sigma or power that are not positive, or something else than a plan.

    Source: the bias-variance trade-off; the paper leaves K to experience (section 3.2).

    >>> from jaxtat import ImageGrid, NormBound, Setup, build_plan, circular_arc, disk
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> K, power = jnp.array([2.0, 4.0, 8.0]), 1e-4 * jnp.arange(1.0, 21.0) ** -3
    >>> plans = [build_plan(setup, NormBound(bound)) for bound in K]
    >>> errors = jnp.stack([expected_error(plan, 0.1, power) for plan in plans])
    >>> best = build_plan(setup, NormBound(K[errors.argmin(axis=0)]))  # K(lambda)
    >>> bool((expected_error(best, 0.1, power) <= errors.min(axis=0) * 1.000001).all())
    True
    """
    require_plan(plan)
    sigma = real_array("sigma", sigma, ())
    power = real_array("power", power, plan.frequencies.shape)
    require_positive("sigma", sigma)
    require_positive("power", power)
    return power * jnp.mean(plan.report.residual**2, axis=1) + _noise(plan, sigma)


def image_power(
    plan: ReconstructionPlan, g: Numbers, sigma: Numbers
) -> Float[Array, " frequencies"]:
    """P(lambda) from data: mean |fhat|² over directions, less what noise adds to it.

        P = mean_theta [|fhat|² - sigma² p(lambda) ||rho||² / 4π²],

    averaged over neighbouring frequencies, a tenth of lambda to each side, and at least a hundredth
    of what is subtracted.

    Args:
        plan: for the data.
        g: circular integrals, (..., detectors, radii).
        sigma: standard deviation of the noise in every sample of g.

    Returns:
        (frequencies,), for `expected_error`.

    Raises:
        ValueError: for data that do not fit the plan, or something else than a plan.

    >>> from jaxtat import ImageGrid, Setup, build_plan, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> plan, bell = build_plan(setup), phantoms.Bells([[0.2, 0.1]], [0.6])
    >>> power = image_power(plan, bell.circular_integrals(setup.curve, setup.radii), 1e-6)
    >>> exact = jnp.mean(jnp.abs(bell.fourier(plan.frequencies, plan.angles)) ** 2, axis=1)
    >>> bool(abs(power[4] / exact[4] - 1) < 0.2)
    True
    """
    require_plan(plan)
    values = data_array(g, *plan.setup.data_shape)
    sigma = real_array("sigma", sigma, ())
    return _power(plan, values.reshape(-1, *values.shape[-2:]), sigma)


@eqx.filter_jit
def _power(plan: ReconstructionPlan, g: Array, sigma: Array) -> Float[Array, " frequencies"]:
    transformed = transform_by(plan.kernels, g)
    fhat = plan.densities.polar_fourier(transformed, plan.curve.weights)
    noise = _noise(plan, sigma)
    raw = jnp.mean(jnp.abs(fhat) ** 2, axis=(0, 2)) - noise
    near = jnp.abs(plan.frequencies[:, None] / plan.frequencies - 1) <= 0.1
    return jnp.maximum((near @ raw) / near.sum(axis=1), 0.01 * noise)


def _noise(plan: ReconstructionPlan, sigma: Array) -> Float[Array, " frequencies"]:
    """sigma² p ||rho||² / 4π²: the noise that the densities let through."""
    unit = kernel_noise_power(plan.kernels, plan.curve.weights)
    return sigma**2 * unit / (4 * jnp.pi**2) * jnp.mean(plan.report.norm**2, axis=1)
