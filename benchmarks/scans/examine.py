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


def options(case: Case, speeds: str) -> dict:
    """What `choose` is told."""
    if speeds == "unsaid":
        return {}
    water = {"water_speed": case.water} if speeds == "two-water-given" else {}
    return {"two_speeds": speeds != "one"} | water


def examine(case: Case, size: str, oracle: bool, speeds: str, folder: Path) -> dict:
    """The row of the table; pictures go into the folder as NAME.images.npz."""
    given = options(case, speeds)
    from oracle import window

    from jaxtat.io import load_scan
    from jaxtat.scans import choose, reconstruct, with_best_method

    path = write(case, SIZES[size], folder)
    body = truth(case, SIZES[size])
    where = window(body)
    row: dict = {"name": case.name, "half": case.half, "error": float("nan"), "failed": ""}
    start = time.process_time()
    corners = where.points.reshape(-1, where.points.shape[-1])[[0, -1], :2]
    pictures = {"truth": where.truth, "corners": corners}
    try:
        scan = load_scan(path)
        direct = choose(scan, **given)
        choices = with_best_method(scan, direct)
        row |= _chosen(case, body, direct)
        pictures["chosen"] = where.seen(reconstruct(scan, choices))
        row |= {"error": where.error(pictures["chosen"]), "seconds": time.process_time() - start}
        row["max_frequency"] = choices.max_frequency
        row["direct"] = where.error(where.seen(reconstruct(scan, direct)))
        row["reasons"] = choices.table()
    except Exception as problem:
        row |= {"failed": f"{type(problem).__name__}: {problem}", "where": traceback.format_exc()}
    if oracle:
        row |= _best(load_scan(path), case, body, where, pictures)
    np.savez_compressed(folder / f"{case.name}.images.npz", **pictures)
    return row


def _best(scan, case: Case, body, where, pictures: dict) -> dict:
    """What the oracle adds to row and pictures."""
    from oracle import best

    if scan.n_frames > 1:
        scan = replace(scan, data=scan.data[:1], known=_without_frames(scan.known))
    try:
        found = best(scan, case, body, where)
    except Exception as problem:
        return {"oracle_failed": f"{type(problem).__name__}: {problem}"}
    pictures["oracle"] = found.image
    return {
        "oracle": found.error,
        "oracle_method": found.method,
        "oracle_alpha": None if found.choices.model_based else found.choices.alpha,
        "oracle_weight": found.choices.weight,
        "oracle_frequency": found.choices.max_frequency,
    }


def _without_frames(known: dict) -> dict:
    return {name: value for name, value in known.items() if name != "wavelengths"}


def _chosen(case: Case, body, choices) -> dict:
    center = np.asarray(choices.region_center)
    edge = np.linalg.norm(body.centers - center, axis=1) + body.radii + body.edges
    errors = dict(choices.standard_errors)
    return {
        # a wrong radius is made good by a speed that is wrong alike
        "speed_error": choices.sound_speed / (case.stretch * case.speed) - 1
        if case.water == case.speed
        else None,
        "speed_grade": choices.grade("sound_speed"),
        "speed_why": dict(choices.reasons)["sound_speed"],
        "speed_standard_error": errors.get("sound_speed"),
        "region_ratio": choices.region_radius / float(edge.max()),
        "start": case.start,
        "start_error": choices.time_shift - case.start,
        "start_grade": choices.grade("time_shift"),
        "model": choices.model,
        "model_right": choices.model == case.model,
        "alpha": choices.alpha,
        "pixels": choices.pixels,
    }


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    name, size, against, speeds, folder = sys.argv[1:]
    (case,) = (case for case in cases() if case.name == name)
    print(json.dumps(examine(case, size, against == "oracle", speeds, Path(folder))))
