"""Images and frequencies over several devices and processes: the same images as on one."""

import os
import socket
import subprocess
import sys
from contextlib import contextmanager

import jax
import numpy as np
import pytest

from jaxtat import reconstruct
from jaxtat.base.parallel import checked_mesh, map_shards

PROBLEM = """
import sys
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_enable_x64", True)
from jaxtat import *
n_devices = int(sys.argv[1])
if len(sys.argv) > 2:
    jax.distributed.initialize(sys.argv[2], num_processes=2, process_id=int(sys.argv[3]))
else:
    jax.config.update("jax_num_cpu_devices", n_devices)
mesh = jax.make_mesh((n_devices,), ("devices",))
setup = Setup(circular_arc(1.3, 1.0, 60), disk(1.0), ImageGrid(15))
bell = phantoms.Bells([[0.1, 0.2]], [0.7])
g = np.asarray(bell.circular_integrals(setup.curve, setup.radii))
def here(array):
    return np.asarray(array.addressable_data(0))
"""

DIRECT = """
alone = solve(setup, g, 1e-8)
for solver in ("cholesky",) if len(sys.argv) > 2 else ("cholesky", "cg"):
    shared = solve(setup, g, 1e-8, solver=solver, mesh=mesh)
    assert len(shared.image.sharding.device_set) == n_devices
    error = np.abs(here(shared.image) - here(alone.image)).max()
    assert error < 1e-6, (solver, error)
print("direct: the same")
"""

GRADIENT = """
def size(g, alpha, mesh):
    return jnp.sum(reconstruct(setup, g, alpha, mesh=mesh) ** 2)

gradient = jax.grad(size, (0, 1))
for ours, one in zip(gradient(g, 1e-6, mesh), gradient(g, 1e-6, None), strict=True):
    assert np.allclose(here(ours), one, rtol=1e-7, atol=1e-9 * np.abs(one).max())
print("gradient: the same")
"""

PLAN = """
plan = build_plan(setup)
stack = np.stack([k * g for k in range(5)])
error = np.abs(here(reconstruct(plan, stack, mesh=mesh)) - here(reconstruct(plan, stack))).max()
assert error < 1e-12, error
print("plan: the same")
"""


@contextmanager
def running(script: str, *arguments: str):
    """A process that is gone afterwards, whatever happens."""
    environment = os.environ | {"NPROC": "8", "OPENBLAS_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}
    process = subprocess.Popen(
        [sys.executable, "-c", PROBLEM + script, *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def finish(process: subprocess.Popen) -> str:
    """What it says; it may take as long as a busy machine wants."""
    output, _ = process.communicate()
    assert process.returncode == 0, output[-3000:]
    return output


def test_two_devices_share_frequencies_and_images(unoptimised):
    with running(DIRECT + GRADIENT + PLAN, "2") as process:
        output = finish(process)
    for what in ("direct", "gradient", "plan"):
        assert f"{what}: the same" in output


def test_two_processes_share_the_frequencies(unoptimised):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    with running(DIRECT, "2", address, "0") as one, running(DIRECT, "2", address, "1") as other:
        assert all("direct: the same" in finish(process) for process in (one, other))


def test_shards_are_dealt_and_collected_in_order():
    mesh = checked_mesh(jax.make_mesh((1,), ("devices",)))
    rows = jax.numpy.arange(10.0).reshape(5, 2)
    for which in (None, mesh):
        assert np.array_equal(
            map_shards(lambda factor, part: factor * part, 2.0, rows, which), 2 * rows
        )


def test_a_mesh_of_two_axes_is_refused(arc, arc_plan):
    for problem in (arc, arc_plan):
        with pytest.raises(ValueError, match="of one axis"):
            mesh = jax.make_mesh((1, 1), ("a", "b"))
            reconstruct(problem, np.zeros(arc.data_shape), mesh=mesh)
    with pytest.raises(ValueError, match="of one axis"):
        checked_mesh("gpu")
