"""Writers that are killed, interrupted, or out of room at a random moment: what is there then.

Of the file the old content or the complete new one must be there, never a third thing. After
Ctrl-C and a full disk no temporary file stays; what a killed process left, the next writer removes.
Writers are warm (everything is compiled) and each runs in a process of its own, so that most of its
time is spent on what is measured. A full disk is a limit on the size of files here, which the
system answers alike ("File too large"); `--folder` takes a small disk that is really full.

    python benchmarks/robustness/interrupted.py --times 100
"""

import argparse
import os
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

WAYS = ("kill -9", "Ctrl-C", "full disk")
OUTCOMES = ("old", "new", "third thing", "temporary file", "raw error", "stuck")
STUCK = 60  # [s]


class Writer(NamedTuple):
    """How a file is written, and whether one is whole."""

    name: str
    target: str
    write: Callable[[Path], None]
    is_whole: Callable[[Path], bool]


def writers(folder: Path) -> list[Writer]:
    """`save_plan`, `save_image`, and the commands `reconstruct` and `report`."""
    from jaxtat import (
        ImageGrid,  # fmt: skip
        Setup,
        build_plan,
        circular_arc,
        data_radii,
        disk,
        load_plan,
        load_settings,
        phantoms,
        save_image,
        save_plan,
    )
    from jaxtat.cli import main

    arc, region, grid = circular_arc(1.3, 1.0, 64), disk(0.8), ImageGrid(17)
    radii = data_radii(arc, region, 0.1)
    plan = build_plan(Setup(arc, region, grid, radii))
    wide = data_radii(arc, disk(1.0), 0.1)  # for the region that is chosen
    g = phantoms.Bells([[0.1, -0.2]], [0.4]).circular_integrals(arc, wide)
    data = folder / "data.npz"
    np.savez(data, circular_integrals=g, detectors=arc.points, radii=wide)
    image = np.random.default_rng(0).random((20, 17, 17))

    def command(line: str) -> Callable[[Path], None]:
        def write(path: Path) -> None:
            code = main([*line.split(), str(data), "--out", str(path), "--quiet", "--pixels", "17"])
            if code == 130:
                raise KeyboardInterrupt
            if code:
                raise OSError(f"the command ends with {code}")

        return write

    def has_settings(path: Path) -> bool:
        import h5py

        load_settings(path)
        with h5py.File(path) as file:
            return bool(np.isfinite(file["image"][()]).all())

    def is_plan(path: Path) -> bool:
        return bool(load_plan(path).report.norm.shape == plan.report.norm.shape)

    return [
        Writer("save_plan", "plan.h5", lambda path: save_plan(plan, path), is_plan),
        Writer(
            "save_image", "image.h5",
            lambda path: save_image(path, image, grid, region, {"alpha": 0.1}), has_settings,
        ),
        Writer("jaxtat reconstruct", "scan.h5", command("reconstruct"), has_settings),
        Writer(
            "jaxtat report", "report.html", command("report"),
            lambda path: path.read_text().rstrip().endswith("</html>"),
        ),
    ]  # fmt: skip


def child(writer: Writer, path: Path, limit: int | None) -> None:
    """Write; never returns."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    code = 0
    try:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        writer.write(path)
    except (KeyboardInterrupt, OSError):
        code = 2
    except BaseException:
        code = 3
    os._exit(code)


def trial(
    writer: Writer, path: Path, way: str, rng: np.random.Generator, whole: int, took: float
) -> str:
    """One writer stopped in one way: what is there then.

    Args:
        writer, path, way: who writes where, and what happens to it.
        rng: for the moment at which it happens.
        whole: size of a whole file [byte].
        took: how long it takes to write one [s].
    """
    path.unlink(missing_ok=True)
    if there := rng.random() < 0.5:
        path.write_bytes(b"old content")
    limit = int(rng.integers(whole)) if way == "full disk" else None
    process = os.fork()
    if process == 0:
        child(writer, path, limit)
    if way != "full disk":
        # half of them late, when files are written
        time.sleep(took * (rng.uniform(0.7, 1.1) if rng.random() < 0.5 else rng.uniform(0, 1.1)))
        os.kill(process, signal.SIGKILL if way == "kill -9" else signal.SIGINT)
    status = _wait(process)
    if status is None:
        return "stuck"
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) == 3:
        return "raw error"
    rest = [name for name in os.listdir(path.parent) if name != path.name]
    if rest and way != "kill -9":
        return "temporary file"
    if path.exists() != there or (there and path.read_bytes() != b"old content"):
        return _judge(writer, path)
    return "old"


def _judge(writer: Writer, path: Path) -> str:
    try:
        return "new" if writer.is_whole(path) else "third thing"
    except (ValueError, OSError):
        return "third thing"


def _wait(process: int) -> int | None:
    """Its status, or None if it had to be killed."""
    end = time.monotonic() + STUCK
    while time.monotonic() < end:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return status
        time.sleep(0.002)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return None


def measure(writer: Writer, path: Path) -> tuple[int, float]:
    """Size of a whole file and how long it takes, once all is compiled."""
    for _ in range(2):
        start = time.perf_counter()
        writer.write(path)
        took = time.perf_counter() - start
    return path.stat().st_size, took


def run(writer: Writer, folder: Path, times: int, seed: int) -> dict[str, np.ndarray]:
    """Counts of outcomes by way, and of files that stayed after the last clean write."""
    counts, path = {}, folder / writer.target
    whole, took = measure(writer, path)
    for way in WAYS:
        rng, found = np.random.default_rng([seed, WAYS.index(way)]), np.zeros(len(OUTCOMES), int)
        for _ in range(times):
            found[OUTCOMES.index(trial(writer, path, way, rng, whole, took))] += 1
        writer.write(path)
        found[OUTCOMES.index("temporary file")] += len(os.listdir(folder)) - 1
        counts[way] = found
    return counts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--times", type=int, default=100, help="of each writer in each way")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="where to write, by default a temporary one")
    parser.add_argument("--writers", nargs="+", help="some of them")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of forking: children compute in their only thread
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
    import jax

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    print(f"| writer | stopped by | {' | '.join(OUTCOMES)} |\n| --- | --- |{' --- |' * 6}")
    good = True
    with tempfile.TemporaryDirectory(dir=options.folder) as place:
        for writer in writers(Path(place)):
            if options.writers and writer.name not in options.writers:
                continue
            folder = Path(place) / "written"
            folder.mkdir()
            for way, found in run(writer, folder, options.times, options.seed).items():
                print(f"| {writer.name} | {way} | {' | '.join(map(str, found))} |", flush=True)
                good &= found[2:].sum() == 0
            for path in folder.iterdir():
                path.unlink()
            folder.rmdir()
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
