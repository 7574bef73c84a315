"""Images and frequencies over several devices and processes: the same images as on one."""

import os
import socket
import subprocess
import sys
from contextlib import ExitStack, contextmanager

import jax
import numpy as np
import pytest

from jaxtat import phantoms, reconstruct
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
g = np.asarray(phantoms.Bells([[0.1, 0.2]], [0.7]).circular_integrals(setup.curve, setup.radii))
def here(array):
    return np.asarray(array.addressable_data(0))
"""

DIRECT = """
shared = reconstruct(setup, g, 1e-8, mesh=mesh)
assert len(shared.sharding.device_set) == n_devices
if jax.process_index() == 0:  # one of them is enough to compare
    error = np.abs(here(shared) - here(reconstruct(setup, g, 1e-8))).max()
    assert error < 1e-6, error
print("direct: the same")
"""

GRADIENT = """
def size(g, alpha, mesh):
    image = reconstruct(setup, g, alpha, mesh=mesh)
    return jnp.sum(image ** 2), image

gradient = jax.grad(size, (0, 1), has_aux=True)
(ours, shared), (theirs, alone) = (gradient(g, 1e-6, which) for which in (mesh, None))
assert len(shared.sharding.device_set) == n_devices
error = np.abs(here(shared) - here(alone)).max()
assert error < 1e-6, error
for one, other in zip(ours, theirs, strict=True):
    assert np.allclose(here(one), other, rtol=1e-7, atol=1e-9 * np.abs(other).max())
print("images and gradients: the same")
"""

PLAN = """
plan = build_plan(setup)
stack = np.stack([k * g for k in range(5)])
error = np.abs(here(reconstruct(plan, stack, mesh=mesh)) - here(reconstruct(plan, stack))).max()
assert error < 1e-12, error
print("plan: the same")
"""

DIVIDED = """
from jax.sharding import NamedSharding, PartitionSpec
stack = np.stack([g, 2 * g])
divided = jax.device_put(stack, NamedSharding(mesh, PartitionSpec("devices")))
alone = here(reconstruct(setup, stack, 1e-3))
for work in (reconstruct, jax.jit(reconstruct)):
    image = work(setup, divided, 1e-3)
    assert np.abs(here(image) - alone).max() < 1e-9
print("divided beforehand: the same")
"""

SPACE = """
cap = spherical.spherical_cap(1.5, 1.1, 8, 16)
setup = Setup(cap, spherical.ball(1.0), VolumeGrid(7), max_frequency=6.0)
g = np.asarray(spherical.SolidBells([[0.1, 0.2, 0.0]], [0.7]).spherical_integrals(cap, setup.radii))
stack = np.stack([g, -2 * g, 3 * g])
shared, alone = (reconstruct(setup, stack, 1e-6, mesh=which) for which in (mesh, None))
assert len(shared.sharding.device_set) == n_devices
error = np.abs(here(shared) - here(alone)).max() / np.abs(here(alone)).max()
assert error < 1e-9, error
print("space: the same")
"""


@contextmanager
def running(script: str, *arguments: str):
    """A process that ends with the block, whatever happens in it; a busy machine has its time."""
    environment = os.environ | {"NPROC": "8", "OPENBLAS_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}
    process = subprocess.Popen(
        [sys.executable, "-c", PROBLEM + script, *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    with process:  # waits for it, and closes its pipe
        try:
            yield process
        finally:
            process.kill()


def finish(process: subprocess.Popen) -> str:
    output, _ = process.communicate()
    assert process.returncode == 0, output[-3000:]
    return output


@pytest.mark.slow
def test_two_devices_share_frequencies_and_images(unoptimised):
    with running(GRADIENT + PLAN + DIVIDED + SPACE, "2") as process:
        output = finish(process)
    for what in ("images and gradients", "plan", "divided beforehand", "space"):
        assert f"{what}: the same" in output


@pytest.mark.slow
def test_two_processes_share_the_frequencies(unoptimised):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    with ExitStack() as stack:
        both = [stack.enter_context(running(DIRECT, "2", address, str(k))) for k in (0, 1)]
        assert all("direct: the same" in finish(process) for process in both)


def test_no_process_is_left_behind_when_a_test_is_interrupted(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "PROBLEM", "import time; time.sleep(3600)")
    with pytest.raises(KeyboardInterrupt), running("") as process:
        raise KeyboardInterrupt
    assert process.poll() is not None


def test_shards_are_dealt_and_collected_in_order():
    mesh = checked_mesh(jax.make_mesh((1,), ("devices",)))
    rows = jax.numpy.arange(10.0).reshape(5, 2)
    for which in (None, mesh):
        assert np.array_equal(
            map_shards(lambda factor, part: factor * part, 2.0, rows, which), 2 * rows
        )


def test_a_mesh_of_two_axes_is_refused(arc, arc_plan):
    bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    g = bell.circular_integrals(arc.curve, arc.radii)
    for problem in (arc, arc_plan):
        with pytest.raises(ValueError, match="of one axis"):
            reconstruct(problem, g, mesh=jax.make_mesh((1, 1), ("a", "b")))
    with pytest.raises(ValueError, match="of one axis"):
        checked_mesh("gpu")
