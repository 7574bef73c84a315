"""Writers that are killed, interrupted, or out of room at a random moment: what is there then.

Of the file the old content or the complete new one must be there, never a third thing. After
Ctrl-C and a full disk no temporary file stays; what a killed process left, the next writer removes.

A writer runs up to where it begins to write its file. From there it goes on in processes forked for
each trial, so that all of their time is spent on what is measured. Before, nothing is written that
stays, and so the commands as a whole are only interrupted ("Ctrl-C anywhere"). A full disk is a
limit on the size of files, which the system answers alike ("File too large"), or with `--folder` on
a small disk one that other files fill but for a random rest.

    python benchmarks/robustness/interrupted.py --times 100
    mount -t tmpfs -o size=64m tmpfs /mnt && python ... --folder /mnt --fill
"""

import argparse
import contextlib
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

WAYS = ("kill -9", "Ctrl-C", "full disk", "Ctrl-C anywhere")
OUTCOMES = ("old", "new", "third thing", "temporary file", "raw error", "stuck")
STUCK = 20  # [s]
OLD, FILLING = b"old content", "filling"


class Writer(NamedTuple):
    """How a file is written, and whether one is whole."""

    name: str
    target: str
    write: Callable[[Path], None]
    is_whole: Callable[[Path], bool]


def writers(folder: Path) -> list[Writer]:
    """`save_plan`, `save_image`, and the commands `reconstruct` and `report`."""
    from jaxtat import ImageGrid, Setup, build_plan, circular_arc, data_radii, disk, phantoms
    from jaxtat.cli import main
    from jaxtat.io import load_plan, load_settings, save_image, save_plan

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


class Trial(NamedTuple):
    """What is done to one process that writes.

    Attributes:
        way: one of `WAYS`.
        moment: share of the time that writing takes.
        room: share of the file for which there is room.
        old: whether there is a file already.
    """

    way: str
    moment: float
    room: float
    old: bool


def trials_of(way: str, times: int, seed: int) -> list[Trial]:
    """Half of the moments are late, when files are finished."""
    rng = np.random.default_rng([seed, WAYS.index(way)])
    lows = np.where(rng.random(times) < 0.5, 0.0, 0.7)
    return [
        Trial(way, rng.uniform(low, 1.1), rng.random(), bool(rng.random() < 0.5)) for low in lows
    ]


class Forks:
    """Trials at the moment when a writer begins to write, with a look for what others left.

    Args:
        writer, path: who writes where.
        trials: what is done to each process.
        fill: fill the disk with another file rather than limit sizes.
    """

    def __init__(self, writer: Writer, path: Path, trials: list[Trial], fill: bool):
        self.writer, self.path, self.trials, self.fill = writer, path, trials, fill
        self.found: list[tuple[str, str]] = []  # way and outcome
        self.whole, self.took = 0, 0.0  # size of the file [byte], time to write it [s]

    def run(self) -> None:
        """Trials; then the file is written to its end."""
        from jaxtat.base import atomic

        sweep, parent, code = atomic._sweep, os.getpid(), 0

        def begin(target: Path) -> None:
            atomic._sweep = sweep
            self._try_all()
            sweep(target)

        atomic._sweep = begin
        try:
            self.writer.write(self.path)
        except (KeyboardInterrupt, OSError):
            code = 2
        except BaseException:
            code = 3
        if os.getpid() != parent:
            os._exit(code)
        if code:
            raise RuntimeError(f"{self.writer.name}: writing without a trial failed")

    def _try_all(self) -> None:
        """Returns at once in each child, to write, and in the parent after all trials."""
        seconds = []
        for _ in range(5):
            start = time.perf_counter()
            process = os.fork()
            if process == 0:
                return _be_silent()
            if _wait(process) != 0:
                raise RuntimeError(f"{self.writer.name}: a forked process does not write")
            seconds.append(time.perf_counter() - start)
        self.took, self.whole = min(seconds), self.path.stat().st_size
        for trial in self.trials:
            _prepare(self.path, trial.old)
            if trial.way == "full disk" and self.fill:
                _fill(self.path.parent / FILLING, int(trial.room * self.whole))
            process = os.fork()
            if process == 0:
                _be_silent()
                if trial.way == "full disk" and not self.fill:
                    limit = int(trial.room * self.whole)
                    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
                return
            if trial.way != "full disk":
                time.sleep(self.took * trial.moment)
                os.kill(process, signal.SIGKILL if trial.way == "kill -9" else signal.SIGINT)
            status = _wait(process)
            (self.path.parent / FILLING).unlink(missing_ok=True)
            self.found.append((trial.way, outcome_of(self.writer, self.path, trial, status)))


def _be_silent() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)


def _prepare(path: Path, old: bool) -> None:
    path.unlink(missing_ok=True)
    if old:
        path.write_bytes(OLD)


def _fill(path: Path, rest: int) -> None:
    """A file that leaves so many bytes of its disk free."""
    disk = os.statvfs(path.parent)
    with contextlib.suppress(OSError), path.open("wb") as file:  # full a page earlier than it says
        file.write(bytes(max(0, disk.f_bavail * disk.f_frsize - rest)))


def outcome_of(writer: Writer, path: Path, trial: Trial, status: int | None) -> str:
    """What is there after a process that ended with a status of `os.waitpid`."""
    if status is None:
        return "stuck"
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) == 3:
        return "raw error"
    rest = [name for name in os.listdir(path.parent) if name != path.name]
    if rest and trial.way != "kill -9":
        return "temporary file"
    if path.exists() != trial.old or (trial.old and path.read_bytes() != OLD):
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


def interrupted_anywhere(writer: Writer, path: Path, trials: list[Trial]) -> list[str]:
    """Outcomes of Ctrl-C from the first to the last line of a writer, in this process."""

    def seconds() -> float:
        start = time.perf_counter()
        writer.write(path)
        return time.perf_counter() - start

    found, took = [], min(seconds() for _ in range(2))
    # as the handler of Ctrl-C does
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    for trial in trials:
        _prepare(path, trial.old)
        status = 0
        try:
            signal.setitimer(signal.ITIMER_REAL, max(1e-4, took * trial.moment))
            writer.write(path)
            signal.setitimer(signal.ITIMER_REAL, 0)
        except (KeyboardInterrupt, OSError):
            status = 2 << 8
        except BaseException as error:
            print(repr(error)[:300], file=sys.stderr)
            status = 3 << 8
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        found.append(outcome_of(writer, path, trial, status))
    signal.signal(signal.SIGALRM, before)
    return found


def run(writer: Writer, folder: Path, times: int, seed: int, fill: bool) -> dict[str, np.ndarray]:
    """Counts of outcomes by way, and of files that stayed after the last clean write."""
    path = folder / writer.target
    writer.write(path)  # compiles
    forks = Forks(writer, path, [t for way in WAYS[:3] for t in trials_of(way, times, seed)], fill)
    forks.run()
    found = list(forks.found)
    found += [(WAYS[0], "temporary file")] * (len(os.listdir(folder)) - 1)
    if writer.name.startswith("jaxtat "):
        ends = interrupted_anywhere(writer, path, trials_of(WAYS[3], times, seed))
        found += [(WAYS[3], end) for end in ends]
    return {
        way: np.array([found.count((way, outcome)) for outcome in OUTCOMES])
        for way in WAYS
        if way in dict(found)
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--times", type=int, default=100, help="of each writer in each way")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="where to write, by default a temporary one")
    parser.add_argument("--fill", action="store_true", help="fill that folder's disk")
    parser.add_argument("--writers", nargs="+", help="some of them")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of forking: children compute nothing
    import jax

    jax.config.update("jax_enable_x64", True)
    print(f"| writer | stopped by | {' | '.join(OUTCOMES)} |\n| --- | --- |{' --- |' * 6}")
    good = True
    with (
        tempfile.TemporaryDirectory(dir=options.folder) as place,
        tempfile.TemporaryDirectory() as data,
    ):
        for writer in writers(Path(data)):
            if options.writers and writer.name not in options.writers:
                continue
            folder = Path(place) / "written"
            folder.mkdir()
            for way, found in run(
                writer, folder, options.times, options.seed, options.fill
            ).items():
                print(f"| {writer.name} | {way} | {' | '.join(map(str, found))} |", flush=True)
                good &= found[2:].sum() == 0
            for path in folder.iterdir():
                path.unlink()
            folder.rmdir()
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
