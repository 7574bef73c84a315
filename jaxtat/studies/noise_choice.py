"""How much to regularise for a given noise: K(lambda) or alpha(lambda) of least expected error.

For noise of standard deviation sigma in every sample of g, and images of which only the power
P(lambda) = mean |fhat(xi)|² over directions is known, densities with the residual e on the boundary
give, as accurately as e represents the error inside the region,

    E |fhat_found - fhat|² = P(lambda) e² + sigma² p(lambda) ||rho||² / 4π²,

p the power of unit noise in the radial transform: what is left of the image, and the noise that the
densities let through. The image's square error is the integral of this over all xi. A rule's
parameter moves error from one term to the other, at each frequency by itself.
"""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from ..base.checks import Numbers, data_array, real_array, require_positive, require_x64
from ..densities.cylindrical_waves import PolarGeometry, polar_geometry, wave_system, wave_table
from ..reconstruction import ReconstructionPlan, Setup
from ..reconstruction.setup import plane_of, require_waves
from ..reconstruction.sizes import PlaneSizes
from ..regularization import (
    FixedRank,
    NormBound,
    Regularization,
    Tikhonov,
    singular_components,
    unit_norms,
)
from ..special import root
from ..steps.radial_transforms import noise_power, radial_transform

Kind = Callable[..., Regularization]  # made of one number

# where the descent may start, at each frequency from the best of these
_STARTS: dict[Kind, np.ndarray] = {
    NormBound: np.geomspace(0.05, 12, 60),
    Tikhonov: np.geomspace(1e-9, 1e4, 14),
    FixedRank: np.geomspace(1, 1000, 25),
}
_DIRECTIONS = 32  # over which errors are averaged


class NoiseChoice(eqx.Module):
    """The rule with the least expected error.

    Attributes:
        regularization: the rule, with one parameter for each frequency.
        frequencies: lambda [rad/length].
        power: P(lambda) that was assumed.
        left: P e², mean over directions: expected square error of fhat that the rule causes.
        noise: expected square error of fhat that noise causes, likewise.
        converged: whether the descent came to rest.
    """

    regularization: Regularization
    frequencies: Float[Array, " frequencies"]
    power: Float[Array, " frequencies"]
    left: Float[Array, " frequencies"]
    noise: Float[Array, " frequencies"]
    converged: Bool[Array, ""]

    @property
    def image_error(self) -> Float[Array, ""]:
        """Expected ||f_found - f||, the L2 norm over the plane: √(2π ∫ E|.|² lambda dlambda)."""
        return self._norm(self.left + self.noise)

    @property
    def relative_error(self) -> Float[Array, ""]:
        """`image_error` over ||f||."""
        return self.image_error / self._norm(self.power)

    def _norm(self, power: Array) -> Array:
        step = self.frequencies[0]
        return jnp.sqrt(2 * jnp.pi * step * jnp.sum(power * self.frequencies))


def choose_regularization(
    setup: Setup, sigma: Numbers, power: Numbers, *, kind: Kind = NormBound
) -> NoiseChoice:
    """K(lambda) or alpha(lambda) for which the expected error of the image is least.

    By gradient descent (Broyden, Fletcher, Goldfarb and Shanno) on the logarithm of the expected
    error at each frequency, through filter factors and densities, from the best of some starts. Of
    all densities Tikhonov's, with the alpha found here, have the least expected error: they are the
    Wiener filter of this problem. Differentiable with respect to sigma and power, implicitly, but
    for `NormBound`, whose error has a kink wherever a component enters: where the least error lies
    in one, K stays there or jumps to the next, and its derivative means nothing.

    Args:
        setup: in the plane, as for `build_plan`, which takes the result's ``regularization``.
        sigma: standard deviation of the noise in every sample of g, above zero.
        power: P(lambda), the mean of |fhat|² over directions, for each frequency of the plan, from
            images alike or from `image_power` of the data.
        kind: `NormBound`, `Tikhonov` or `FixedRank`.

    Returns:
        NoiseChoice.

    Raises:
        ValueError: for a kind that has no parameter to choose, sigma or power that are not
            positive, detectors that cylindrical waves do not reach (around an L, say).

    Source: the bias-variance trade-off; the paper leaves K to experience (section 3.2).

    >>> from jaxtat import ImageGrid, circular_arc, disk
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> power = 1e-4 * jnp.arange(1.0, 21.0) ** -3
    >>> found = [choose_regularization(setup, sigma, power) for sigma in (1e-3, 1e-1)]
    >>> bool(found[0].relative_error < found[1].relative_error < 1)
    True
    """
    require_x64()
    if kind not in _STARTS:
        raise ValueError(f"kind is {kind!r}, expected NormBound, Tikhonov or FixedRank.")
    curve, region, radii, sizes = plane_of(setup)
    require_waves(sizes)
    sigma = real_array("sigma", sigma, ())
    power = real_array("power", power, (sizes.n_frequencies,))
    require_positive("sigma", sigma)
    require_positive("power", power)
    norms = unit_norms(curve, region, sizes.frequencies, sizes.norm_orders, _directions())
    spectra = _spectra(
        polar_geometry(curve, region, sizes.n_nodes, sizes.wave_offset), norms, sizes
    )
    gain = sigma**2 * noise_power(radii, sizes.frequencies, curve.weights) / (4 * jnp.pi**2)
    starts = jax.device_put(_STARTS[kind])
    values, converged = _descended(kind, starts, spectra, power, gain)
    errors = jax.vmap(partial(_errors, kind))(values, spectra, power, gain)
    return NoiseChoice(kind(values), sizes.frequencies, power, *errors, converged)


def image_power(plan: ReconstructionPlan, g: Numbers, sigma: Numbers) -> Float[Array, " f"]:
    """P(lambda) from data: mean |fhat|² over directions, less what noise adds to it.

        P = mean_theta [|fhat|² - sigma² p(lambda) ||rho||² / 4π²],

    averaged over neighbouring frequencies, a tenth of lambda to each side, and at least a hundredth
    of what is subtracted.

    Args:
        plan: for the data.
        g: circular integrals, (..., detectors, radii).
        sigma: standard deviation of the noise in every sample of g.

    Returns:
        (frequencies,), for `choose_regularization`.

    >>> from jaxtat import ImageGrid, build_plan, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> plan, bell = build_plan(setup), phantoms.Bells([[0.2, 0.1]], [0.6])
    >>> found = image_power(plan, bell.circular_integrals(setup.curve, setup.radii), 1e-6)
    >>> exact = jnp.mean(jnp.abs(bell.fourier(plan.frequencies, plan.angles)) ** 2, axis=1)
    >>> bool(abs(found[4] / exact[4] - 1) < 0.2)
    True
    """
    require_x64()
    values = data_array(g, *plan.setup.data_shape)
    sigma = real_array("sigma", sigma, ())
    return _power(plan, values.reshape(-1, *values.shape[-2:]), sigma)


@eqx.filter_jit
def _power(plan: ReconstructionPlan, g: Array, sigma: Array) -> Float[Array, " f"]:
    transformed = radial_transform(g, plan.radii, plan.frequencies)
    fhat = plan.densities.polar_fourier(transformed, plan.curve.weights)
    gain = noise_power(plan.radii, plan.frequencies, plan.curve.weights) / (4 * jnp.pi**2)
    noise = sigma**2 * gain * jnp.mean(plan.report.norm**2, axis=1)
    found = jnp.mean(jnp.abs(fhat) ** 2, axis=(0, 2)) - noise
    near = jnp.abs(plan.frequencies[:, None] / plan.frequencies - 1) <= 0.1
    return jnp.maximum((near @ found) / near.sum(axis=1), 0.01 * noise)


class _Spectra(eqx.Module):
    """Singular values of all frequencies and the plane waves' parts, frequencies first."""

    sigma: Float[Array, "*f rank"]
    parts: Float[Array, "*f rank directions"]  # |p_j·u|²; nothing for sigma below rounding
    total: Float[Array, "*f directions"]  # ||u||²
    unit_norm: Float[Array, "*f_and_directions"]
    unit: Float[Array, "*f"]  # of alpha
    frequency: Float[Array, "*f"]


def _directions() -> Float[Array, " directions"]:
    return jnp.arange(_DIRECTIONS) * (jnp.pi / _DIRECTIONS)


@eqx.filter_jit
def _spectra(geometry: PolarGeometry, norms: Array, sizes: PlaneSizes) -> _Spectra:
    table = wave_table(geometry, sizes.frequencies, sizes.groups[-1][-1])
    angles = _directions() - geometry.axis
    pieces = []
    for start, stop, n_max in sizes.groups:

        def at(given, n_max=n_max) -> _Spectra:
            wave, norm = given
            matrix, rhs, _, unit = wave_system(geometry, wave.up_to(n_max), angles)
            found = singular_components(matrix, rhs, FixedRank(0.0), norm)
            parts = (found.sigma[..., None] * jnp.abs(found.amplitudes)) ** 2
            total = jnp.sum(jnp.abs(rhs) ** 2, axis=(0, 1))
            singular = found.singular_values
            return _Spectra(singular, found.ordered(parts), total, norm, unit, wave.frequencies)

        few = jax.tree.map(lambda leaf: leaf[start:stop], (table, norms))  # noqa: B023
        pieces.append(jax.lax.map(at, few))
    rank = max(piece.sigma.shape[1] for piece in pieces)
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), *(_padded(p, rank) for p in pieces))


def _padded(spectra: _Spectra, rank: int) -> _Spectra:
    """Arrays padded with zeros to a common rank."""
    short = rank - spectra.sigma.shape[1]
    sigma = jnp.pad(spectra.sigma, ((0, 0), (0, short)))
    parts = jnp.pad(spectra.parts, ((0, 0), (0, short), (0, 0)))
    return eqx.tree_at(lambda tree: (tree.sigma, tree.parts), spectra, (sigma, parts))


@eqx.filter_jit
def _errors(
    kind: Kind, value: Array, one: _Spectra, power: Array, gain: Array
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """What is left and what noise adds, mean over directions, at one frequency."""
    rule = kind(value).in_units_of(one.unit, one.frequency)
    sigma = jnp.where(one.sigma > 0, one.sigma, 1.0)[:, None]
    square = one.parts / sigma**2  # of what each component adds to the norm
    size = root(square)
    factors = rule.factors(one.sigma, size, one.unit_norm)
    unreached = one.total - one.parts.sum(axis=0)
    left = (jnp.sum((1 - factors) ** 2 * one.parts, axis=0) + unreached) / one.total
    norm = jnp.sum(factors**2 * square, axis=0)
    return power * jnp.mean(left), gain * jnp.mean(norm)


@eqx.filter_jit
def _descended(
    kind: Kind, starts: Array, spectra: _Spectra, power: Array, gain: Array
) -> tuple[Float[Array, " f"], Bool[Array, ""]]:
    """Parameters of least error at all frequencies; in logarithms, which keeps them above 0."""

    def at(given: tuple[_Spectra, Array, Array]) -> tuple[Array, Array]:
        one, power, gain = given

        def error(logarithm: Array, _: None) -> Array:
            return jnp.log(sum(_errors(kind, jnp.exp(logarithm), one, power, gain)) / power)

        trials = jax.lax.map(lambda start: error(start, None), jnp.log(starts))
        best = jnp.argmin(trials)  # there are several valleys
        first = jnp.log(starts[best])
        solver = optx.BFGS(rtol=1e-6, atol=1e-6)
        found = optx.minimise(error, solver, first, max_steps=100, throw=False)
        gained = error(found.value, None) <= trials[best]
        value = jnp.exp(jnp.where(gained, found.value, first))
        return value, found.result == optx.RESULTS.successful

    values, converged = jax.lax.map(at, (spectra, power, gain))
    return values, jnp.all(converged)
