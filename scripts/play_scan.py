"""The frames of a scan as a scanner would send them: raw, so many a second, on standard output.

    python scripts/play_scan.py scan.npz --rate 10 --frames 50 | \
        jaxtat stream scan.npz --drop --out images.h5

A scan of few frames is repeated.
"""

import argparse
import sys
import time

import numpy as np

from jaxtat.io import load_scan


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scan")
    parser.add_argument("--rate", type=float, default=10.0, help="frames a second")
    parser.add_argument("--frames", type=int, default=50, help="how many in all")
    options = parser.parse_args()
    scan = load_scan(options.scan)
    start = time.perf_counter()
    for number in range(options.frames):
        time.sleep(max(0.0, start + number / options.rate - time.perf_counter()))
        sys.stdout.buffer.write(np.ascontiguousarray(scan.frame(number % scan.n_frames)).tobytes())
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
