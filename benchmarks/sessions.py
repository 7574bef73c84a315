"""Programs, memory maps and time of reconstructions of sizes that were not compiled before.

    python benchmarks/sessions.py --sizes 12

Prints for each size what one direct reconstruction of it compiles, and how many sizes fill the maps
that Linux grants a process. The first size has the programs that all of them share.
"""

import argparse
import statistics
import time
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxtat  # noqa: E402

PROGRAM = "/jax/core/compile/backend_compile_duration"


def maps() -> int:
    return len(Path("/proc/self/maps").read_text().splitlines())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", type=int, default=12)
    programs: list[str] = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, *_, **__: programs.append(event) if event == PROGRAM else None
    )
    found, before = [], maps()
    print(
        "| detectors | pixels | programs | maps | processor [s] |\n| --- | --- | --- | --- | --- |"
    )
    for k in range(parser.parse_args().sizes):
        programs.clear()
        here, start = maps(), time.process_time()
        n, pixels = 60 + 4 * k, 21 + 2 * k
        setup = jaxtat.Setup(
            jaxtat.circular_arc(1.3, 1.0, n), jaxtat.disk(1.0), jaxtat.ImageGrid(pixels)
        )
        g = np.ones(setup.data_shape)
        jaxtat.reconstruct(setup, g, 1e-6).block_until_ready()
        found.append((len(programs), maps() - here, time.process_time() - start))
        print(f"| {n} | {pixels} | {found[-1][0]} | {found[-1][1]} | {found[-1][2]:.1f} |")
    per_size = statistics.median(row[1] for row in found[1:])
    granted = int(Path("/proc/sys/vm/max_map_count").read_text())
    print(f"{(granted - before) / per_size:.0f} sizes fill the {granted} maps of a process.")


if __name__ == "__main__":
    main()
