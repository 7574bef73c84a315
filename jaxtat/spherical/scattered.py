"""Steps 1 and 3 for detectors at any positions: one dense system for each frequency.

With detectors off rings all orders mix, and A of all waves would be large. In the space of the
data the Tikhonov solution is y = A v, (A^T A + alpha) v = √w G, and A^T A is a sum over degrees
alone, by the addition theorem of Y_lm:

    (A^T A)_{kk'} = Σ_l (2l + 1)/(4π) u_l(k) u_l(k') P_l(cos gamma_kk'),

gamma being the angle of two detectors and u_l(k) = s_l 4π Delta_l (j_l|y_l)(lambda |z_k|) √w_k. Its
size is twice the number of detectors: for some hundreds of them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ..geometry import BallBody
from ..geometry.balls import Ball
from ..geometry.caps import DetectorPoints
from ..regularization import SolveReport, TikhonovRule, relative_residual, tikhonov_solution
from ..special import legendre_functions
from ..steps.radial_transforms import kernel_noise_power
from .alpha import absolute_alpha
from .polar_fourier import polar_cosines, synthesis
from .radial_transform import spherical_kernels
from .sizes import SpaceSizes
from .waves import CapWaves, cap_waves


@eqx.filter_jit
def solve_points(
    detectors: DetectorPoints,
    region: Ball,
    radii: Float[Array, " radii"],
    g: Float[Array, "*batch detectors radii"],
    rule: TikhonovRule,
    sizes: SpaceSizes,
    medium: BallBody | None = None,
) -> tuple[Complex[Array, "images frequencies 2 polar orders"], SolveReport]:
    """Solve as `tikhonov.solve_rings` does, for points; the region must be a whole ball.

    Of a body the points must have the centre.
    """
    if detectors.normals is not None:
        raise ValueError("elements have normals: fit the volume, by model_based or no --direct.")
    local = detectors.points - detectors.center
    distance = detectors.distance
    units = local / distance[:, None]
    frequencies, l_max = sizes.frequencies, sizes.groups[-1]
    kernels = spherical_kernels(radii, frequencies, medium)
    stack = g.reshape(-1, *detectors.shape, g.shape[-1])
    data = jnp.einsum("fjr,ikr->fjki", kernels, stack) * jnp.sqrt(detectors.weights)[:, None]
    factor = detectors.element_factor(l_max + 1, sizes.n_nodes)
    waves = cap_waves(frequencies, region.radius, distance, l_max, factor, medium)
    magnitudes = waves.at_detectors * (
        waves.norms[:, None, None] * jnp.sqrt(detectors.weights)[:, None]
    )
    alpha, relative = absolute_alpha(
        rule,
        frequencies,
        jnp.sum(magnitudes**2, axis=(1, 2)) / (4 * jnp.pi),
        jnp.mean(data**2, axis=(1, 2, 3)),
        kernel_noise_power(kernels, detectors.weights),
        2 * detectors.weights.shape[0],
    )
    m = jnp.arange(sizes.n_orders)
    # conj Y_lm = (P_lm / sin^m theta) ((x_1 - i x_2) / |x|)^m, smooth on the axis too
    legendre = legendre_functions(m, l_max + 1, units[:, 2], sizes.n_orders, over_sine=True)
    across = jnp.broadcast_to(units[:, 0] - 1j * units[:, 1], (sizes.n_orders, len(units)))
    powers = jnp.cumprod(across.at[0].set(1.0), axis=0)
    polar = polar_cosines(sizes.n_directions)
    at_polar = legendre_functions(m, l_max + 1, polar, sizes.n_orders)

    @jax.checkpoint
    def at(given: tuple[Array, ...]) -> tuple[Array, Array]:
        """One frequency: F of all orders, and the residual."""
        u, back, right, alpha = given
        n = right.shape[1]
        rhs = right.reshape(2 * n, -1)
        v, squares = tikhonov_solution(_gram(u, units)[None], alpha, rhs[None])
        strengths = jnp.einsum("jkl,jki->lki", u * back, v.reshape(2, n, -1))
        strengths = jnp.pad(strengths, ((0, l_max + 1), (0, 0), (0, 0)))

        def of_order(given: tuple[Array, ...]) -> Array:
            order, functions, power, functions_at_polar = given
            part = jax.lax.dynamic_slice_in_dim(strengths, order, l_max + 1)
            coefficients = jnp.einsum("lk,lki->li", functions * power, part)
            return synthesis(order, coefficients[None], functions_at_polar)[0]

        fhat = jnp.moveaxis(jax.lax.map(of_order, (m, legendre, powers, at_polar)), 0, -1)
        return fhat, relative_residual(squares)

    spectrum, residual = jax.lax.map(at, (magnitudes, _back(waves), data, alpha))
    report = SolveReport(alpha, relative, residual, jnp.isfinite(residual))
    return jnp.moveaxis(spectrum, 1, 0), report


def _back(waves: CapWaves) -> Float[Array, "f 1 1 orders"]:
    """Delta_l s_l, from y to c."""
    return (waves.scale * waves.norms)[:, None, None]


def _gram(
    u: Float[Array, "2 detectors orders"], units: Float[Array, "detectors 3"]
) -> Float[Array, "n n"]:
    """A^T A, J before Y."""
    flat = u.reshape(-1, u.shape[-1])
    cosine = jnp.tile(units @ units.T, (2, 2))

    def add(carry: tuple[Array, Array, Array], given: tuple[Array, Array]):
        total, last, before = carry
        degree, row = given
        total = total + (2 * degree + 1) / (4 * jnp.pi) * row[:, None] * row * last
        following = ((2 * degree + 1) * cosine * last - degree * before) / (degree + 1)
        return (total, following, last), None

    start = jnp.zeros_like(cosine), jnp.ones_like(cosine), jnp.zeros_like(cosine)
    degrees = jnp.arange(flat.shape[1], dtype=flat.dtype)
    return jax.lax.scan(add, start, (degrees, flat.T))[0][0]
