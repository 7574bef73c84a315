"""Step 4: Radon projections from the polar Fourier transform, and back."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..base import option_values
from ..base.checks import by_library, real_array

LowPass = Callable[[Array], Array] | str


def cosine_filter(relative_frequency: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The paper's low-pass eta = cos(π lambda / (2 lambda_N)), of lambda / lambda_N.

    >>> cosine_filter(jnp.array(0.0)).tolist()
    1.0
    """
    return by_library(lambda xp, x: xp.cos(np.pi / 2 * x), (relative_frequency,))


_EXPECTED = f"{', '.join(map(repr, option_values.LOW_PASSES))}, or a function such as cosine_filter"
LOW_PASSES: dict[str, Callable[[Array], Array] | None] = dict(
    zip(option_values.LOW_PASSES, (None, cosine_filter), strict=True)
)


def _relative_frequencies(xp: Any, n: int) -> Any:
    return xp.arange(n + 1) / n


def low_pass_values(low_pass: Any, n: int) -> Float[Array, " frequencies"]:
    """eta at lambda_max · 0/n, 1/n, ..., n/n; as `low_pass_at`."""
    return low_pass_at(low_pass, by_library(_relative_frequencies, (), n))


def low_pass_at(low_pass: Any, relative: Float[Array, " n"]) -> Float[Array, " n"]:
    """eta at the frequencies lambda / lambda_max; ones for None.

    Args:
        low_pass: a function of lambda / lambda_max, one of `LOW_PASSES`, or None.
        relative: lambda / lambda_max.

    Raises:
        ValueError: for anything else, and for values that are not as many finite numbers.
    """
    if isinstance(low_pass, str):
        if low_pass not in LOW_PASSES:
            raise ValueError(f"low_pass is {low_pass!r}, expected {_EXPECTED}.")
        low_pass = LOW_PASSES[low_pass]
    if low_pass is None:
        return by_library(lambda xp: xp.ones(relative.shape), ())
    if not callable(low_pass):
        raise ValueError(f"low_pass is {low_pass!r}, expected {_EXPECTED}.")
    values: Any = low_pass(relative)
    return real_array("low_pass", values, relative.shape)


@jax.jit
def radon_projections(
    fhat: Complex[Array, "*batch frequencies directions"],
    frequency_step: Float[Array, ""],
    eta: Float[Array, " frequencies"],
) -> Float[Array, "*batch directions offsets"]:
    """p(theta, s) = ∫ eta(lambda) fhat(lambda theta) exp(i lambda s) dlambda over all real lambda.

    f is real, so fhat(-xi) is the conjugate and the integral is a real FFT. With n steps of
    d lambda up to lambda_N = n d lambda it is found at s_j = j π/lambda_N, j = -n..n-1, which
    resolves |s| < π/d lambda.

    Args:
        fhat: at lambda = 0, d lambda, ..., lambda_N, (..., n + 1, directions).
        frequency_step: d lambda [rad/length].
        eta: low-pass at the same frequencies, (n + 1,); ones for none.

    Returns:
        (..., directions, 2 n), at the offsets of `offset_step`, from -n on.

    Source: Kunyansky 2008, section 3.3.
    """
    n = 2 * (fhat.shape[-2] - 1)
    filtered = jnp.moveaxis(fhat * eta[:, None], -2, -1)
    return jnp.fft.fftshift(jnp.fft.irfft(filtered, n, norm="forward"), axes=-1) * frequency_step


@jax.jit
def polar_fourier_of_projections(
    projections: Float[Array, "*batch directions offsets"], offset_step: Float[Array, ""]
) -> Complex[Array, "*batch frequencies directions"]:
    """fhat(lambda theta) = (1/2π) ∫ p(theta, s) exp(-i lambda s) ds, the inverse of step 4.

    It lets projections measured as such (classical computed tomography) enter at step 4.

    Args:
        projections: at offsets j h, j = -n..n-1, (..., directions, 2 n).
        offset_step: h [length].

    Returns:
        Complex, at lambda = 0, π/(n h), ..., π/h, (..., n + 1, directions).
    """
    spectrum = jnp.fft.rfft(jnp.fft.ifftshift(projections, axes=-1))
    return jnp.moveaxis(spectrum, -1, -2) * offset_step / (2 * jnp.pi)


@partial(jax.jit, static_argnums=1)
def offset_step(frequency_step: Float[Array, ""], n_frequencies: int) -> Float[Array, ""]:
    """h = π / lambda_N of n steps d lambda = lambda_N / n [length]."""
    return jnp.pi / (frequency_step * n_frequencies)
