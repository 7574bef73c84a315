"""Step 5: filtered back-projection.

    f(x) = (1/2π) ∫_0^π q(theta, x·theta) dtheta,
    q(theta, s) = ∫ |lambda| fhat(lambda theta) e^{i lambda s} dlambda.

Sampled at the frequencies where fhat is known, the kink of |lambda| at 0 would cost two digits.
In space there is no kink: q is the convolution of the projection with the band-limited ramp, whose
samples are known in closed form (Ram and Lak). Projections are not cut to the shadow of the
region: their band-limited tails beyond it carry another digit.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..base.interpolation import QUINTIC, polynomial, quintic_prefilter
from ..base.rows import equal_parts
from ..geometry import ImageGrid

OVERSAMPLING = 3  # spline nodes per sample of the projections
IMAGES, DIRECTIONS = 32, 32  # worked on together, to find cells once and yet stay in the cache
LARGEST_GROUP = 2**24  # values of projections of the images worked on together

MARGIN = 6  # nodes on either side with q = 0, where positions farther out are moved to


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
    n_images = int(np.prod(batch))
    ramp, spacing = ramp_matrix(n_offsets, offset_step), offset_step / OVERSAMPLING

    @jax.checkpoint
    def add(image: Array, block: tuple[Array, Array]) -> tuple[Array, None]:
        p, theta = block
        coefficients = jnp.einsum("jo,dbo->djb", ramp, p)
        return image + back_project(coefficients, spacing, theta, grid, center), None

    def of_group(p: Array) -> Array:
        blocks = equal_parts(jnp.moveaxis(p, 1, 0), DIRECTIONS), equal_parts(angles, DIRECTIONS)
        return jax.lax.scan(add, jnp.zeros((*grid.shape, p.shape[0]), p.dtype), blocks)[0]

    together = max(1, min(IMAGES, LARGEST_GROUP // (n_directions * n_offsets)))
    groups = equal_parts(projections.reshape(n_images, n_directions, n_offsets), together)
    images = jnp.moveaxis(jax.lax.map(of_group, groups), -1, 1).reshape(-1, *grid.shape)
    return images[:n_images].reshape(*batch, *grid.shape) / (2 * n_directions)


def ramp_matrix(n: int, offset_step: Float[Array, ""]) -> Float[Array, "nodes offsets"]:
    """From projections to quintic B-spline coefficients of q = p * ramp, on finer nodes.

    Ramp, interpolation to the nodes and spline prefilter are one convolution, and as a matrix
    product it is faster than by FFTs.

    Args:
        n: number of offsets.
        offset_step: h [length].

    Returns:
        (n OVERSAMPLING, n), to nodes (j - n OVERSAMPLING / 2) h / OVERSAMPLING.
    """
    kernel = jnp.asarray(_ramp_kernel(n)) / offset_step
    shifts = jnp.arange(n * OVERSAMPLING)[:, None] - OVERSAMPLING * jnp.arange(n)
    return kernel[shifts]  # negative shifts are at the end


def back_project(
    coefficients: Float[Array, "directions nodes images"],
    spacing: Float[Array, ""],
    angles: Float[Array, " directions"],
    grid: ImageGrid,
    center: Float[Array, "2"],
) -> Float[Array, "x1 x2 images"]:
    """Σ_theta q(theta, (x - c)·theta), q a quintic spline in s, for several images at once.

    A, linear in the coefficients, has the adjoint `project`. JAX learns of it from the equations
    c = a, f - A c = b, whose solution is c = a, f = b + A a, and whose transpose g - A' h = a,
    h = b has the solution g = a + A' b, h = b. Derivatives with respect to the geometry are those
    of the equations.

    Args:
        coefficients: of q, nodes from -(nodes/2) on, zero beyond, (directions, nodes, images).
        spacing: between nodes [length].
        angles, grid, center: as in `filtered_back_projection`.

    Returns:
        (x1, x2, images).
    """
    *shape, n_images = coefficients.shape
    geometry = spacing, angles, grid, center

    def vector(c: Array, f: Array) -> Array:  # JAX wants all unknowns in one array
        return jnp.concatenate([c.reshape(-1, n_images), f.reshape(-1, n_images)])

    def parts(unknown: Array) -> tuple[Array, Array]:
        c, f = jnp.split(unknown, [shape[0] * shape[1]])
        return c.reshape(*shape, n_images), f.reshape(*grid.shape, n_images)

    def equations(unknown: Array) -> Array:
        c, f = parts(unknown)
        return vector(c, f - _add_up(c, *geometry))

    def solve(_, right: Array) -> Array:
        a, b = parts(right)
        return vector(a, b + _add_up(a, *geometry))

    def solve_transpose(_, right: Array) -> Array:
        a, b = parts(right)
        return vector(a + project(b, shape[1], *geometry), b)

    right = vector(coefficients, jnp.zeros((*grid.shape, n_images), coefficients.dtype))
    return parts(jax.lax.custom_linear_solve(equations, right, solve, solve_transpose))[1]


def project(
    images: Float[Array, "x1 x2 images"],
    n_nodes: int,
    spacing: Float[Array, ""],
    angles: Float[Array, " directions"],
    grid: ImageGrid,
    center: Float[Array, "2"],
) -> Float[Array, "directions nodes images"]:
    """Adjoint of `back_project`: with f(x) = Σ_theta Σ_j w_j(x·theta) c(theta, j) for one image,

        Σ_x g(x) f(x) = Σ_theta Σ_j c(theta, j) Σ_x w_j(x·theta) g(x),

    so that what a pixel gathered from a node is now scattered to it. Arguments as there.
    """
    cells = _cells(n_nodes, spacing, grid, center)

    def scatter(here: tuple[Array, Array], next_angle: Array) -> tuple[tuple, Array]:
        first, position = here
        row = jnp.zeros((n_nodes + 2 * MARGIN, images.shape[-1]), images.dtype)
        for j, weight in enumerate(_weights(position - first)):
            at = row.at[first + j]
            row = at.add(weight[..., None] * images, mode="promise_in_bounds")
        return cells(next_angle), row[MARGIN:-MARGIN]

    return jax.lax.scan(scatter, cells(angles[0]), jnp.roll(angles, -1))[1]


def _add_up(
    coefficients: Array, spacing: Array, angles: Array, grid: ImageGrid, center: Array
) -> Float[Array, "x1 x2 images"]:
    """`back_project`, one direction after the other."""
    n_nodes, n_images = coefficients.shape[1:]
    cells = _cells(n_nodes, spacing, grid, center)

    @jax.checkpoint
    def gather(carry: tuple[Array, Array], angle_row: tuple) -> tuple[tuple[Array, Array], None]:
        sums, first = carry
        angle, next_angle, row = angle_row
        _, position = cells(angle)  # unlike in a scatter, found again sooner than read
        for j, weight in enumerate(_weights(position - first)):
            sums = sums + weight[..., None] * row.at[first + j].get(mode="promise_in_bounds")
        return (sums, cells(next_angle)[0]), None

    rows = jnp.pad(coefficients, ((0, 0), (MARGIN, MARGIN), (0, 0)))
    start = jnp.zeros((*grid.shape, n_images), coefficients.dtype), cells(angles[0])[0]
    return jax.lax.scan(gather, start, (angles, jnp.roll(angles, -1), rows))[0][0]


def _cells(
    n_nodes: int, spacing: Float[Array, ""], grid: ImageGrid, center: Float[Array, "2"]
) -> Callable[[Array], tuple[Array, Array]]:
    """Function of the angle: first of the six nodes of a pixel, and its fraction of a cell.

    Positions count nodes from the third of the margin on. The loops compute them one direction
    ahead and carry them along, so that they are stored. Otherwise the compiler would recompute them
    for each of the six nodes, which is slow in a scatter and may round differently each time, so
    that cell and fraction do not match. With stored cells any rounding of the position is harmless,
    since splines are continuous from cell to cell.
    """
    x1, x2 = (grid.x1 - center[0]) / spacing, (grid.x2 - center[1]) / spacing

    def at(angle: Float[Array, ""]) -> tuple[Int[Array, "x1 x2"], Float[Array, "x1 x2"]]:
        position = x1[:, None] * jnp.cos(angle) + x2 * jnp.sin(angle) + n_nodes // 2
        position = jnp.clip(position, -3, n_nodes + 2) + (MARGIN - 2)
        return jnp.floor(position).astype(jnp.int32), position

    return at


def _weights(t: Float[Array, "x1 x2"]) -> list[Float[Array, "x1 x2"]]:
    """Weights of the six nodes, by the fraction of the way from the third to the fourth."""
    return [polynomial(list(row), t) for row in QUINTIC]


def _ramp_kernel(n: int) -> Float[np.ndarray, " kernel"]:
    """h K at the spacing h / OVERSAMPLING, in FFT order, of period 4 n h so that nothing wraps.

    The ramp's samples, continued between them without frequencies beyond their own.
    """
    long = 2 * n
    frequency = np.arange(n + 1)
    # the highest frequency stands for itself and its mirror image, of which irfft adds one more
    half = np.where(frequency == n, 0.5, 1.0)
    prefilter = quintic_prefilter(2 * np.pi * frequency / (long * OVERSAMPLING))
    spectrum = np.fft.rfft(_ramp_samples(long)) * half * prefilter * OVERSAMPLING
    return np.fft.irfft(spectrum, long * OVERSAMPLING)


def _ramp_samples(n: int) -> Float[np.ndarray, " n"]:
    """h² k(j h), k(s) = (1/2π) ∫ |lambda| e^{i lambda s} dlambda over |lambda| < π/h, in FFT order.

    k(0) = π / (2 h²), and for j != 0 the integral is 0 (j even) or -2 / (π j² h²) (j odd).
    """
    j = np.fft.ifftshift(np.arange(n) - n // 2)  # fftfreq(n, 1 / n) is not always whole
    odd = np.abs(j) % 2 == 1
    samples = np.where(odd, -2 / (np.pi * np.where(odd, j, 1.0) ** 2), 0.0)
    samples[0] = np.pi / 2
    return samples
