"""Steps 4 and 5 at once: the Fourier integral as a sum, by one non-uniform FFT.

    f(x) = (1/2π) ∫_0^π ∫ |lambda| fhat(lambda theta) e^{i lambda theta·(x - c)} dlambda dtheta

Sampled at d lambda = π/(2R), as fhat is, the kinks of |lambda| at 0 and ±lambda_N would cost all
but two digits: its transform, the ramp of filtered back-projection, falls like 1/s² only, and a sum
over frequencies repeats it with the period 4R. So the ramp is split by a window in s. What is
near is summed as fhat is sampled. What is far is smooth, so that it holds frequencies beside the
kinks alone: there steps half as wide are taken, fifteen at each kink. It is faded out between 3R
and 5R, farther than points x and what the projections show are from each other.

The image is that of filtered back-projection, to 1e-10 and several times sooner: all directions
are summed together, and no spline is evaluated. What differs is noise at lambda_N: between offsets
projections are continued by waves of the period 4R here, by sinc functions there.
"""

import math
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.special
from jaxtyping import Array, Complex, Float

from ..base.rows import in_groups
from ..base.size_ladder import filled_up
from ..geometry import ImageGrid
from ..special import to_grid

DIGITS = {np.dtype(np.complex64): 6, np.dtype(np.complex128): 10}  # of the non-uniform FFT
SPLIT = 10  # digits to which the ramp is split: the same images in both precisions
GROUP = 2**21  # samples of images that are worked on together


class Ramp(eqx.Module):
    """|lambda| for n frequencies, as weights of samples, of which there may be more.

    Attributes:
        multiples, near: where samples are taken, 0, 1, ..., n, in d lambda, and their weights;
            beyond the last one it is there again, with the weight zero.
        halves, far: where samples between those are taken, in d lambda, and their weights.
        even, odd: by which real and imaginary parts give the samples between.
    """

    multiples: Float[np.ndarray | Array, " frequencies"]
    near: Float[np.ndarray | Array, " frequencies"]
    halves: Float[np.ndarray | Array, " between"]
    far: Float[np.ndarray | Array, " between"]
    even: Float[np.ndarray | Array, "between frequencies"]
    odd: Float[np.ndarray | Array, "between frequencies"]


@cache
def ramp_of(n: int, n_samples: int | None = None) -> Ramp:
    """The ramp up to n d lambda.

    Args:
        n: the number of frequencies that count.
        n_samples: how many there are, with that at 0; others than n + 1 take as many between, too,
            whatever n is. n + 1 by default.
    """
    near, far = _weights(n, SPLIT)
    numbers = np.flatnonzero(far)
    halves, far = numbers + 0.5, far[numbers]
    even, odd = _between(n, halves)
    multiples = np.arange(n + 1.0)
    if n_samples is None:
        return Ramp(multiples, near, halves, far, even, odd)
    m = 2 * _last(SPLIT)  # as many as there are at most
    return Ramp(
        filled_up(multiples, (n_samples,), by="last"),
        filled_up(near, (n_samples,)),
        filled_up(halves, (m,), by="last"),
        filled_up(far, (m,)),
        *(filled_up(part, (m, n_samples)) for part in (even, odd)),
    )


@eqx.filter_jit
def fourier_inversion(
    fhat: Complex[Array, "*batch frequencies directions"],
    frequency_step: Float[Array, ""],
    angles: Float[Array, " directions"],
    grid: ImageGrid,
    center: Float[Array, "2"],
    eta: Float[Array, " frequencies"],
    ramp: Ramp | None = None,
) -> Float[Array, "*batch x1 x2"]:
    """f(x) = (1/2π) ∫ eta(|xi|) fhat(xi) exp(i xi·(x - c)) dxi from a polar grid of frequencies.

    What `radon_projections` and `filtered_back_projection` give, to 1e-10 of the largest value.

    Args:
        fhat: at lambda = 0, d lambda, ..., n d lambda = lambda_N, (..., n + 1, directions).
        frequency_step: d lambda = π/(2R) [rad/length].
        angles: theta, equispaced over half a turn, (directions,) [rad].
        grid: where the image is wanted; zero further than 2R from the centre.
        center: c, the origin of the phases of fhat, (2,) [length].
        eta: low-pass at the same frequencies, (n + 1,); ones for none.
        ramp: of `ramp_of`, where fewer than the n frequencies count; eta is zero at the others.

    Returns:
        (..., x1, x2).

    Source: the ramp: Ramachandran and Lakshminarayanan, PNAS 68 (1971) 2236; its split is Ewald's,
    Ann. Phys. 369 (1921) 253-287, of other sums.

    >>> from jaxtat import phantoms
    >>> bell, grid = phantoms.Bells([[0.1, 0.2]], [0.6]), ImageGrid(33)
    >>> step, angles = jnp.array(jnp.pi / 2), jnp.arange(128) * jnp.pi / 128
    >>> fhat = bell.fourier(step * jnp.arange(65), angles)
    >>> image = fourier_inversion(fhat, step, angles, grid, jnp.zeros(2), jnp.ones(65))
    >>> bool(jnp.abs(image - bell.image(grid)).max() < 1e-6)
    True
    """
    *batch, n_samples, n_directions = fhat.shape
    digits, real = DIGITS[fhat.dtype], fhat.real.dtype
    ramp = ramp_of(n_samples - 1) if ramp is None else ramp
    multiples = jnp.concatenate([ramp.multiples, ramp.halves])
    directions = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    xi = (frequency_step * multiples)[:, None, None] * directions
    middle = jnp.stack([x[len(x) // 2] for x in (grid.x1, grid.x2)]) - center
    factors = jnp.exp(1j * (xi @ middle)) * frequency_step**2 / n_directions
    points = (xi * grid.spacing).reshape(-1, 2).astype(real)
    factors = (factors * jnp.concatenate([ramp.near, ramp.far])[:, None]).astype(fhat.dtype)
    even, odd = (jnp.asarray(part, real) for part in (ramp.even, ramp.odd))

    def of_group(fhat: Array) -> Array:
        samples = fhat * eta[:, None].astype(real)
        pairs = (even, samples.real), (odd, samples.imag)
        between = jax.lax.complex(*(jnp.einsum("mk,bkd->bmd", *pair) for pair in pairs))
        samples = jnp.concatenate([samples, between], axis=1) * factors
        flat = jax.lax.collapse(samples, 1, 3)
        return to_grid(flat, points, grid.shape, 10.0**-digits).real

    images = fhat.reshape(math.prod(batch), n_samples, n_directions)
    values = in_groups(of_group, images, max(1, GROUP // factors.size))
    distance = jnp.hypot(*jnp.meshgrid(grid.x1 - center[0], grid.x2 - center[1], indexing="ij"))
    values = jnp.where(distance <= jnp.pi / frequency_step, values, 0.0)
    return values.reshape(*batch, *grid.shape)


def _between(n: int, halves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of fhat half-way between its samples, which determine it: projections end at ±2R.

    Their 2n samples give fhat(lambda) = Σ_k fhat_k D(lambda/d lambda - k), k = -n..n, with
    D(t) = sin(π t) / (2n tan(π t / 2n)), half of it at both ends, and fhat_-k the conjugate.
    """
    k, half = np.arange(n + 1), halves[:, None]

    def kernel(t: np.ndarray) -> np.ndarray:
        ends = np.where(k == n, 0.5, 1.0)
        return ends * np.sin(np.pi * t) / (2 * n * np.tan(np.pi * t / (2 * n)))

    ahead, back = kernel(half - k), kernel(half + k) * (k > 0)
    return ahead + back, ahead - back


def _last(digits: int) -> int:
    """How many steps from 0 the spectrum of Kaiser's window ends, to so many digits."""
    return int(np.ceil(np.log(10) * digits * 2 / np.pi))


@cache
def _weights(n: int, digits: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the samples at lambda = 0, 1, .., n and at 1/2, 3/2, .., n - 1/2, in d lambda.

    The ramp at offsets j π/lambda_N is 1/4 at 0, -1/(π j)² at odd and 0 at even j. Kaiser's window
    ends at s = R, so that the period 4R does not matter. To the given digits, its spectrum ends
    ``last`` steps from 0. If there are no more steps than that, all of them are halved: all of
    the ramp counts as far.
    """
    bandwidth = np.log(10) * digits  # times half the window's length, R = n/2 offsets
    last = _last(digits)
    j = np.arange(-3 * n, 3 * n)  # to 6R
    ramp = np.where(j % 2 != 0, -1 / (np.pi * np.where(j == 0, 1, j)) ** 2, 0.25 * (j == 0))
    semicircle = np.sqrt(np.maximum(1 - (2 * j / n) ** 2, 0))
    window = scipy.special.i0(bandwidth * semicircle) / scipy.special.i0(bandwidth)
    near = ramp * np.where(2 * np.abs(j) <= n, window, 0) * (2 * last < n)
    # out there the ramp is so small that half of the digits are enough
    faded = 0.5 * scipy.special.erfc(np.sqrt(bandwidth / 2) * (2 * np.abs(j) / n - 4))
    far = np.zeros(4 * n)
    np.add.at(far, j % (4 * n), (ramp - near) * faded)
    fine = n * np.fft.fft(far).real[: 2 * n + 1]
    if 2 * last < n:
        fine[2 * last : 2 * (n - last) + 1] = 0
    coarse = 2 * n * np.fft.fft(np.fft.ifftshift(near[2 * n : 4 * n])).real[: n + 1] + fine[::2]
    coarse[[0, n]] /= 2
    return coarse, fine[1::2]
