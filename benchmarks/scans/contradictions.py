"""How often damaged copies of the scans are said to be contradictory, and whole ones are not.

    python benchmarks/scans/contradictions.py [--half rules|held-out]

Positions in centimetres taken for millimetres, rows in another order, twice and half the sampling
rate, and records that start at another time than their file says, by shares of the radius over the
speed of sound.
"""

import argparse
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
from cases import HALVES, SIZES, Case, cases, write

SHARES = (0.1, 0.2, 0.3, 0.5)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--half", choices=HALVES, default="held-out")
    half = parser.parse_args().half
    said: dict[str, list[bool]] = {}
    in_plane = [c for c in cases() if c.half == half and c.array != "cap"]
    for case in (c for c in in_plane if "k-wave" not in c.dirt):
        for name, known, data in damaged(case):
            said.setdefault(name, []).append(is_said(known, data))
    for name, of in said.items():
        print(f"{name:20} said of {sum(of)} of {len(of)}")


def damaged(case: Case) -> Iterator[tuple[str, dict[str, np.ndarray], np.ndarray]]:
    """Kinds of damage, and what a file would hold."""
    with tempfile.TemporaryDirectory() as folder:
        known = dict(np.load(write(case, SIZES["quick"], Path(folder))))
    data, rate, positions = known.pop("pressure"), known["sampling_rate"], known["detectors"]
    order = np.random.default_rng(case.number).permutation(len(positions))
    yield "whole", known, data
    yield "rows mixed", known, data[..., order, :]
    yield "centimetres", known | {"detectors": 100 * positions}, data
    yield "half the rate", known | {"sampling_rate": rate / 2}, data
    yield "twice the rate", known | {"sampling_rate": 2 * rate}, data
    radius = np.linalg.norm(positions, axis=1).mean()
    for share in SHARES:
        n = int(share * radius / 1500 * rate)
        yield f"starts {share} late", known, data[..., n:]
        before = np.repeat(data[..., :1], n, axis=-1)
        yield f"starts {share} early", known, np.concatenate([before, data], axis=-1)


def is_said(known: dict[str, np.ndarray], data: np.ndarray) -> bool:
    """Whether the choices warn, or refuse."""
    from jaxtat.io import Scan
    from jaxtat.scans import choose
    from jaxtat.steps import AccuracyWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", AccuracyWarning)
        try:
            choose(Scan("pressure", data, known))
        except (AccuracyWarning, ValueError):
            return True
    return False


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
