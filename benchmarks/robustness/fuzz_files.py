"""Damaged and hostile files of every kind that is read: how many end otherwise than they should.

Each is either read, or refused by a ValueError or OSError of one line of 300 characters at most.
That jaxtat opens files in a process that may end is what is attacked here; how often it did is
counted ("ended"). What calls jaxtat runs in a process of its own, too, which may be killed by a
signal (crash), take more than 300 s (hang), or ask for more than 1 GB; then the file is named, and
the next goes on behind it. Checksums of HDF5 are mended (`hdf5_checksums`). File number n of a kind
follows from seed, kind and n alone:

    python benchmarks/robustness/fuzz_files.py --files 100000
    python benchmarks/robustness/fuzz_files.py --kinds ipasc --first 4711 --files 1 --keep /tmp/bad
"""

import argparse
import faulthandler
import mmap
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hdf5_checksums import structures
from hostile_files import Case, seeds_of

MEMORY = 2**30  # [byte]
SECONDS = 300  # by the clock, for one file; the process that opens it has 10 s of the processor
MAX_BYTES = 2**28  # of one file's arrays
OUTCOMES = ("read", "refused", "ended", "long message", "raw error", "memory", "hang", "crash")
GOOD = ("read", "refused", "ended")
Reader = Callable[[Path], Any]


def read_scan(path: Path) -> None:
    """What a user of a scan asks of it: some frames, or all if they are few."""
    from jaxtat.io import load_scan

    scan = load_scan(path, max_bytes=MAX_BYTES)
    if scan.n_detectors * scan.n_samples < 2**24:
        for number in {0, scan.n_frames // 2, scan.n_frames - 1}:
            np.array(scan.frame(number))


def read_plan(path: Path) -> None:
    """Of a plan that is read an image is made, as far as shapes and types go."""
    import equinox as eqx

    from jaxtat import reconstruct
    from jaxtat.io import load_plan

    plan = load_plan(path)
    if os.stat(path).st_size % 4 == 0:  # of some: it takes a hundred times as long
        data = np.zeros((plan.curve.n_detectors, len(plan.radii)))
        eqx.filter_eval_shape(reconstruct, plan, data)


def read_settings(path: Path) -> None:
    from jaxtat.io import load_settings

    load_settings(path)


class Batch(NamedTuple):
    """Files of one kind, by number."""

    case: Case
    read: Reader
    seed: int
    numbers: range


class Progress:
    """Where a child is, and how its files ended, in memory shared with its parent."""

    def __init__(self) -> None:
        self.values = np.frombuffer(mmap.mmap(-1, 8 * (1 + len(OUTCOMES))), np.int64)
        self.values[0] = -1

    def begin(self, number: int) -> None:
        self.values[0] = number

    def end(self, outcome: str) -> None:
        self.values[1 + OUTCOMES.index(outcome)] += 1
        self.values[0] = -1


def outcome_of(read: Reader, path: Path) -> tuple[str, str]:
    """How reading ends, and what was said."""
    try:
        read(path)
    except (ValueError, OSError) as error:
        text = str(error)
        reasons = [error]
        while (cause := reasons[-1].__cause__) is not None:
            reasons.append(cause)
        if any(isinstance(reason, MemoryError) for reason in reasons):
            return "memory", text
        if len(text) > 300 or not text.isprintable():
            return "long message", text
        ended = "reading it ended" in text or "reading it took too long" in text
        return "ended" if ended else "refused", text
    except MemoryError as error:
        return "memory", str(error)
    except BaseException as error:
        return "raw error", f"{type(error).__name__}: {error}"
    return "read", ""


def child(batch: Batch, start: int, progress: Progress, log: Path, keep: Path | None) -> None:
    """Read files from a number on; never returns."""
    base = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (base + MEMORY, base + MEMORY))
    folder = Path(tempfile.mkdtemp(dir=log.parent))
    faulthandler.enable()
    for number in range(start, batch.numbers.stop):
        progress.begin(number)
        path = batch.case.write(folder, np.random.default_rng([batch.seed, number]))
        if keep is not None:
            shutil.copytree(folder, keep, dirs_exist_ok=True)
        signal.setitimer(signal.ITIMER_REAL, SECONDS)  # its signal ends the process
        outcome, text = outcome_of(batch.read, path)
        signal.setitimer(signal.ITIMER_REAL, 0)
        progress.end(outcome)
        if outcome not in GOOD or keep is not None:
            with log.open("a") as file:
                file.write(f"{batch.case.name} {number}: {outcome}: {text[:2000]!r}\n")
    shutil.rmtree(folder)
    os._exit(0)


def run(batch: Batch, folder: Path, keep: Path | None = None) -> tuple[np.ndarray, str]:
    """Counts of all outcomes, and a line for each that is not good."""
    progress, log, start = Progress(), folder / f"{batch.case.name}.log", batch.numbers.start
    log.touch()
    while start < batch.numbers.stop:
        process = os.fork()
        if process == 0:
            try:
                child(batch, start, progress, log, keep)
            except BaseException as error:
                print(f"{batch.case.name}: the fuzzer itself: {error!r}", file=sys.stderr)
            os._exit(1)
        _, status = os.waitpid(process, 0)
        number = int(progress.values[0])
        if os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0:
            break
        if not os.WIFSIGNALED(status) or number < 0:
            raise RuntimeError(f"{batch.case.name}: the fuzzer failed at file {number}.")
        cause = signal.Signals(os.WTERMSIG(status)).name
        outcome = "hang" if cause == "SIGALRM" else "crash"
        progress.end(outcome)
        with log.open("a") as file:
            file.write(f"{batch.case.name} {number}: {outcome}: {cause}\n")
        start = number + 1
    return progress.values[1:].copy(), log.read_text()


def reader_of(name: str) -> Reader:
    return {"plan": read_plan, "image": read_settings}.get(name, read_scan)


def fuzz(
    names: Sequence[str], files: int, seed: int, first: int = 0, keep: Path | None = None
) -> tuple[dict[str, np.ndarray], str]:
    """Outcomes by kind, about as many files of each, and what was not good."""
    counts, bad = {}, ""
    with tempfile.TemporaryDirectory() as folder:
        cases = seeds_of(Path(folder), names)
        for place, case in enumerate(cases):
            for content in (each for seed_files in case.seeds for each in seed_files.values()):
                structures(content)  # once, not in each process
            share = files // len(cases) + (place < files % len(cases))
            batch = Batch(case, reader_of(case.name), seed, range(first, first + share))
            began = time.perf_counter()
            counts[case.name], said = run(batch, Path(folder), keep)
            bad += said
            took = time.perf_counter() - began
            ends = ", ".join(
                f"{n} {outcome}"
                for outcome, n in zip(OUTCOMES, counts[case.name], strict=True)
                if n
            )
            line = f"{case.name}: {share} files in {took:.1f} s: {ends}\n{said}"
            print(line, end="", file=sys.stderr, flush=True)
    return counts, bad


def table(counts: dict[str, np.ndarray]) -> str:
    """Kinds down, outcomes across."""
    rows = [("kind", *OUTCOMES), *((name, *map(str, row)) for name, row in counts.items())]
    rows.append(("all", *map(str, sum(counts.values(), np.zeros(len(OUTCOMES), int)))))
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|" + " --- |" * len(rows[0]), *lines[1:]])


def main() -> int:
    from hostile_files import KINDS

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first file of a kind")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--keep", type=Path, help="folder for a copy of each file")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of reading odd headers, and of forking
    import jax

    from jaxtat.io import load_plan, load_scan  # noqa: F401 (once, before the children)

    jax.config.update("jax_enable_x64", True)
    counts, _ = fuzz(options.kinds, options.files, options.seed, options.first, options.keep)
    print(table(counts))
    bad = [i for i, outcome in enumerate(OUTCOMES) if outcome not in GOOD]
    return int(any(row[bad].any() for row in counts.values()))


if __name__ == "__main__":
    sys.exit(main())
