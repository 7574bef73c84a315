"""What each rule of `jaxtat.scans` is worth: errors with all of them, and without each.

The script makes the row of one scan, as examine.py does, for `run.py --ablation`. A rule that a
scan does not ask, or that leaves its choices as they are, costs nothing. Where there is no image
without a rule, one of zeros counts.
"""

import json
import sys
import warnings
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path

import jax
import numpy as np
from cases import SIZES, Case, cases, truth
from examine import examine, options
from without import RULES

SAID = ("reasons", "grades", "standard_errors")  # fields of choices that no pixel depends on
CLEARLY = 0.1  # share of the error, from which on it counts as another


def ablated(case: Case, size: str, oracle: bool, speeds: str, folder: Path) -> dict:
    """The row of `examine`, and errors without each rule that decides anything: {rule: error}."""
    from oracle import window

    from jaxtat.io import load_scan
    from jaxtat.scans import choose, reconstruct, with_best_method

    with ExitStack() as stack:
        asked = {name: stack.enter_context(rule.watched()) for name, rule in RULES.items()}
        row = examine(case, size, oracle, speeds, folder)
    if row["failed"]:
        return row | {"without": {}}
    scan, where = load_scan(folder / f"{case.name}.npz"), window(truth(case, SIZES[size]))
    given = options(case, speeds)

    def chosen():
        return with_best_method(scan, choose(scan, **given))

    whole, row["without"] = chosen(), {}
    for name in [name for name, was_asked in asked.items() if was_asked()]:
        with RULES[name].left_out():
            try:
                other = chosen()
                same = _values(other) == _values(whole) and name != "mute"
                error = row["error"] if same else where.error(where.seen(reconstruct(scan, other)))
            except Exception as problem:
                print(f"{case.name} without {name}: {problem}", file=sys.stderr)
                error = 1.0
            row["without"][name] = error
    return row


def _values(choices) -> dict:
    return {f.name: getattr(choices, f.name) for f in fields(choices) if f.name not in SAID}


def table(rows: list[dict]) -> str:
    """How many errors change, which way, and what becomes of the median of all."""
    rows = [row for row in rows if not row["failed"]]
    errors = np.array([row["error"] for row in rows])
    lines = [
        f"{len(rows)} scans, median error {np.median(errors):.3f}, mean {errors.mean():.3f}.",
        "",
        "| without the rule of | asked | worse | better | median | mean |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, rule in RULES.items():
        asked = [row for row in rows if name in row["without"]]
        others = np.array([row["without"].get(name, row["error"]) for row in rows])
        worse, better = others > (1 + CLEARLY) * errors, others < (1 - CLEARLY) * errors
        counts = f"{len(asked)} | {worse.sum()} | {better.sum()}"
        lines.append(f"| {rule.says} | {counts} | {np.median(others):.3f} | {others.mean():.3f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    name, size, against, speeds, folder = sys.argv[1:]
    (case,) = (case for case in cases() if case.name == name)
    print(json.dumps(ablated(case, size, against == "oracle", speeds, Path(folder))))
