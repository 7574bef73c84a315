"""What each rule of `jaxtat.scans` is worth: errors with all of them, and without each.

    python benchmarks/scans/ablation.py --first NUMBER [--last NUMBER] [--jobs N] [--out FOLDER]

Small scans. A rule that a scan does not ask, or that leaves its choices as they are, costs nothing.
Where there is no image without a rule, one of zeros counts. Writes ablation.json and ablation.md
into the folder, and what `run.py` writes.
"""

import argparse
import json
import os
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path

import jax
import numpy as np
from cases import SIZES, Case, cases, truth
from examine import examine
from run import HERE, LONGEST, UNOPTIMISED, described, write_tables
from without import RULES

SAID = ("reasons", "grades", "standard_errors")  # fields of choices that no pixel depends on
CLEARLY = 0.1  # share of the error, from which on it counts as another


def ablated(case: Case, folder: Path) -> dict:
    """The row of `examine`, and errors without each rule that decides anything: {rule: error}."""
    from oracle import window

    from jaxtat.io import load_scan
    from jaxtat.scans import choose, reconstruct, with_best_method

    with ExitStack() as stack:
        asked = {name: stack.enter_context(rule.watched()) for name, rule in RULES.items()}
        row = examine(case, "quick", False, "one", folder)
    scan, where = load_scan(folder / f"{case.name}.npz"), window(truth(case, SIZES["quick"]))

    def chosen():
        return with_best_method(scan, choose(scan))

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


def in_a_process(case: Case, folder: Path) -> dict | None:
    """The row of a scan; None, with a word, where it fails."""
    command = [sys.executable, str(HERE / "ablation.py"), "--one", case.name, "--out", str(folder)]
    try:
        done = subprocess.run(
            command,
            stdout=subprocess.PIPE,
            text=True,
            timeout=LONGEST,
            env=os.environ | UNOPTIMISED,
            check=True,
        )
        row = json.loads(done.stdout.splitlines()[-1])
        return row | {"half": case.half, "dirt": described(case)}
    except (subprocess.SubprocessError, IndexError, json.JSONDecodeError) as problem:
        print(f"{case.name}: {problem}", file=sys.stderr)
        return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0, metavar="NUMBER")
    parser.add_argument("--last", type=int, default=None, metavar="NUMBER")
    parser.add_argument("--one", metavar="NAME", help="print its row")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="scans at a time")
    parser.add_argument("--out", type=Path, default=Path("out/scans"), metavar="FOLDER")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.one:
        (case,) = (case for case in cases() if case.name == options.one)
        print(json.dumps(ablated(case, options.out)))
        return
    last = float("inf") if options.last is None else options.last
    wanted = [
        case
        for case in cases()
        if options.first <= case.number <= last and "k-wave" not in case.dirt
    ]
    rows: list[dict] = []
    with ThreadPoolExecutor(options.jobs) as pool:
        for row in pool.map(lambda case: in_a_process(case, options.out), wanted):
            if row is None:
                continue
            rows.append(row)
            changed = {k: round(e, 3) for k, e in row["without"].items() if e != row["error"]}
            print(row["name"], f"{row['error']:.3f}", changed, flush=True)
            (options.out / "ablation.json").write_text(json.dumps(rows, indent=1))
            write_tables(rows, options.out)
            (options.out / "ablation.md").write_text(table(rows) + "\n")
    print(table(rows))


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    main()
