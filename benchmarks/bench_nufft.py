"""Non-uniform FFTs of the two libraries, from a grid (type 2), at the forward operator's sizes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

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
