"""Step 3 in space: the Fourier transform on spheres of directions, from its spherical harmonics.

With c_lm of `waves`, fhat(xi) = (2π)^(-3/2) 4π Σ_lm (-i)^l Y_lm(xi) c_lm. In a meridian plane the
transform of f's integrals along the plane's normal is √(2π) fhat, so the factor there is 2.

Directions are those of n meridian planes, phi = π q/n, and in each of them n over half a turn, as
the two-dimensional steps want them: xi = lambda (cos t, sin t) in the plane's coordinates
(s, x_3), t = π j/n. Only the half xi_3 >= 0 is needed, cos theta = sin t, as f is real.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int


def polar_cosines(n_directions: int) -> Float[Array, " polar"]:
    """cos theta = sin(π j/n), j = 0 .. n/2, of the directions with xi_3 >= 0."""
    return jnp.asarray(np.sin(np.pi / n_directions * np.arange(n_directions // 2 + 1)))


def synthesis(
    order: Int[Array, ""],
    coefficients: Complex[Array, "f degrees images"],
    at_polar: Float[Array, "degrees polar"],
) -> Complex[Array, "f images 2 polar"]:
    """F_{±m} = 2 (-i)^m Σ_l (-i)^(l-m) P_lm(cos theta) c_{l,±m}, fhat = Σ_m F_m e^{i m phi}.

    f is real, hence c_{l,-m} is the conjugate of c_lm. F_{-0} is given as 0.

    Args:
        order: m.
        coefficients: c_lm, l = m, m + 1, ...
        at_polar: P_lm at `polar_cosines`.

    Returns:
        (frequencies, images, ±, polar).
    """
    sums = []
    for parity in (0, 1):
        sign = (-1.0) ** np.arange(at_polar[parity::2].shape[0])
        part = jnp.moveaxis(coefficients[:, parity::2], 1, -1)
        real = jnp.stack([part.real, part.imag]) @ (sign[:, None] * at_polar[parity::2])
        sums.append(jax.lax.complex(real[0], real[1]))
    even, odd = sums
    turn = 2 * jnp.asarray([1, -1j, -1, 1j])[order % 4]
    there = jnp.where(order > 0, turn, 0.0)
    both = turn * (even - 1j * odd), there * (even.conj() - 1j * odd.conj())
    return jnp.stack(both, axis=-2)


def meridian_fourier(
    spectrum: Complex[Array, "f 2 polar orders"], which: Int[Array, ""], n_sets: int, n: int
) -> Complex[Array, "planes f directions"]:
    """fhat in the meridian planes q = which, which + n_sets, ..., of n.

    The sum over m is turned to the first of these planes, folded to as many orders as there are
    planes in the set, both halves counted, and transformed.

    Args:
        spectrum: F_{±m}, orders last.
        which: of the sets of planes.
        n_sets: how many there are, a divisor of n.
        n: number of planes, and of directions in each.
    """
    length = 2 * n // n_sets
    m_max = spectrum.shape[-1] - 1
    before = -(-m_max // length) * length  # so that m = 0 comes to a multiple of the length
    total = before + -(-(m_max + 1) // length) * length
    turn = jnp.exp(1j * jnp.pi / n * which * jnp.arange(-before, total - before))

    def at(given: Array) -> Array:
        there, here = jnp.flip(given[1, :, 1:], axis=-1), given[0]
        line = jnp.concatenate([there, here], axis=-1)
        line = jnp.pad(line, ((0, 0), (before - m_max, total - before - m_max - 1)))
        return (line * turn).reshape(line.shape[0], -1, length).sum(axis=-2)

    # one frequency at a time: in memory the spectrum is the largest thing there is
    folded = jax.lax.map(at, spectrum)
    values = jnp.fft.ifft(folded, norm="forward")  # (f, polar, azimuths over a whole turn)
    here, there = jnp.split(values, 2, axis=-1)
    # t <= π/2 on this side of the axis, beyond on the other
    plane = jnp.concatenate([here, there[:, -2:0:-1]], axis=1)
    return jnp.moveaxis(plane, -1, 0)
