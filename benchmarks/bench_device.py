"""The main functions on an accelerator beside the same on the processor of its machine.

    python benchmarks/bench_device.py [--platform cuda] [--only NAME] [--limit S] [--lanes N]

Each row of `device_rows.py` runs in a process of its own on either, so that what ends one stops no
other and memory is its own: the device's at its peak, or of the processor's process what the work
took beyond what was there. Half of all cores serve the accelerator, the other half are the
processor; with several lanes each has its share of them, and the device is timed for one at a time.
Writes device.md and device.json, with the traceback of what failed.
"""

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock, get_ident

import numpy as np

COLUMNS = "{0}", "processor", "{0}, first call more", "processor", "{0}, memory", "processor"
Rows = dict[str, dict[str, dict]]  # by name and platform


def answer(name: str, platform: str, cores: list[int], path: Path, limit: float) -> dict:
    """Of the process of one row."""
    environment = os.environ | {
        "JAX_PLATFORMS": platform if platform == "cpu" else f"{platform},cpu",
        "XLA_PYTHON_CLIENT_PREALLOCATE": "false",
        "OPENBLAS_NUM_THREADS": "1",
    }
    script, said = str(Path(__file__).with_name("device_rows.py")), ""
    command = ["taskset", "-c", ",".join(map(str, cores)), sys.executable, "-W", "ignore"]
    command += [script, name, str(path)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=limit, env=environment
        )
        said = done.stderr[-2000:]
        return json.loads(done.stdout.splitlines()[-1])
    except subprocess.TimeoutExpired:
        return {"failed": f"not within {limit} s"}
    except (IndexError, json.JSONDecodeError):
        return {"failed": f"ended without an answer: {said}"}


def compare(both: dict[str, dict], paths: list[Path]) -> None:
    """How far apart the results are, relative in the 2-norm, once both are there."""
    if len(both) == 2 and all(path.exists() for path in paths):
        there, here = map(np.load, paths)
        for row in both.values():
            row["apart"] = float(np.linalg.norm(there - here) / np.linalg.norm(here))


def line(name: str, platform: str, both: dict[str, dict]) -> str:
    rows = [both.get(which, {"failed": ""}) for which in (platform, "cpu")]
    cells = [
        f"{row[key]:.3g} {unit}" if key in row else "failed" if row["failed"] else ""
        for key, unit in (("median_s", "s"), ("compile_s", "s"), ("peak_mb", "MB"))
        for row in rows
    ]
    cells.append(f"{rows[0]['apart']:.1e}" if "apart" in rows[0] else "")
    return f"| {' | '.join([name, *cells])} |"


def report(platform: str, found: Rows) -> str:
    answers = [(name, which, row) for name in found for which, row in found[name].items()]
    kinds = {row["device"] for _, which, row in answers if which == platform and "device" in row}
    head = ["what", *(column.format(platform) for column in COLUMNS), "apart"]
    lines = [f"{platform}: {', '.join(kinds)}", "", f"| {' | '.join(head)} |"]
    lines += ["|" + " --- |" * len(head), *(line(name, platform, found[name]) for name in found)]
    for name, which, row in answers:
        if "failed" in row:
            lines += ["", f"{name}, {which}:", "", "```", row["failed"].strip(), "```"]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--platform", default="cuda", help="of JAX")
    parser.add_argument("--only", default="", metavar="NAME", help="rows whose name holds this")
    parser.add_argument("--limit", type=float, default=600.0, help="s for a row and a platform")
    parser.add_argument("--lanes", type=int, default=1, metavar="N", help="rows at a time")
    parser.add_argument("--out", type=Path, default=Path("out/device"), metavar="FOLDER")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    from device_rows import ROWS

    names, cores = [name for name in ROWS if options.only in name], sorted(os.sched_getaffinity(0))
    share, lanes, written = len(cores) // (2 * options.lanes) or 1, {}, Lock()
    found: Rows = {name: {} for name in names}

    def run(name: str, platform: str) -> None:
        mine = lanes.setdefault(get_ident(), len(lanes)) * share
        paths = [options.out / f"{names.index(name)}-{p}.npy" for p in (options.platform, "cpu")]
        path = paths[platform == "cpu"]
        got = answer(name, platform, cores[mine : mine + share] or cores, path, options.limit)
        print(platform, name, got, flush=True)
        with written:
            found[name][platform] = got
            compare(found[name], paths)
            (options.out / "device.json").write_text(json.dumps(found, indent=1))
            (options.out / "device.md").write_text(report(options.platform, found))

    pools = {p: ThreadPoolExecutor(options.lanes) for p in (options.platform, "cpu")}
    for name in names:
        for platform, pool in pools.items():
            pool.submit(run, name, platform)
    for pool in pools.values():
        pool.shutdown()


if __name__ == "__main__":
    main()
