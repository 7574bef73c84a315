"""Processor time of PATATO's first and next images of a scan, from the start of the process [s].

python benchmarks/patato_images.py SCAN.npz PIXELS HALF_WIDTH
"""

import json
import sys
import time
from types import SimpleNamespace

import numpy as np
from patato import ReferenceBackprojection
from peers.patato_scan import image_of, preprocessed


def main(path: str, pixels: str, half_width: str) -> None:
    with np.load(path) as scan:
        record = scan["pressure"].astype(float)
        problem = SimpleNamespace(
            record=record - record.mean(axis=1, keepdims=True),
            detectors=scan["detectors"][:, :2],
            sampling_rate=float(scan["sampling_rate"]),
            sound_speed=float(scan["sound_speed"]),
            pixels=int(pixels),
            half_width=float(half_width),
        )
    spent = [0.0]
    for _ in range(2):
        data = preprocessed(problem, hilbert=True)
        if not np.isfinite(image_of(problem, ReferenceBackprojection, *data)).all():
            raise ValueError("PATATO's image holds NaN.")
        spent.append(time.process_time())
    print(json.dumps({"first": spent[1], "next": spent[2] - spent[1]}))


if __name__ == "__main__":
    main(*sys.argv[1:])
