"""Steps 4 and 5 at once, another way: the polar Fourier transform, interpolated, and a Fourier sum.

    f(x) = (d²/2π) Σ_k fhat(d k) e^{i d k·(x - c)}, k over the pairs of integers, |d k| <= lambda_N.

The lattice step d repeats the image with period 2π/d; nothing is lost if the image is shorter. On
a circle or on a line through the origin the transform is band-limited, because f has a reach: so
it is interpolated to the lattice by a short kernel, whose own transform is divided out beforehand.

All lines are real: fhat = a + i b is kept as a + b at xi and a - b at -xi (Hartley's transform).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float
from scipy.fft import next_fast_len

from ..geometry import ImageGrid

REACH = np.pi / 2  # R d lambda: the frequency step resolves twice the reach R
LATTICE_STEP = 8 / 5  # d / d lambda: the period is 5/2 R, enough as all beyond 3/2 R is taken out
TAPS = 10  # kernel width, even: relative error below 1e-8 at the reach, far less inside
GROUP = 4  # images interpolated together: their samples lie side by side, two cache lines


@eqx.filter_jit
def direct_fourier_inversion(
    fhat: Complex[Array, "*batch frequencies directions"],
    frequency_step: Float[Array, ""],
    angles: Float[Array, " directions"],
    grid: ImageGrid,
    center: Float[Array, "2"],
    eta: Float[Array, " frequencies"],
) -> Float[Array, "*batch x1 x2"]:
    """f(x) = (1/2π) ∫ eta(|xi|) fhat(xi) exp(i xi·(x - c)) dxi from a polar grid of frequencies.

    What `radon_projections` and `filtered_back_projection` give, up to 1e-8 of the largest value,
    for images that, blurred by the low-pass, vanish beyond the reach R = π / (2 d lambda) from the
    centre (those two allow twice this reach). FFTs, 10 x 10 taps per lattice point and two matrix
    products replace the loop over directions.

    Args:
        fhat: at lambda = 0, d lambda, ..., n d lambda = lambda_N, (..., n + 1, directions).
        frequency_step: d lambda [rad/length].
        angles: theta, equispaced over half a turn, (directions,) [rad]; the first one is read.
        grid: where the image is wanted; zero further than 5/4 R from the centre along an axis.
        center: c, the origin of the phases of fhat, (2,) [length].
        eta: low-pass at the same frequencies, (n + 1,); ones for none.

    Returns:
        (..., x1, x2).

    Source: Natterer, The Mathematics of Computerized Tomography (1986), section V.2; the kernel:
    Jackson et al., IEEE Trans. Med. Imaging 10 (1991) 473-478.

    >>> from jaxtat import phantoms
    >>> bell, grid = phantoms.Bells([[0.1, 0.2]], [0.6]), ImageGrid(33)
    >>> step, angles = jnp.array(jnp.pi / 2), jnp.arange(128) * jnp.pi / 128
    >>> fhat = bell.fourier(step * jnp.arange(65), angles)
    >>> image = direct_fourier_inversion(fhat, step, angles, grid, jnp.zeros(2), jnp.ones(65))
    >>> bool(jnp.abs(image - bell.image(grid)).max() < 1e-6)
    True
    """
    *batch, n_frequencies, n_directions = fhat.shape
    images = (fhat * eta[:, None].astype(fhat.real.dtype)).reshape(-1, n_frequencies, n_directions)
    turn_back = jnp.exp(-1j * jnp.arange(n_directions) * angles[0]).astype(fhat.dtype)

    def lines_of(fhat: Array) -> tuple[Array, Array]:
        return polar_lines(fhat, turn_back), jnp.mean(fhat[:, 0].real, axis=-1)

    found = _inverted(lines_of, images, frequency_step, grid, center)
    return found.reshape(*batch, *grid.shape)


def fourier_inversion_of_harmonics(
    harmonics: Float[Array, "images frequencies 2 orders"],
    origin: Float[Array, " images"],
    axis: Float[Array, ""],
    frequency_step: Float[Array, ""],
    grid: ImageGrid,
    center: Float[Array, "2"],
    eta: Float[Array, " frequencies+1"],
) -> Float[Array, "images x1 x2"]:
    """The same from the circular harmonics of fhat, which need no directions.

    Args:
        harmonics: (c, s) of fhat = (1/2π) Σ_n (-i)^n (c_n cos n theta + s_n sin n theta), theta
            counted from ``axis``, at lambda = d lambda, ..., lambda_N.
        origin: fhat at lambda = 0, the mass over 2π.
        axis: [rad].
        frequency_step, grid, center, eta: as in `direct_fourier_inversion`.
    """
    orders, dtype = np.arange(harmonics.shape[-1]), harmonics.dtype
    # (-i)^n real is kept in a, imaginary in b, so that a + b has the signs +, -, -, +
    signs = np.array([1, -1, -1, 1])[orders % 4] / np.where(orders == 0, 2 * np.pi, 4 * np.pi)
    turned = (signs * jnp.exp(-1j * orders * axis)).astype(jnp.result_type(dtype, jnp.complex64))
    series = jax.lax.complex(harmonics[..., 0, :], -harmonics[..., 1, :]) * turned
    at_zero = jnp.zeros_like(series[:, :1]).at[..., 0].set(origin[:, None])
    series = jnp.concatenate([at_zero, series], axis=1) * eta[:, None].astype(dtype)

    def lines_of(series: Array) -> tuple[Array, Array]:
        return lines_of_series(series), series[:, 0, 0].real

    return _inverted(lines_of, series, frequency_step, grid, center)


def _inverted(
    lines_of: Callable[[Array], tuple[Array, Array]],
    images: Complex[Array, "images frequencies any"],
    frequency_step: Float[Array, ""],
    grid: ImageGrid,
    center: Float[Array, "2"],
) -> Float[Array, "images x1 x2"]:
    """A few images at a time; what all groups share is found once."""
    count, n_frequencies = images.shape[:2]
    groups = max(1, -(-count // GROUP))
    in_group = -(-count // groups)
    images = jnp.pad(images, ((0, groups * in_group - count), (0, 0), (0, 0)))
    step, size = LATTICE_STEP * frequency_step, _lattice_size(n_frequencies - 1)
    real = images.real.dtype  # phases are exact, whatever the precision of what they multiply
    waves1 = lattice_waves(step, size, grid.x1 - center[0]).astype(real)
    waves2 = lattice_waves(step, size, grid.x2 - center[1]).astype(real)

    def one_group(images: Array) -> Array:
        return fourier_sum(lattice_spectrum(*lines_of(images)), waves1, waves2)

    images = jax.lax.map(one_group, images.reshape(groups, in_group, *images.shape[1:]))
    images = images.reshape(groups * in_group, *grid.shape)[:count]
    return images * (step**2 / jnp.pi).astype(real)


def lattice_spectrum(
    lines: Float[Array, "images lines line"], origin: Float[Array, " images"]
) -> Complex[Array, "images k2 k1"]:
    """fhat at the lattice points k1 = -m..m, k2 = 0..m, 8/5 d lambda apart; zero beyond lambda_N.

    Of the points k and -k one is enough; the other, on the line k2 = 0, and the outside are zero,
    and k = 0 is halved.
    """
    n = lines.shape[2] // 2
    k1, k2 = _quarter_lattice(n)
    m, n_points = _lattice_size(n), len(k1)
    half = interpolate(lines, LATTICE_STEP * (k1 + 1j * k2))
    ends = jnp.stack([origin / 2, jnp.zeros_like(origin)]).astype(half.dtype)
    half = jnp.concatenate([half, ends])
    place = np.full((m + 1, 2 * m + 1), 2 * n_points + 1, np.int32)
    place[0, m] = 2 * n_points
    place[k2, m + k1] = np.arange(0, 2 * n_points, 2)
    place[k1, m - k2] = np.arange(1, 2 * n_points, 2)
    return jnp.moveaxis(half[place], -1, 0)


def polar_lines(
    fhat: Complex[Array, "images frequencies directions"],
    turn_back: Complex[Array, " directions"],
) -> Float[Array, "images lines line"]:
    """a + b on 3 n or a few more lines through the origin, from angle 0 on, ready for the kernel.

    Args:
        fhat: as in `direct_fourier_inversion`, times the low-pass.
        turn_back: exp(-i m theta_0), m = 0..directions-1, theta_0 the first angle.

    Returns:
        (images, lines, 2 n), at lambda = 0, ..., n, -(n - 1), ..., -1 times d lambda.
    """
    a, b = fhat.real, fhat.imag
    series = jnp.fft.rfft(jnp.concatenate([a + b, a - b], axis=-1), norm="forward")
    # harmonic n_given is left out: samples cannot tell it from its mirror image
    return lines_of_series(series[..., : fhat.shape[2]] * turn_back)


def lines_of_series(series: Complex[Array, "images frequencies harmonics"]) -> Array:
    """`polar_lines` from the Fourier series of a + b around each circle of frequencies.

    Harmonics in the angle and offsets along the line are divided by the kernel's transform, and
    tapered where they do not belong to the disk: at lambda a point at distance r has harmonics up
    to lambda r and a few more. Left in, noise would be folded into the disk.
    """
    n, dtype = series.shape[1] - 1, series.real.dtype
    turn = 4 * int(next_fast_len(-(-3 * n // 2)))  # pyright: ignore[reportArgumentType]
    harmonic = np.arange(min(series.shape[2], turn // 2))
    reach = REACH * np.arange(n + 1)[:, None]
    taper = _taper((harmonic - 16) / np.maximum(reach, 1))
    taper = taper / _kernel_transform(2 * np.pi / turn * harmonic, turn / (np.pi * n))
    series = series[..., : len(harmonic)] * taper.astype(dtype)
    ahead, back = jnp.split(jnp.fft.irfft(series, turn, norm="forward"), 2, axis=-1)
    last = (ahead[:, -1:] + back[:, -1:]) / 2  # n and -n are one place of the periodic line
    lines = jnp.concatenate([ahead[:, :-1], last, back[:, -2:0:-1]], axis=1)
    offset = 2 / n * np.arange(n + 1)  # in units of R
    taper = (_taper(offset) / _kernel_transform(REACH * offset, 2.0)).astype(dtype)
    return jnp.fft.irfft(jnp.fft.rfft(jnp.swapaxes(lines, 1, 2)) * taper, 2 * n)


def interpolate(
    lines: Float[Array, "images directions line"], xi: Complex[np.ndarray, " points"]
) -> Complex[Array, "points_and_turned images"]:
    """fhat at xi and at i xi, xi = lambda e^{i theta} in the first quarter and in frequency steps.

    Turned by a quarter, half and three quarters, a point has the same weights and, in `_quarters`,
    the same index: the four values and the images are read together. Indices and weights are
    numbers: neither depends on an argument that is traced.

    Returns:
        Complex, for xi[0], i xi[0], xi[1], ..., (2 points, images).
    """
    n_images, half_turn, n = lines.shape[0], lines.shape[1], lines.shape[2] // 2
    dtype = lines.dtype
    radial, radial_weights = _taps(np.abs(xi), 2.0, dtype)
    turned = np.angle(xi) * half_turn / np.pi
    angular, angular_weights = _taps(turned, 2 * half_turn / (np.pi * n), dtype)
    samples = _quarters(lines)
    width = n + 1 + TAPS
    index = jnp.asarray(angular * width + radial)
    table = jax.lax.collapse(samples, 0, 2)

    def add(total: Array, tap: tuple[Array, Array]) -> tuple[Array, None]:
        row, weight = tap
        read = [
            radial_weights[j][:, None]
            * table.at[index + (row * width + j)].get(mode="promise_in_bounds")
            for j in range(TAPS)
        ]
        return total + weight[:, None] * sum(read), None

    taps = (jnp.arange(TAPS, dtype=index.dtype), jnp.asarray(angular_weights))
    found, _ = jax.lax.scan(add, jnp.zeros((len(xi), table.shape[1]), dtype), taps)
    ahead, back = jnp.split(found.reshape(len(xi), 4, n_images), 2, axis=1)
    return jax.lax.complex(ahead + back, ahead - back).reshape(2 * len(xi), n_images) / 2


def lattice_waves(
    step: Float[Array, ""], size: int, x: Float[Array, " nodes"]
) -> Float[Array, "nodes 2 k"]:
    """cos(d k x), sin(d k x), k = 0..size; zero for x beyond half a period."""
    phase = step * x[:, None] * np.arange(size + 1)
    near = jnp.abs(x) < jnp.pi / step
    return jnp.stack([jnp.cos(phase), jnp.sin(phase)], axis=1) * near[:, None, None]


def fourier_sum(
    spectrum: Complex[Array, "images k2 k1"],
    waves1: Float[Array, "x1 2 k2"],
    waves2: Float[Array, "x2 2 k2"],
) -> Float[Array, "images x1 x2"]:
    """Re Σ_k F_k e^{i d k·(x - c)}, k1 = -m..m, k2 = 0..m.

    Matrix products serve any grid, and up to a thousand nodes they take no longer than a chirp
    transform. The points k1 and -k1 share their waves.
    """
    m = spectrum.shape[1] - 1
    right, left = spectrum[..., m:], spectrum[..., m::-1].at[..., 0].set(0)
    parts = jnp.stack([right + left, 1j * (right - left)], axis=-2)
    parts = jnp.stack([parts.real, -parts.imag], axis=1)
    rows = jnp.einsum("nchpk,ipk->nich", parts, waves1)
    return jnp.einsum("nich,jch->nij", rows, waves2)


def _lattice_size(n: int) -> int:
    """The largest k with 8/5 k <= n."""
    return 5 * n // 8


def _quarter_lattice(n: int) -> tuple[np.ndarray, np.ndarray]:
    """The points k1 > 0, k2 >= 0 up to lambda_N: all but the origin, turned by quarter turns."""
    k1, k2 = np.mgrid[1 : _lattice_size(n) + 1, : _lattice_size(n) + 1]
    inside = 64 * (k1**2 + k2**2) <= 25 * n**2
    return k1[inside], k2[inside]


def _quarters(lines: Array) -> Array:
    """Samples around each quarter turn, (directions, line, 4 images), TAPS/2 more at both ends."""
    n_images, half_turn, n = lines.shape[0], lines.shape[1], lines.shape[2] // 2
    more = TAPS // 2
    behind = jnp.roll(lines[..., ::-1], 1, axis=-1)
    turn = jnp.concatenate([behind[:, -more:], lines, behind, lines[:, :more]], axis=1)
    turn = jnp.pad(turn, ((0, 0), (0, 0), (more, more)), mode="wrap")[..., : n + 1 + TAPS]
    starts = range(0, 2 * half_turn, half_turn // 2)
    quarters = jnp.stack([turn[:, j : j + half_turn // 2 + TAPS] for j in starts])
    return jnp.moveaxis(quarters.reshape(4 * n_images, *quarters.shape[2:]), 0, -1)


def _taps(x: np.ndarray, oversampling: float, dtype: np.dtype) -> tuple[np.ndarray, np.ndarray]:
    """Place of the first of TAPS samples around x, after TAPS/2 more in front, and the weights."""
    first = np.ceil(x - TAPS / 2).astype(np.int32)
    t = (first + np.arange(TAPS)[:, None] - x) * (2 / TAPS)
    weights = np.i0(_kernel_shape(oversampling) * np.sqrt(np.maximum(1 - t**2, 0)))
    return first + TAPS // 2, weights.astype(dtype)


def _kernel_transform(phase: np.ndarray, oversampling: float) -> np.ndarray:
    """∫ I_0(beta √(1 - (2t/w)²)) e^{i phase t} dt = w sinh(z)/z, z² = beta² - (w phase/2)².

    Args:
        phase: angular frequency times the distance between samples [rad].
    """
    z = np.emath.sqrt(_kernel_shape(oversampling) ** 2 - (phase * TAPS / 2) ** 2)
    return TAPS * np.real(np.sinc(1j * z / np.pi))


def _kernel_shape(oversampling: float) -> float:
    """beta of the Kaiser-Bessel kernel; the factor .98 makes the worst error smallest."""
    return 0.98 * np.pi * TAPS * (1 - 0.5 / oversampling)


def _taper(r: np.ndarray) -> np.ndarray:
    """1 up to r = 1, 0 from r = 3/2 on."""
    return np.cos(np.pi * np.clip(r - 1, 0, 0.5)) ** 2
