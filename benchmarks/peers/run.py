"""All peers on all problems: `make peers`, or

    python benchmarks/peers/run.py [--only SCRIPT ...] [--problems NAME ...]

writes benchmarks/peers/results.json, and the images into out/peers. Clones of what is no package
are named by TORCH_TAT and FAST_HANKEL or by --clone torch_tat=FOLDER. Rows of earlier runs that are
not run again are kept.
"""

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import problems
from environments import PEERS, Absent, Peer, clone_of, last_line, python_of
from measures import measured

HERE = Path(__file__).parent
RESULTS = HERE / "results.json"
LIMIT = 900  # for one peer and one problem [s]


def main() -> None:
    options = _options()
    folder = options.out.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    simulated = *problems.PHANTOMS, *problems.TWO_SPEEDS
    if not all((folder / f"{name}.npz").is_file() for name in simulated):
        _simulate(folder, options.venvs)
    files = [
        path
        for path in problems.write(folder)
        if not options.problems or path.stem.removeprefix("problem-") in options.problems
    ]
    given = dict(pair.split("=", 1) for pair in options.clone)
    for peer in PEERS:
        if not options.only or peer.script in options.only:
            for row in _rows(peer, files, folder, options.venvs, given):
                print(json.dumps(row), flush=True)
                _store(row | {"made": _made()})


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="All peers on all problems.")
    parser.add_argument("--out", type=Path, default=Path("out/peers"), help="for the images")
    parser.add_argument("--venvs", type=Path, default=Path(".venv-peers"), help="environments")
    parser.add_argument("--only", nargs="*", help="scripts of peers")
    parser.add_argument("--problems", nargs="*", help="names, such as disks-ring")
    parser.add_argument("--clone", nargs="*", default=[], metavar="SCRIPT=FOLDER")
    return parser.parse_args()


def _simulate(folder: Path, venvs: Path) -> None:
    """k-Wave's records; without k-Wave only the problems of others are left."""
    try:
        python = python_of("kwave", venvs)
    except Absent as reason:
        print(f"no simulated problems: {reason}", file=sys.stderr)
        return
    subprocess.run([python, HERE / "simulate.py", folder], check=True, env=_environment())


def _environment() -> dict[str, str]:
    """One thread for linear algebra; jaxtat from this checkout; scripts beside one another."""
    return os.environ | {
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parents[1])]),
    }


def _rows(
    peer: Peer, files: list[Path], folder: Path, venvs: Path, given: dict[str, str]
) -> Iterator[dict]:
    """One row for each problem; one alone, with the reason, for a peer that cannot be run."""
    try:
        clone = clone_of(peer, given)
        python = python_of(peer.environment, venvs)
    except Absent as reason:
        yield {"peer": peer.title, "reason": str(reason)}
        return
    environment = _environment() | ({peer.clone: clone} if clone else {})
    for path in files:
        name = path.stem.removeprefix("problem-")
        if name not in peer.only:
            continue
        out = folder / f"image-{name}-{peer.script}.npz"
        row = _row(peer, python, path, out, environment)
        yield {"peer": peer.title, "problem": name} | row


def _row(peer: Peer, python: Path, path: Path, out: Path, environment: dict) -> dict:
    out.unlink(missing_ok=True)
    command = [python, HERE / f"{peer.script}.py", path, out]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, env=environment, timeout=LIMIT
        )
    except subprocess.TimeoutExpired:
        return {"reason": f"not done after {LIMIT} s"}
    if done.returncode or not out.is_file():
        return {"reason": last_line(done.stderr)[:200]}
    with np.load(path) as problem, np.load(out) as found:
        if "reason" in found:
            return {"reason": str(found["reason"])}
        if not np.isfinite(found["image"]).all():
            return {"reason": "its image has values that are no numbers"}
        row = _cost(found)
        if "truth" in problem:
            image = found["image"].astype(float)
            row |= measured(image, problem["truth"].astype(float), problem["inside"])
    return {name: _short(value) for name, value in row.items()}


def _cost(found) -> dict:
    """Seconds the first and, if it was run, the second time; MiB of the process; the version."""
    seconds = found["seconds"]
    return {
        "version": str(found["version"]),
        "cold_s": float(seconds[0]),
        "warm_s": float(seconds[-1]),
        "runs": len(seconds),
        "memory_mib": round(float(found["memory"])),
    }


def _short(value):
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _store(row: dict) -> None:
    """Into the results, in place of an earlier row of the same peer and problem.

    A row without a problem says why its peer cannot be run here; rows of an earlier run are worth
    more, and stay.
    """
    earlier = json.loads(RESULTS.read_text())["rows"] if RESULTS.is_file() else []
    if "problem" not in row and any(
        "problem" in old for old in earlier if old["peer"] == row["peer"]
    ):
        return
    titles, names = [peer.title for peer in PEERS], ["", *problems.NAMES]
    kept = [
        old
        for old in earlier
        if (old["peer"] in titles and old.get("problem", "") in names)
        and (old["peer"] != row["peer"] or ("problem" in old and old["problem"] != row["problem"]))
    ]
    rows = sorted(
        [*kept, row],
        key=lambda row: (titles.index(row["peer"]), names.index(row.get("problem", ""))),
    )
    RESULTS.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


def _made() -> str:
    """When and where: of each row, for a later run may make others again, elsewhere."""
    machine = f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}"
    return f"{datetime.date.today().isoformat()}, {machine}, Python {platform.python_version()}"


if __name__ == "__main__":
    main()
