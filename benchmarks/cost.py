"""Memory and time of reconstructions and plans by their sizes: the constants of base/cost.py.

    python benchmarks/cost.py            all of them
    python benchmarks/cost.py 4 7 10     some, by their number from 0

Each case runs in a process of its own: its peak memory less that before the work (so programs count
too, some 150 MB, and those of a second call), the processor time of the second call, in which
nothing is compiled, and beside them what base/cost.py says: the larger of steps 1 to 3 and of
steps 4 and 5, as they come one after the other.
"""

import json
import subprocess
import sys

# what, pixels, detectors, waves = highest frequency times the region's radius
CASES = [
    ("direct", 33, 40, 16),
    ("direct", 1601, 40, 16),
    ("direct", 1601, 40, 64),
    ("direct", 33, 40, 256),
    ("direct", 33, 256, 256),
    ("plan", 33, 40, 16),
    ("plan", 33, 200, 64),
    ("plan", 33, 400, 64),
    ("plan", 33, 200, 128),
    ("direct", 33, 800, 512),
    ("plan", 33, 256, 256),
    ("space", 33, 40, 32),
    ("space", 161, 40, 32),
    ("space", 65, 96, 64),
]
CHILD = """
import json, os, resource, sys, time
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
import jaxtat as jt
import jaxtat.reconstruction
from jaxtat.spherical import ball, spherical_cap
what, pixels, n, waves = json.loads(sys.argv[1])
told = []
def note(of, count, *words):
    told.append(of(count))
for name, module in list(sys.modules.items()):  # wherever room is asked for
    if name.startswith("jaxtat.") and "require_room" in vars(module):
        module.require_room = note
if what == "space":  # n rings of twice as many azimuths
    curve, region, grid = spherical_cap(1.3, 1.0, n, 2 * n), ball(1.0), jt.VolumeGrid(pixels)
else:
    curve, grid = jt.circular_arc(1.3, 1.0, n), jt.ImageGrid(pixels)
    region = jt.disk(1.0)
radii = np.linspace(0.28, 2.32, 2 * waves + 9)
def work():
    setup = jt.Setup(curve, region, grid, radii, max_frequency=float(waves))
    if what == "plan":
        return jt.build_plan(setup)
    g = np.random.default_rng(0).standard_normal(setup.data_shape)
    return jt.reconstruct(setup, g, inversion="fourier" if what == "space" else "fbp")
before = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
jax.block_until_ready(work())
first = list(told)
start = time.process_time()
jax.block_until_ready(work())
seconds = time.process_time() - start
peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
most = [max(part.nbytes for part in first), os.cpu_count() * sum(part.seconds for part in first)]
print(json.dumps([seconds, peak, *most]))
"""


def main() -> None:
    print("what     pixels detectors waves   seconds  expected      MB  expected")
    for case in [CASES[int(k)] for k in sys.argv[1:]] or CASES:
        run = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", CHILD, json.dumps(case)],
            capture_output=True,
            text=True,
            check=True,
        )
        seconds, peak, nbytes, expected = json.loads(run.stdout)
        what, pixels, n, waves = case
        print(f"{what:8}{pixels:7}{n:10}{waves:6}{seconds:10.2f}{expected:10.2f}", end="")
        print(f"{peak / 1e6:8.0f}{nbytes / 1e6:10.0f}", flush=True)


if __name__ == "__main__":
    main()
