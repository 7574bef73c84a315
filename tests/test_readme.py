"""What the README shows is run as it stands there, and is what it says."""

import json
import re
import shlex
from pathlib import Path

import pytest

from jaxtat.cli import main

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def shown(language):
    """Code blocks of the README that say they are run here."""
    return re.findall(rf"test_readme.py -->\n```{language}\n(.*?)```", README, flags=re.S)


def test_it_is_short():
    assert len(README.splitlines()) <= 110
    assert len(README.split()) <= 700


def test_the_python_example_does_what_it_says(capsys):
    (example,) = shown("python")
    assert 'jax.config.update("jax_enable_x64", True)' in example
    exec(compile(example, "README.md", "exec"), {})
    errors = [float(line) for line in capsys.readouterr().out.split()]
    assert len(errors) == 2
    assert max(errors) < 1.2e-7  # "about 8e-8"


def test_the_commands_work_as_shown(tmp_path, monkeypatch, capsys):
    """And print the table that is shown, some rows of it left out, numbers to a thousandth."""
    monkeypatch.chdir(tmp_path)
    (commands,) = shown("sh")
    for command in commands.strip().splitlines():
        program, *arguments = shlex.split(command)
        assert program == "jaxtat"
        assert main(arguments) == 0
    assert (tmp_path / "scan.png").stat().st_size > 5000
    printed = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line}
    (table,) = re.findall(r"```text\n(.*?)```", README, flags=re.S)
    *rows, rest = table.splitlines()
    assert rest == "..."
    assert len(rows) >= 8
    for row in rows:
        same = printed[row.split()[0]]
        assert words(row) == words(same)
        assert numbers(row) == pytest.approx(numbers(same), rel=1e-3)


NUMBER = r"\d+(?:\.\d+)?"


def numbers(text):
    return [float(number) for number in re.findall(NUMBER, text)]


def words(text):
    return re.sub(NUMBER, "0", text).split()


@pytest.mark.parametrize("page", ["docs/accuracy.md", "docs/comparison.md", "paper/paper.md"])
def test_measured_figures_are_those_of_the_benchmarks(page):
    """Rows that name a benchmark in their last cell: time and error as in results.json."""
    measured = benchmarks()
    rows = re.findall(r"\| ([\d.]+) (s|ms) \| ([\d.e-]*) ?\| `(.*?)` \|", (ROOT / page).read_text())
    assert len(rows) >= 5
    for time, unit, error, name in rows:
        seconds = float(time) * (1e-3 if unit == "ms" else 1)
        assert abs(measured[name]["median_s"] / seconds - 1) < 0.06, name
        if error:
            assert abs(measured[name]["max_error"] / float(error) - 1) < 0.06, name


def test_sizes_of_images_cost_what_the_benchmarks_say():
    """Time, error and memory by the number of pixels, as in results.json."""
    measured = benchmarks()
    of_size = r"\| (\d+), \d+ \| ([\d.]+) s \| ([\d.e-]+) \| ([\d.]+) GB \|"
    rows = re.findall(of_size, (ROOT / "docs" / "accuracy.md").read_text())
    assert len(rows) == 5
    for n, seconds, error, memory in rows:
        there = measured[f"direct[{n}]"]
        shown = float(seconds), float(error), 1e3 * float(memory)
        for value, name in zip(shown, ("median_s", "max_error", "peak_mb"), strict=True):
            assert abs(there[name] / value - 1) < 0.06, (n, name)


def benchmarks():
    runs = json.loads((ROOT / "benchmarks" / "results.json").read_text())["benchmarks"]
    return {run["name"].removeprefix("bench_"): run["extra_info"] for run in runs}


def test_figures_of_the_readme_are_those_of_the_pages():
    """Each stands in a table of a page that says how it was measured."""
    accuracy, comparison = ((ROOT / "docs" / f"{name}.md").read_text() for name in PAGES)
    assert "| smooth phantom, geometry 1 | 7.3e-5 | 1.6e-9 |" in accuracy
    assert '| "several hours" |' in accuracy
    assert "relative L2 error of 0.035 %" in comparison
    assert "about 5 %" in comparison
    measured = benchmarks()
    seconds = measured["direct[129]"]["median_s"]
    peers = json.loads((ROOT / "benchmarks" / "peers" / "results.json").read_text())["rows"]
    (theirs,) = (
        row["relative_l2"]
        for row in peers
        if row["peer"] == "Fast-Hankel solver" and row["problem"] == "half_disk_three_quarter_arc"
    )
    table = README.partition("## Accuracy and speed")[2].partition("\n## ")[0]
    figures = re.findall(r"^\| .*\| (.*?) \| (.*?) \| .*? \|$", table, re.M)[2:]
    assert figures == [
        ("7.3e-5 (the paper)", "1.6e-9"),
        ('"several hours" (the paper)', f"{seconds:.1g} s"),
        (f"about 5 % (its authors), {100 * theirs:.1f} % (here)", "0.035 %"),
        ("0.25 (time reversal)", "2e-3"),
        ("0.64 (0.43, 0.86) by the formula", "0.22 (0.09, 0.52)"),
    ]
    assert abs(measured["k_wave_time_reversal"]["max_error"] / 0.25 - 1) < 0.06
    assert abs(measured["jaxtat_from_the_record_of_k_wave"]["max_error"] / 2e-3 - 1) < 0.06


def test_the_figure_of_scans_without_options_is_that_of_the_page():
    page = (ROOT / "docs" / "automatic_choices.md").read_text()
    error = r"([\d.]+) (\([\d.]+, [\d.]+\))"  # and quartiles
    ((fitted, of_fitted, direct, of_direct),) = re.findall(
        rf"^\| all 48 \| {error} \| {error} \|", page, re.M
    )
    assert f"| {float(direct) + 1e-9:.2f} {of_direct} by the formula |" in README
    assert f"| {float(fitted) + 1e-9:.2f} {of_fitted} |" in README


PAGES = ("accuracy", "comparison")


def test_the_make_targets_are_there():
    (block,) = re.findall(r"```sh\n(make .*?)```", README, flags=re.S)
    makefile = (ROOT / "Makefile").read_text()
    for line in block.strip().splitlines():
        assert f"\n{line.split('#')[0].split()[1]}: " in makefile
    assert "make test" in (ROOT / ".ci" / "run").read_text()
