"""Step 5: filtered back-projection.

    f(x) = (1/2π) ∫_0^π q(theta, x·theta) dtheta,
    q(theta, s) = ∫ |lambda| fhat(lambda theta) e^{i lambda s} dlambda.

Sampled at the frequencies where fhat is known, the kink of |lambda| at 0 would cost two digits.
In space there is no kink: q is the convolution of the projection with the band-limited ramp, whose
samples are known in closed form (Ram and Lak). Projections are not cut to the shadow of the
region: their band-limited tails beyond it carry another digit.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry import ImageGrid
from ..interpolation import SPLINE, cell_polynomials, polynomial, spline_prefilter

OVERSAMPLING = 8  # spline nodes per sample of the projections


@eqx.filter_jit
def filtered_back_projection(
    projections: Float[Array, "*batch directions offsets"],
    offset_step: Float[Array, ""],
    angles: Float[Array, " directions"],
    grid: ImageGrid,
    center: Float[Array, "2"],
) -> Float[Array, "*batch x1 x2"]:
    """f(x) = (1/2π) ∫_0^π q(theta, (x - c)·theta) dtheta from projections p(theta, s).

    Args:
        projections: at offsets j h, j = -n..n-1, (..., directions, 2 n).
        offset_step: h [length].
        angles: theta, equispaced over half a turn, (directions,) [rad].
        grid: where the image is wanted; zero further than n h from the centre.
        center: c, from which offsets are counted, (2,) [length].

    Returns:
        (..., x1, x2).

    Source: Kunyansky 2008, section 3.3; Ramachandran and Lakshminarayanan, PNAS 68 (1971) 2236.
    """
    *batch, n_directions, n_offsets = projections.shape

    def one(p: Array) -> Array:
        coefficients = ramp_filter(p, offset_step)
        return back_project(coefficients, offset_step / OVERSAMPLING, angles, grid, center)

    # one image at a time: the oversampled projections of a large batch would not fit
    images = jax.lax.map(one, projections.reshape(-1, n_directions, n_offsets))
    return images.reshape(*batch, *grid.shape) / (2 * jnp.pi)


def ramp_filter(
    projections: Float[Array, "directions offsets"], offset_step: Float[Array, ""]
) -> Float[Array, "directions nodes"]:
    """Cubic B-spline coefficients of q = p * ramp, on nodes `OVERSAMPLING` times finer than p.

    The convolution is linear (not periodic) for |s| <= n h; oversampling and the spline prefilter
    ride on the same pair of FFTs.

    Returns:
        (directions, 2 n OVERSAMPLING), at (j - n OVERSAMPLING) h / OVERSAMPLING.
    """
    n = projections.shape[-1]
    long, fine = 2 * n, 2 * n * OVERSAMPLING
    spectrum = jnp.fft.rfft(projections, long)
    spectrum = spectrum * (jnp.fft.rfft(_ramp_samples(long)) / offset_step)
    phase = 2 * jnp.pi * jnp.arange(n + 1) / fine
    # the highest frequency stands for itself and its mirror image, of which irfft adds one more
    half = jnp.where(jnp.arange(n + 1) == n, 0.5, 1.0)
    scale = OVERSAMPLING * half * spline_prefilter(phase)
    return jnp.fft.irfft(spectrum * scale, fine)[..., : n * OVERSAMPLING]


def back_project(
    coefficients: Float[Array, "directions nodes"],
    spacing: Float[Array, ""],
    angles: Float[Array, " directions"],
    grid: ImageGrid,
    center: Float[Array, "2"],
) -> Float[Array, "x1 x2"]:
    """∫_0^π q(theta, (x - c)·theta) dtheta, q a cubic spline in s, one direction after the other.

    Args:
        coefficients: of q, nodes from -(nodes/2) on, (directions, nodes).
        spacing: between nodes [length].
        angles, grid, center: as in `filtered_back_projection`.

    Returns:
        (x1, x2).
    """
    n_directions, n_nodes = coefficients.shape
    x1, x2 = (grid.x1 - center[0]) / spacing, (grid.x2 - center[1]) / spacing

    def add(image: Array, direction: tuple[Array, Array]) -> tuple[Array, None]:
        angle, row = direction
        cells = cell_polynomials(SPLINE, row)  # cell 0 lies between nodes 1 and 2
        position = x1[:, None] * jnp.cos(angle) + x2 * jnp.sin(angle) + (n_nodes // 2 - 1)
        first = jnp.floor(position)
        inside = (first >= 0) & (first < n_nodes - 3)
        index = jnp.where(inside, first, 0.0).astype(jnp.int32)
        read = [cell.at[index].get(mode="promise_in_bounds") for cell in cells]
        return image + jnp.where(inside, polynomial(read, position - first), 0.0), None

    image, _ = jax.lax.scan(add, jnp.zeros(grid.shape), (angles, coefficients))
    return image * (jnp.pi / n_directions)


def _ramp_samples(n: int) -> Float[np.ndarray, " n"]:
    """h² k(j h), k(s) = (1/2π) ∫ |lambda| e^{i lambda s} dlambda over |lambda| < π/h, in FFT order.

    k(0) = π / (2 h²), and for j != 0 the integral is 0 (j even) or -2 / (π j² h²) (j odd).
    """
    j = np.fft.fftfreq(n, 1 / n)
    odd = np.abs(j) % 2 == 1
    samples = np.where(odd, -2 / (np.pi * np.where(odd, j, 1.0) ** 2), 0.0)
    samples[0] = np.pi / 2
    return samples
