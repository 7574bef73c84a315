"""Processor time of live images of the public scan: the table of docs/how-to/live.md.

    OPENBLAS_NUM_THREADS=1 python benchmarks/live_processor_time.py

Processor time counts all threads and hardly depends on what else the machine does. Medians of 12,
of single images 30; of making it, the second time in one process.
"""

import time

import jax
import numpy as np

import jaxtat
from jaxtat.io import load_scan

PIXELS = 400


def median(work, values):
    """Median processor time [s] of the work with each of the values in turn."""
    times = []
    for value in values:
        start = time.process_time()
        jax.block_until_ready(work(value))
        times.append(time.process_time() - start)
    return float(np.median(times[1:]))  # the first compiles


def main():
    jax.config.update("jax_enable_x64", True)
    scan = load_scan(jaxtat.io.datasets.fetch("msot_scan9", quiet=True))
    given = {"pixels": PIXELS, "inversion": "fourier", "sound_speed": 1477.0}
    choices = jaxtat.scans.choose(scan, **given)
    frame = scan.frame(0)
    row = "{:32s} {:.3g} s".format
    print(row("making it", median(lambda _: jaxtat.live(scan, choices)(frame), range(2))))
    live = jaxtat.live(scan, choices, reach=1.1 * choices.region_radius)

    def changed(name):
        return lambda value: live.replace(**{name: value})

    print(row("another speed", median(changed("sound_speed"), 1480.0 + np.arange(13.0))))
    print(row("another start", median(changed("time_shift"), 1e-8 * np.arange(13.0))))
    print(row("another rule", median(changed("rule"), 0.01 + 0.001 * np.arange(13))))
    centers = [(1e-5 * k, 0.0) for k in range(13)]
    print(row("another centre within reach", median(changed("region_center"), centers)))
    print(row("one image", median(live, [frame] * 31)))
    print(row("eight images at once", median(live, [np.stack([frame] * 8)] * 13)))


if __name__ == "__main__":
    main()
