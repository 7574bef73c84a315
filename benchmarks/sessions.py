"""Programs, memory maps, memory and processor time of many scans, or many sizes, in one process.

    python benchmarks/sessions.py --scans 100
    python benchmarks/sessions.py --scans 20 --fit
    python benchmarks/sessions.py --sizes 50
    python benchmarks/sessions.py --cold

Scans are of one scanner, 256 x 2030 samples, and differ in channels left out, region, speed, band,
frames and samples; from the fourth on nothing should be compiled. Sizes are numbers of detectors
and pixels of a study in Python, each of which is compiled anew. ``--cold`` times processes of their
own: without a folder of programs, with an empty one, and with one that another scan has filled.
`bench_sessions.py` makes rows of the benchmarks of it.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

PROGRAM = "/jax/core/compile/backend_compile_duration"
RADIUS, SPEED, RATE, DETECTORS, SAMPLES = 0.04, 1495.0, 4e7, 256, 2030
COMMAND = "import sys; from jaxtat.cli import main; sys.exit(main(sys.argv[1:]))"


def maps() -> int:
    return len(Path("/proc/self/maps").read_text().splitlines())


def resident() -> float:
    """Resident memory [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def counts(
    n_samples: int = SAMPLES,
    silent: tuple[int, ...] = (),
    frames: int = 1,
    speed: float = SPEED,
) -> np.ndarray:
    """What the scanner writes: pulses from a dozen places, and noise."""
    rng = np.random.default_rng(7)
    sources, width = rng.uniform(-6e-3, 6e-3, (12, 2)), rng.uniform(1.0, 3.0, 12) * 4e-7
    points, times = positions()[:, :2], np.arange(n_samples) / RATE
    record = np.zeros((DETECTORS, n_samples))
    for source, duration in zip(sources, width, strict=True):
        distance = np.hypot(*(points - source).T)[:, None]
        late = (times - distance / speed) / duration
        record -= late * np.exp(-(late**2) / 2)
    record += 0.003 * rng.standard_normal(record.shape)
    record[list(silent)] = 0
    found = (32768 + 8000 * record).astype(np.uint16)
    return found if frames == 1 else np.stack([found] * frames)


def positions() -> np.ndarray:
    theta = np.radians(90.0 + np.linspace(-135.0, 135.0, DETECTORS))
    return RADIUS * np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)


def write(path: Path, pressure: np.ndarray, sound_speed: float | None = SPEED) -> Path:
    facts = {"detectors": positions(), "sampling_rate": RATE}
    if sound_speed is not None:
        facts["sound_speed"] = sound_speed
    np.savez(path, pressure=pressure, **facts)
    return path


def a_scan(number: int, folder: Path) -> tuple[Path, dict]:
    """The number-th scan and the options with which it is reconstructed."""
    rng = np.random.default_rng(number)
    silent = tuple(int(k) for k in rng.choice(DETECTORS, number % 4, replace=False))
    frames, samples = 3 if len(silent) == 2 else 1, SAMPLES - int(rng.integers(0, 12))
    speed = SPEED * rng.uniform(0.995, 1.005)
    path = write(folder / "scan.npz", counts(samples, silent, frames, speed), sound_speed=speed)
    radius = 0.011 * rng.uniform(1.0, 1.02)
    options = {"region_radius": radius, "max_frequency": 7000.0 * rng.uniform(0.99, 1.0)}
    if number % 2:
        options["band"] = (2e5 * rng.uniform(0.9, 1.1), 7e6)
    return path, options


class Row(NamedTuple):
    """What one scan took, and what the process holds after it."""

    programs: int
    maps: int
    memory: float  # [MB]
    processor: float  # [s]


def scans(n: int, fit: bool, counted: list[str]) -> Iterator[Row]:
    from jaxtat.scans import reconstruct_file

    options = {} if fit else {"model_based": False}
    with tempfile.TemporaryDirectory() as folder:
        for k in range(n):
            path, chosen = a_scan(k, Path(folder))
            counted.clear()
            start = time.process_time()
            reconstruct_file(path, **chosen, **options)
            spent = time.process_time() - start
            yield Row(len(counted), maps(), resident(), spent)


def sizes(n: int, counted: list[str]) -> None:
    import jaxtat

    print(
        "| detectors | pixels | programs | maps | processor [s] |\n| --- | --- | --- | --- | --- |"
    )
    for k in range(n):
        counted.clear()
        start, detectors, pixels = time.process_time(), 60 + 4 * k, 21 + 2 * k
        curve = jaxtat.circular_arc(1.3, 1.0, detectors)
        setup = jaxtat.Setup(curve, jaxtat.disk(1.0), jaxtat.ImageGrid(pixels))
        jaxtat.reconstruct(setup, np.ones(setup.data_shape), 1e-6).block_until_ready()
        spent = time.process_time() - start
        print(f"| {detectors} | {pixels} | {len(counted)} | {maps()} | {spent:.1f} |", flush=True)


def command(words: str, program: str = COMMAND) -> tuple[float, float]:
    """Processor and wall time of a command in a process of its own [s]."""
    before, start = os.times(), time.time()
    subprocess.run([sys.executable, "-c", program, *words.split()], check=True)
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4]), time.time() - start


STARTS = {  # folder of programs, and what fills it beforehand
    "no folder of programs": (None, False),
    "an empty one": ("kept", False),
    "one filled by another scan": ("kept", True),
}


def started(
    folder: Path, start: str, options: str = "", *, speed: float | None = SPEED
) -> tuple[float, float]:
    """Processor and wall time of ``jaxtat reconstruct`` after one of `STARTS` [s].

    Args:
        speed: in the files; None if it is to be estimated [m/s].
    """
    kept, filled = STARTS[start]
    cache = "--no-cache" if kept is None else f"--cache {folder / kept}"
    words = f"{cache} {options} --quiet --out {folder / 'image.h5'}"
    if filled and not (folder / str(kept)).is_dir():
        others = None if speed is None else 1.003 * speed
        pressure = counts(SAMPLES - 9, speed=1.003 * SPEED)
        other = write(folder / "other.npz", pressure, sound_speed=others)
        command(f"reconstruct {other} {words}")
    scan = write(folder / "first.npz", counts(), sound_speed=speed)
    return command(f"reconstruct {scan} {words}")


def cold() -> None:
    """Print the times of ``jaxtat reconstruct`` in processes of their own."""
    print("| start | image | speed | processor [s] | wall [s] |\n|" + " --- |" * 5)
    for options, speed in (("", None), ("", SPEED), ("--direct", SPEED)):
        words = options or "fitted", "estimated" if speed is None else "in the file"
        for start in STARTS:
            with tempfile.TemporaryDirectory() as folder:
                spent, wall = started(Path(folder), start, options, speed=speed)
            print(f"| {start} | {' | '.join(words)} | {spent:.1f} | {wall:.1f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scans", type=int, default=0)
    parser.add_argument("--sizes", type=int, default=0)
    parser.add_argument("--fit", action="store_true", help="fit the scans' images")
    parser.add_argument("--cold", action="store_true")
    options = parser.parse_args()
    if options.cold:
        cold()
    if not (options.scans or options.sizes):
        return
    import jax

    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    counted: list[str] = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, *_, **__: counted.append(event) if event == PROGRAM else None
    )
    if options.scans:
        print("| scan | programs | maps | memory [MB] | processor [s] |")
        print("| --- | --- | --- | --- | --- |")
        for k, row in enumerate(scans(options.scans, options.fit, counted), 1):
            memory, spent = f"{row.memory:.0f}", f"{row.processor:.1f}"
            print(f"| {k} | {row.programs} | {row.maps} | {memory} | {spent} |", flush=True)
    if options.sizes:
        sizes(options.sizes, counted)


if __name__ == "__main__":
    main()
