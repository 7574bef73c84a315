"""What is published: wheels, extras, the paper about the package and whom it cites."""

import json
import re
import runpy
import shutil
import tomllib
import zipfile
from pathlib import Path

import pytest
from PIL import Image

from jaxtat.cli.parser import build_parser

ROOT = Path(__file__).resolve().parents[1]
PAPER = ROOT / "paper"
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def test_wheels_of_the_same_sources_are_the_same_bytes(tmp_path, monkeypatch):
    """Whatever the folder and the dates of its files; with all that is no Python too."""
    builder = pytest.importorskip("hatchling.builders.wheel").WheelBuilder
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    wheels = []
    for name in ("one", "other"):
        copy = tmp_path / name
        skipped = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "jaxtat", copy / "jaxtat", ignore=skipped, copy_function=shutil.copy)
        for file in ("pyproject.toml", "README.md", "LICENSE"):
            shutil.copy(ROOT / file, copy)
        (wheel,) = builder(str(copy)).build(directory=str(tmp_path / f"of-{name}"))
        wheels.append(Path(wheel))
    assert wheels[0].read_bytes() == wheels[1].read_bytes()
    inside = set(zipfile.ZipFile(wheels[0]).namelist())
    sources = (path for path in (ROOT / "jaxtat").rglob("*") if path.is_file())
    wanted = {str(path.relative_to(ROOT)) for path in sources if "__pycache__" not in path.parts}
    assert wanted <= inside


def held(extra):
    """All extras that one installs."""
    named = [re.match(r"jaxtat\[(.*?)\]", text) for text in EXTRAS[extra]]
    found = {name for match in named if match for name in match[1].split(",")}
    return found.union(*map(held, found))


def test_the_extra_all_has_what_users_may_want():
    """All but those for work on jaxtat itself."""
    assert held("all") == set(EXTRAS) - {"all", "bench", "docs", "test"}


def test_the_paper_cites_what_is_in_its_list_and_is_short():
    text = (PAPER / "paper.md").read_text()
    cited = set(re.findall(r"\[-?@(\w+)\]", text))
    listed = re.findall(r"^@\w+\{(\w+),", (PAPER / "paper.bib").read_text(), re.M)
    assert sorted(cited) == sorted(listed)
    body = text.split("---", 2)[2]
    assert 750 <= len(body.split()) <= 1100
    assert (PAPER / "figure.png").stat().st_size > 20_000


def test_the_paper_s_figure_and_counts_are_those_of_the_comparison():
    """The picture's file holds the numbers that it shows; others' names are in its legend."""
    script = runpy.run_path(str(ROOT / "scripts" / "paper_figure.py"))
    results = json.loads((ROOT / script["RESULTS"]).read_text())
    with Image.open(PAPER / "figure.png") as figure:
        assert json.loads(figure.text["Description"]) == script["points"](results)
    errors = {}
    for row in results["rows"]:
        if "relative_l2" in row:
            errors.setdefault(row["problem"], {})[row["peer"]] = row["relative_l2"]
    drawn = {peer for problem in script["ARRAYS"] for peer in errors[problem]}
    assert drawn == set(script["MARKS"])
    own = "jaxtat, own choices"
    judged = [found for found in errors.values() if own in found]
    others = [min(found[p] for p in found if "jaxtat" not in p) for found in judged]
    ahead = sum(found[own] < other for found, other in zip(judged, others, strict=True))
    text = " ".join((PAPER / "paper.md").read_text().split())
    assert f"in {ahead} of {len(judged)} problems" in text


def test_changes_begin_with_those_that_are_not_released():
    headings = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert headings[:1] == ["Unreleased"]
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in headings[1:])


def test_hooks_before_a_commit_are_the_checks_of_make():
    tools = re.findall(r"\$\(BIN\)/(ruff \w+|pyright)", (ROOT / "Makefile").read_text())
    hooks = re.findall(
        r"entry: \.venv/bin/(ruff \w+|pyright)", (ROOT / ".pre-commit-config.yaml").read_text()
    )
    assert sorted(hooks) == sorted(tools)


def test_bug_reports_ask_for_choices_and_versions():
    """By commands that the parser takes."""
    template = (ROOT / ".github" / "ISSUE_TEMPLATE" / "bug_report.md").read_text()
    assert "jaxtat --version\n" in template
    (line,) = re.findall(r"^jaxtat info .*$", template, re.M)
    assert line == "jaxtat info FILE --json -"
    assert callable(build_parser().parse_args(line.split()[1:]).run)
