"""One scan in a process of its own: reconstructed with no option, and by the oracle."""

import json
import sys
import time
import traceback
import warnings
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
from cases import SIZES, Case, cases, truth, write


def examine(case: Case, size: str, folder: Path) -> dict:
    """The row of the table; pictures go into the folder as NAME.images.npz."""
    from oracle import best, window

    from jaxtat.io import load_scan
    from jaxtat.scans import choose, estimate, reconstruct

    path = write(case, SIZES[size], folder)
    body = truth(case, SIZES[size])
    where = window(body)
    row: dict = {"name": case.name, "half": case.half, "error": float("nan"), "failed": ""}
    start = time.perf_counter()
    pictures = {"truth": where.truth}
    try:
        scan = load_scan(path)
        choices = estimate(scan, choose(scan))
        row |= _chosen(case, body, choices)
        pictures["chosen"] = where.seen(reconstruct(scan, choices))
        row |= {"error": where.error(pictures["chosen"]), "seconds": time.perf_counter() - start}
        row["reasons"] = choices.table()
    except Exception as problem:
        row |= {"failed": f"{type(problem).__name__}: {problem}", "where": traceback.format_exc()}
    scan = load_scan(path)
    if scan.n_frames > 1:
        scan = replace(scan, data=scan.data[:1], known=_without_frames(scan.known))
    try:
        found = best(scan, case, body, where)
        pictures["oracle"] = found.image
        row |= {"oracle": found.error, "oracle_alpha": found.alpha, "shows": found.shows}
    except Exception as problem:
        row["oracle_failed"] = f"{type(problem).__name__}: {problem}"
    np.savez_compressed(folder / f"{case.name}.images.npz", **pictures)
    return row


def _without_frames(known: dict) -> dict:
    return {name: value for name, value in known.items() if name != "wavelengths"}


def _chosen(case: Case, body, choices) -> dict:
    center = np.asarray(choices.region_center)
    edge = np.linalg.norm(body.centers - center, axis=1) + body.radii + body.edges
    errors = dict(choices.standard_errors)
    return {
        "speed_error": choices.sound_speed / case.speed - 1 if case.water == case.speed else None,
        "speed_grade": choices.grade("sound_speed"),
        "speed_why": dict(choices.reasons)["sound_speed"],
        "speed_standard_error": errors.get("sound_speed"),
        "region_ratio": choices.region_radius / float(edge.max()),
        "model": choices.model,
        "model_right": choices.model == case.model,
        "alpha": choices.alpha,
        "pixels": choices.pixels,
    }


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    name, size, folder = sys.argv[1:]
    (case,) = (case for case in cases() if case.name == name)
    print(json.dumps(examine(case, size, Path(folder))))
