"""Non-uniform FFTs of jax-finufft and in JAX, from a grid, at the forward operator's sizes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat.special import from_grid, nufft

POINTS = {(257, 257): 138_312, (65, 65, 65): 200_000}
MADE_BY = {"jax_finufft": from_grid, "jaxtat": nufft._in_jax}


@pytest.mark.parametrize("shape", POINTS, ids=lambda shape: "x".join(map(str, shape)))
@pytest.mark.parametrize("slope", [False, True], ids=["sum", "slope"])
@pytest.mark.parametrize("maker", MADE_BY)
def bench_nufft(measure, maker, slope, shape):
    """The sums alone, and with their derivative in the points."""
    rng, transform = np.random.default_rng(0), MADE_BY[maker]
    points = jnp.asarray(rng.uniform(-np.pi, np.pi, (POINTS[shape], len(shape))))
    values = jnp.asarray(rng.standard_normal((1, *shape)) + 0j)

    @jax.jit
    def work(points):
        return jnp.sum(jnp.abs(transform(values, points, 1e-9)) ** 2)

    function = jax.jit(jax.grad(work)) if slope else work
    measure(lambda: function(points), n=shape[0], rounds=3)
