"""Formats of other packages, registered by an entry point as docs/how-to/extending.md shows it."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from jaxtat.cli import main
from jaxtat.io import load_scan

PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "extending.md").read_text()
BLOCKS = re.findall(r"^```\w+\n(.*?)^```", PAGE, flags=re.S | re.M)
(MODULE,) = (block for block in BLOCKS if "def recognise" in block)
(TABLE,) = (block for block in BLOCKS if "scan_formats" in block)
ANGLES = 2 * np.pi * np.arange(48) / 48
POSITIONS = 0.04 * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
RECORD = np.random.default_rng(0).standard_normal((48, 2000))


@pytest.fixture
def register(tmp_path, monkeypatch):
    """Install a package `labtools` with this source, whose format is registered as on the page."""

    def installed(source):
        site = tmp_path / "site"
        info = site / "labtools-1.0.dist-info"
        info.mkdir(parents=True)
        (site / "labtools.py").write_text(source)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: labtools\nVersion: 1.0\n")
        group, line = re.fullmatch(r'\[project\.entry-points\."(.*)"\]\n(.*)\n', TABLE).groups()
        (info / "entry_points.txt").write_text(f"[{group}]\n{line.replace(chr(34), '')}\n")
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, "labtools", raising=False)

    yield installed
    sys.modules.pop("labtools", None)


@pytest.fixture
def lab_file(tmp_path):
    path = tmp_path / "scan.lab"
    np.savetxt(path, np.hstack([POSITIONS, RECORD]), "%.17g", header="lab 1")
    return path


def test_the_format_of_the_page_is_read(register, lab_file, tmp_path, capsys):
    with pytest.raises(ValueError, match=r"scan\.lab: it begins as none of the formats"):
        load_scan(lab_file)
    register(MODULE)
    scan = load_scan(lab_file)
    assert np.array_equal(scan.data, RECORD)
    assert np.array_equal(scan.known["detectors"], POSITIONS)
    line = f"info {lab_file} --model in-plane --sound-speed 1500 --force"
    assert main(line.split()) == 0  # the record is noise
    assert "of our laboratory" in capsys.readouterr().out
    np.savez(tmp_path / "own.npz", pressure=RECORD, detectors=POSITIONS)
    assert load_scan(tmp_path / "own.npz").about["format"] == "NumPy archive"
    with pytest.raises(ValueError, match="holds pressure, and circular_integrals was wanted"):
        load_scan(lab_file, kind="circular_integrals")


def test_entry_points_of_another_package_are_those_of_python(register, lab_file):
    """Once importlib_metadata is imported, Python's own function returns that package's."""
    pytest.importorskip("importlib_metadata")
    register(MODULE)
    assert np.array_equal(load_scan(lab_file).data, RECORD)


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("import nothing_of_that_name", "it failed .*nothing_of_that_name.*tell its authors"),
        ("def recognise(path): return 1 / 0", "it failed .*division by zero.*tell its authors"),
        ("def recognise(path): return True", "AttributeError: .*'read'"),
        ("def recognise(path): return True\ndef read(path): return 5", "returned a int, expected"),
        (
            "def recognise(path): return True\ndef read(path): raise ValueError('no x\\nno y')",
            "no x no y",
        ),
    ],
)
def test_what_fails_in_it_is_one_line_that_names_it(register, lab_file, capsys, source, reason):
    register(source)
    assert main(["info", str(lab_file)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert re.search(rf"scan\.lab: the format 'lab' of labtools: .*{reason}", said), said
