"""Programs end on two cores: descents in compiled loops, and several threads at once.

In a process of their own, since a program that waits for ever can only be killed.
"""

import os
import subprocess
import sys

import pytest

START = """
import warnings
from concurrent.futures import ThreadPoolExecutor
import jax, jax.numpy as jnp, jaxopt
jax.config.update("jax_enable_x64", True)
warnings.simplefilter("ignore")
from jaxtat import (
    ImageGrid, NormBound, Setup, TikhonovNormBound, build_plan, circular_arc, disk,
    forward_operator, phantoms, reconstruct,
)

def problem(n, n_detectors):
    setup = Setup(circular_arc(1.3, 1.0, n_detectors), disk(1.0), ImageGrid(n))
    bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    return setup, bell.circular_integrals(setup.curve, setup.radii), bell.image(setup.grid)

def losses(n, n_detectors):
    setup, g, truth = problem(n, n_detectors)
    def by_plan(q):
        plan = build_plan(setup, NormBound(jnp.exp(q), softness=0.2))
        return jnp.sum((reconstruct(plan, g) - truth) ** 2) / jnp.sum(truth**2)
    def direct(q):
        image = reconstruct(setup, g, TikhonovNormBound(jnp.exp(q)))
        return jnp.sum((image - truth) ** 2) / jnp.sum(truth**2)
    return by_plan, direct

def scanned(loss, steps):
    def step(q, _):
        return q - jax.grad(loss)(q), None
    return jax.jit(lambda q: jax.lax.scan(step, q, None, steps)[0])(1.0)
"""
PAPER_SIZE = """
assert jnp.isfinite(scanned(losses(129, 500)[0], 2))
"""
SMALL = """
for loss in losses(25, 80):
    # a loop of a fixed number of steps is that above; here data decide when it ends
    assert jnp.isfinite(jaxopt.GradientDescent(loss, maxiter=2, stepsize=0.1).run(1.0).params)
setup, g, image = problem(25, 80)
plan = build_plan(setup)
for route in (
    lambda: reconstruct(setup, g, 1e-6),
    lambda: reconstruct(setup, g, TikhonovNormBound(3.0)),
    lambda: build_plan(setup).densities,
    lambda: reconstruct(plan, g),
    lambda: forward_operator(setup)(image),
):
    for threads in (2, 4):
        with ThreadPoolExecutor(threads) as pool:
            for one in [pool.submit(route) for _ in range(4 * threads)]:
                jax.block_until_ready(one.result())
"""


@pytest.mark.slow
def test_descents_end_and_so_do_threads(unoptimised_flags):
    """Of the paper's size and of a small one.

    How threads wait for each other is the same in loops that are not optimised.
    """
    # threads that XLA starts
    environment = os.environ | {"NPROC": "2", "XLA_FLAGS": unoptimised_flags}
    program = [sys.executable, "-c", START + PAPER_SIZE + SMALL]
    subprocess.run(program, env=environment, check=True, timeout=600)
