"""Memory and time of reconstructions and plans by their sizes: the constants of base/cost.py.

    python benchmarks/cost.py

Each case runs in a process of its own: its peak memory, less that of a small one, and the processor
time of the second call, in which nothing is compiled.
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
]
CHILD = """
import json, resource, sys, time
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
import jaxtat as jt
what, pixels, n, waves = json.loads(sys.argv[1])
curve, grid = jt.circular_arc(1.3, 1.0, n), jt.ImageGrid(pixels)
region = jt.truncated_disk(1, 1, 4 * waves)
radii = np.linspace(0.28, 2.32, 2 * waves + 9)
g = np.random.default_rng(0).standard_normal((n, len(radii)))
def work():
    if what == "plan":
        return jt.build_plan(curve, region, grid, radii, max_frequency=float(waves), progress=False)
    return jt.reconstruct_direct(curve, region, grid, radii, g, max_frequency=float(waves))
layout = jt.problem_layout(curve, region, grid, radii, max_frequency=float(waves))
jax.block_until_ready(work())
start = time.process_time()
jax.block_until_ready(work())
seconds = time.process_time() - start
sizes = [layout.n_frequencies, layout.n_directions]
print(json.dumps([*sizes, seconds, 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss]))
"""


def main() -> None:
    print("what     pixels detectors waves frequencies directions  seconds      MB")
    for case in CASES:
        run = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", CHILD, json.dumps(case)],
            capture_output=True,
            text=True,
            check=True,
        )
        frequencies, directions, seconds, peak = json.loads(run.stdout)
        what, pixels, n, waves = case
        print(f"{what:8}{pixels:7}{n:10}{waves:6}{frequencies:12}{directions:11}", end="")
        print(f"{seconds:9.2f}{peak / 1e6:8.0f}", flush=True)


if __name__ == "__main__":
    main()
