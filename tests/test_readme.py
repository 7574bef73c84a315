"""What the README shows is run as it stands there."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np

from jaxtat import circular_arc, data_radii, phantoms, truncated_disk

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def shown(language):
    """Code blocks of the README that say they are run here."""
    return re.findall(rf"test_readme.py -->\n```{language}\n(.*?)```", README, flags=re.S)


def test_the_python_example_does_what_it_says():
    (example,) = shown("python")
    run = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    errors = [float(line) for line in run.stdout.split()]
    assert len(errors) == 2
    assert max(errors) < 2e-7


def test_the_commands_work_as_shown(tmp_path):
    """All but the main job, which tests/test_paper.py runs."""
    curve, region = circular_arc(1.3, 0.0, 100), truncated_disk(1.0, 0.0, 200)
    bell = phantoms.Bells([[-0.4, 0.1]], [0.4])
    radii = data_radii(curve, region, 2 / 32)
    g = np.asarray(bell.circular_integrals(curve, radii))
    np.savez(tmp_path / "data.npz", circular_integrals=g)
    (commands,) = shown("sh")
    first, *others = commands.strip().splitlines()
    assert first == "jaxtat paper --out out/paper"
    for command in others:
        program = [sys.executable, "-m", *shlex.split(command)]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        run = subprocess.run(program, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
    assert (tmp_path / "image.png").stat().st_size > 5000


def test_the_make_targets_are_there():
    (block,) = re.findall(r"```sh\n(make .*?)```", README, flags=re.S)
    makefile = (ROOT / "Makefile").read_text()
    for line in block.strip().splitlines():
        assert f"\n{line.split('#')[0].split()[1]}: " in makefile
    assert "make test" in (ROOT / ".ci" / "run").read_text()
