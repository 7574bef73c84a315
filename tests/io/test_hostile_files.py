"""A few of the files of benchmarks/robustness/fuzz_files.py, and whether it would tell."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "benchmarks" / "robustness"
PROGRAM = """
import faulthandler, json, os, warnings
from pathlib import Path
warnings.simplefilter("ignore")
from jaxtat.io import load_scan  # here, once: each process that is forked would import it
import fuzz_files
from fuzz_files import OUTCOMES, Batch, fuzz, run
from hostile_files import Case

def fails(path):
    text = path.read_bytes()
    if text == b"crash": os.abort()
    if text == b"hang":
        while True: pass
    if text == b"memory": bytearray(2**31)
    if text == b"raw": raise TypeError("raw")
    if text == b"long": raise ValueError("x" * 301)
    if text == b"lines": raise ValueError("x\\nx")
    if text == b"refused": raise ValueError("x")

fuzz_files.SECONDS, found = 0.2, {}
faulthandler.enable = lambda: None
for text in ("crash", "hang", "memory", "raw", "long", "lines", "refused", "read"):
    case = Case(text, [{"a": text.encode()}], [], changes=())
    counts, _ = run(Batch(case, fails, 0, range(3)), Path("."))
    found[text] = dict(zip(OUTCOMES, counts.tolist()))
fuzz_files.SECONDS = 300
kinds = ["npz", "npy", "matlab 5", "matlab 7.3", "hdf5", "ipasc", "patato", "msot"]
counts, said = fuzz(kinds, 96, 1)
counts = {name: dict(zip(OUTCOMES, row.tolist())) for name, row in counts.items()}
print(json.dumps([found, said, counts]))
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """In a process of its own, in which JAX has started no threads: it forks."""
    if not hasattr(os, "fork"):
        pytest.skip("processes are not forked here")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=tmp_path_factory.mktemp("fuzz"),
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(SCRIPTS), str(SCRIPTS.parents[1])])},
        capture_output=True,
        check=True,
        text=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_the_fuzzer_tells_what_happens(outcomes):
    for text, found in outcomes[0].items():
        outcome = {"raw": "raw error", "long": "long message", "lines": "long message"}
        assert found[outcome.get(text, text)] == 3 == sum(found.values())


def test_hostile_files_are_read_or_refused(outcomes):
    _, said, counts = outcomes
    assert said == ""
    assert sum(sum(found.values()) for found in counts.values()) == 96
    for found in counts.values():
        assert found["read"] + found["refused"] + found["ended"] == 12
        assert found["refused"] > 2
