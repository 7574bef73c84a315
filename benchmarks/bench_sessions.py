"""The first image of a process and the next ones: processor time, programs, maps of memory.

A process of its own for each row of ``command``, ``jaxtat reconstruct`` of 256 x 2030 samples on a
new machine and where another scan of the scanner has filled the folder of programs; the speed of
sound is in the file, or estimated. Of ``scan`` all rows are of one process, which reconstructs 100
scans of one scanner directly: the time is that of the first, third and last of them, programs and
maps are all there are by then. ``patato`` is PATATO's back-projection of such a scan, all told.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import sessions

SCANS = 100
PATATO = Path(__file__).with_name("patato_images.py")


@pytest.fixture
def report(benchmark):
    """A row with these numbers; ``work`` is done once."""

    def row(work, **numbers):
        result = benchmark.pedantic(work, rounds=1)
        info = {"n": 0, "images": 1, "compile_s": 0.0, "max_error": np.nan, "peak_mb": np.nan}
        benchmark.extra_info.update(info | (numbers or result))

    return row


@pytest.mark.parametrize(
    ("options", "speed"),
    [("", None), ("--direct", sessions.SPEED)],
    ids=["speed-estimated", "direct"],
)
@pytest.mark.parametrize(
    "start", ["no folder of programs", "one filled by another scan"], ids=["cold", "warm-disk"]
)
def bench_command(report, tmp_path, start, options, speed):
    report(lambda: {"median_s": sessions.started(tmp_path, start, options, speed=speed)[0]})


@pytest.fixture(scope="module")
def rows():
    """Programs, maps, memory and time of each scan."""
    script = Path(sessions.__file__)
    words = [sys.executable, str(script), "--scans", str(SCANS)]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found = re.findall(r"^\| \d+ \| (\d+) \| (\d+) \| (\d+) \| ([\d.]+) \|$", said, re.M)
    return np.array(found, float)


@pytest.mark.parametrize("number", [1, 3, SCANS])
def bench_scan(report, rows, number):
    _, maps, memory, seconds = rows[number - 1]
    made = int(rows[:number, 0].sum())
    report(lambda: None, median_s=seconds, peak_mb=memory, programs=made, maps=int(maps))


@pytest.fixture(scope="module")
def of_patato(tmp_path_factory):
    pytest.importorskip("patato")
    path = sessions.write(tmp_path_factory.mktemp("patato") / "scan.npz", sessions.counts())
    words = [sys.executable, "-W", "ignore", str(PATATO), str(path), "433", "0.011"]
    return json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("which", ["first", "next"])
def bench_patato(report, of_patato, which):
    report(lambda: None, median_s=of_patato[which], n=433)
