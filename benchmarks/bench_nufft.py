"""Non-uniform FFTs: the two libraries, and the image by one in place of the lattice of step 5.

Sizes are those of the forward operator (type 2). The image by type 1 sums the same samples as
filtered back-projection, with the weights of its ramp.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import problem

from jaxtat.special import from_grid, nufft

POINTS = {(129, 129): 37_722, (257, 257): 138_312, (65, 65, 65): 200_000}
LIBRARIES = {
    "jax_finufft": from_grid,
    "nufftax": lambda values, points, tolerance: nufft._in_jax(values, points, tolerance),
}


@pytest.mark.parametrize("shape", POINTS, ids=lambda shape: "x".join(map(str, shape)))
@pytest.mark.parametrize("slope", [False, True], ids=["sum", "slope"])
@pytest.mark.parametrize("library", LIBRARIES)
def bench_nufft(measure, library, slope, shape):
    """The sums alone, and with their derivative in the points."""
    rng, transform = np.random.default_rng(0), LIBRARIES[library]
    points = jnp.asarray(rng.uniform(-np.pi, np.pi, (POINTS[shape], len(shape))))
    values = jnp.asarray(rng.standard_normal((1, *shape)) + 0j)

    @jax.jit
    def work(points):
        return jnp.sum(jnp.abs(transform(values, points, 1e-9)) ** 2)

    function = jax.jit(jax.grad(work)) if slope else work
    measure(lambda: function(points), n=shape[0], rounds=3)


@pytest.mark.parametrize("n", [65, 129, 257, 513])
def bench_inversion_by_nufft(measure, n):
    case = problem(n)
    grid, angles, step = case.setup.grid, case.setup.sizes.angles, case.setup.frequencies[0]
    frequencies = step * jnp.arange(n)
    fhat = case.phantom.fourier(frequencies, angles)
    directions = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    weights = ramp(n - 1) * step**2 / len(angles)

    @jax.jit
    def invert(fhat, frequencies):
        points = (frequencies[:, None, None] * directions).reshape(-1, 2) * grid.spacing
        like = jax.ShapeDtypeStruct((1, *grid.shape), fhat.dtype)
        spread = jax.linear_transpose(lambda f: from_grid(f, points, 1e-9), like)
        return spread((fhat * weights[:, None]).reshape(1, -1))[0][0].real

    measure(lambda: invert(fhat, frequencies), n=n, error=case.error, rounds=3 if n > 257 else 7)


def ramp(n):
    """Weights of lambda = 0..n steps: |lambda|, but at 0 and n, as for samples of the band."""
    j = np.arange(-n, n)
    odd = j % 2 != 0
    kernel = np.where(odd, -1 / (np.pi * np.where(odd, j, 1)) ** 2, 0.0)
    kernel[n] = 0.25
    weights = 2 * n * np.fft.fft(np.fft.ifftshift(kernel)).real[: n + 1]
    weights[[0, -1]] /= 2
    return jnp.asarray(weights)
