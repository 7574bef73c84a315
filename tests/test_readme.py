"""What the README shows is run as it stands there."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from jaxtat import circular_arc, data_radii, disk, phantoms
from jaxtat.cli import main
from jaxtat.io import Scan, save_ipasc

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def shown(language):
    """Code blocks of the README that say they are run here."""
    return re.findall(rf"test_readme.py -->\n```{language}\n(.*?)```", README, flags=re.S)


def test_the_python_example_does_what_it_says():
    plane, space = shown("python")
    errors = printed(plane)
    assert len(errors) == 2
    assert max(errors) < 2e-7
    (error,) = printed(space)
    assert error < 4e-4


def printed(example):
    """Numbers that an example prints in a fresh interpreter."""
    run = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return [float(line) for line in run.stdout.split()]


@pytest.mark.parametrize("page", ["README.md", "docs/comparison.md"])
def test_measured_figures_are_those_of_the_benchmarks(page):
    """Rows that name a benchmark in their last cell: time and error as in results.json."""
    runs = json.loads((ROOT / "benchmarks" / "results.json").read_text())["benchmarks"]
    measured = {run["name"].removeprefix("bench_"): run["extra_info"] for run in runs}
    rows = re.findall(r"\| ([\d.]+) (s|ms) \| ([\d.e-]*) ?\| `(.*?)` \|", (ROOT / page).read_text())
    assert len(rows) >= 5
    for time, unit, error, name in rows:
        seconds = float(time) * (1e-3 if unit == "ms" else 1)
        assert abs(measured[name]["median_s"] / seconds - 1) < 0.06, name
        if error:
            assert abs(measured[name]["max_error"] / float(error) - 1) < 0.06, name


def test_the_commands_work_as_shown(tmp_path, monkeypatch):
    """All but the main job, which tests/paper/test_paper.py runs."""
    monkeypatch.chdir(tmp_path)
    curve, region = circular_arc(1.3, 0.0, 100), disk(1.0, 0.0, n_boundary=200)
    bell = phantoms.Bells([[-0.4, 0.1]], [0.4])
    radii = data_radii(curve, region, 2 / 32)
    g = np.asarray(bell.circular_integrals(curve, radii))
    np.savez("data.npz", circular_integrals=g)
    save_ipasc("scan.hdf5", small_scan())
    (commands,) = shown("sh")
    first, *others = commands.strip().splitlines()
    assert first == "jaxtat paper --out out/paper"
    for command in others:
        assert main(shlex.split(command)[1:]) == 0
    for picture in ("image.png", "scan.png"):
        assert (tmp_path / picture).stat().st_size > 5000


def small_scan():
    """A bell on an arc of 60 detectors in metres: p = d(g/r)/dr, sampled every 0.6 mm."""
    curve, bell = circular_arc(0.04, 0.03, 60), phantoms.Bells([[2e-3, 1e-3]], [8e-3])
    radii = 6e-4 * (1 + np.arange(140))
    means = np.asarray(bell.circular_integrals(curve, radii)) / radii
    positions = np.insert(np.asarray(curve.points), 2, 0.0, axis=1)
    known = {"detectors": positions, "times": radii / 1500, "sound_speed": 1500.0}
    return Scan("pressure", np.gradient(means, 6e-4, axis=1), known)


def test_the_make_targets_are_there():
    (block,) = re.findall(r"```sh\n(make .*?)```", README, flags=re.S)
    makefile = (ROOT / "Makefile").read_text()
    for line in block.strip().splitlines():
        assert f"\n{line.split('#')[0].split()[1]}: " in makefile
    assert "make test" in (ROOT / ".ci" / "run").read_text()
