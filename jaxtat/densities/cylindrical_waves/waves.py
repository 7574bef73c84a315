"""Cylindrical waves: the basis in which potentials and plane waves become small matrices.

With c the centre and angles counted from the axis (see `polar`), the waves are

    phi_n(x) = J_n(lambda |x - c|) / Delta_n · (cos n theta | sin n theta),  n = 0..N,

and for |x - c| < |z - c|, by Graf's and the Jacobi-Anger expansions (DLMF 10.23.7, 10.12.1),

    J_0|Y_0(lambda |x - z|) = Σ eps_n Delta_n (J_n|Y_n)(lambda |z - c|) (cos|sin)(n theta_z) phi_n,
    exp(-i xi·(x - c)) = Σ eps_n Delta_n (-i)^n (cos|sin)(n theta_xi) phi_n,

eps_0 = 1 and eps_n = 2 for n > 0. Delta_n decays like J_n(lambda reach), without which high orders
would overflow (`special.decay_steps`). Everything is real but the powers of -i.

Waves come as (2, N + 1), cosines first; sin 0 = 0 keeps its place. In a mirrored geometry cosines
and sines are two separate blocks, (2, N + 1), else one block of both, (1, 2 N + 2).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ...special import angular, decay_steps, radial_waves, wave_traces
from .polar import PolarGeometry


def minus_i_powers(n_max: int) -> Complex[Array, " orders"]:
    """(-i)^n."""
    return jnp.array([1, -1j, -1, 1j])[np.arange(n_max + 1) % 4]


def circular_harmonics_at(
    harmonics: Float[Array, "*batch 2 orders"], angles: Float[Array, " directions"]
) -> Complex[Array, "*batch directions"]:
    """(1/2π) Σ_n (-i)^n [c_n cos n theta + s_n sin n theta] from (c, s): fhat on a circle.

    Args:
        harmonics: (c, s), n = 0, 1, ..., (..., 2, orders).
        angles: theta, counted from where the harmonics count [rad].
    """
    order = np.arange(harmonics.shape[-1])
    waves = angular(harmonics.shape[-1] - 1, angles)
    # even orders are real, 1, -1, ..., odd ones imaginary, -i, i, ...
    signed = harmonics * np.array([1, -1, -1, 1], harmonics.dtype)[order % 4]
    real = jnp.einsum("...pn,pnd->...d", signed[..., ::2], waves[:, ::2])
    imaginary = jnp.einsum("...pn,pnd->...d", signed[..., 1::2], waves[:, 1::2])
    return jax.lax.complex(real, imaginary) / (2 * jnp.pi)


def wave_steps(
    n_max: int, frequencies: Float[Array, "*f"], geometry: PolarGeometry
) -> Float[Array, "orders *f"]:
    """delta_n = Delta_n / Delta_{n-1}, n = 0..n_max + 1 (derivatives ask for one order more)."""
    return decay_steps(n_max + 1, frequencies * geometry.reach)


def scales(steps: Float[Array, "orders *f"]) -> Float[Array, "fewer *f"]:
    """Delta_n, n = 0..N, of steps up to N + 1."""
    return jnp.cumprod(steps[:-1], axis=0)


def disk_norms(
    frequencies: Float[Array, "*f"], radius: Float[Array, ""], steps: Float[Array, "orders *f"]
) -> Float[Array, "2 fewer *f"]:
    """L2 norms of the traces (phi, (1/lambda) dphi/dn) on |x - c| = R, where they are orthogonal.

    s_n² = π R (1 + [n = 0]) (J_n² + J_n'²)(lambda R) / Delta_n²; 0 for sin 0.
    """
    value, slope, _ = radial_waves(frequencies * radius, steps)
    norm = jnp.sqrt(jnp.pi * radius * (value**2 + slope**2))
    first = np.arange(norm.shape[0]).reshape(-1, *[1] * frequencies.ndim) == 0
    return jnp.stack([jnp.where(first, jnp.sqrt(2.0), 1.0) * norm, jnp.where(first, 0.0, norm)])


def boundary_traces(
    frequency: Float[Array, ""],
    steps: Float[Array, " orders"],
    geometry: PolarGeometry,
) -> Float[Array, "traces 2 fewer"]:
    """(phi, (1/lambda) dphi/dn) of all waves at the boundary points, rows scaled by √w_x."""
    region = geometry.region
    local = region.points - geometry.center
    parts = wave_traces(frequency, steps, local, region.normals, geometry.axis)
    traces = jnp.concatenate(parts, axis=-1)
    return jnp.moveaxis(traces * jnp.tile(jnp.sqrt(region.weights), 2), -1, 0)
