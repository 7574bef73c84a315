"""Table, growth and history of a benchmark run: python report.py results.json history.png.

The table, the picture of the growth and ``history.csv`` lie beside the results; the picture of the
history lies where the documentation shows it.
"""

import json
import re
import sys
from pathlib import Path

import history
import numpy as np

from jaxtat.version import __version__

HEADER = (
    "| benchmark | run per image | compile | max error | relative L2 | iterations | peak memory | "
    "programs | maps |"
)


def main(path: Path, picture: Path) -> None:
    results = json.loads(path.read_text())
    runs = results["benchmarks"]
    path.with_suffix(".md").write_text(table(runs) + "\n")
    plot(runs, path.with_suffix(".png"))
    rows = history.rows_of(results, __version__)
    history.draw(history.append(rows, path.with_name("history.csv")), picture)
    print(table(runs))


def table(runs: list[dict]) -> str:
    lines = [HEADER, "|" + " --- |" * HEADER.count(" |")]
    for run in runs:
        info = run["extra_info"]
        error = "" if np.isnan(info["max_error"]) else f"{info['max_error']:.1e}"
        relative = f"{info['relative_error']:.1e}" if "relative_error" in info else ""
        peak = "" if np.isnan(info["peak_mb"]) else f"{info['peak_mb']:.0f} MB"
        name = run["name"].removeprefix("bench_")
        lines.append(
            f"| {name} | {_seconds(info['median_s'])} | {info['compile_s']:.1f} s | {error} | "
            f"{relative} | {info.get('iterations', '')} | {peak} | {info.get('programs', '')} | "
            f"{info.get('maps', '')} |"
        )
    return "\n".join(lines)


def growth(runs: list[dict]) -> dict[str, tuple[np.ndarray, np.ndarray, float]]:
    """Sizes, times and exponent p of time ~ n^p, for each benchmark of three sizes or more."""
    series: dict[str, list[tuple[int, float]]] = {}
    for run in runs:
        info = run["extra_info"]
        if info["images"] == 1:
            name = re.sub(rf"(?<=[\[-]){info['n']}(?=[\]-])", "n", run["name"])
            series.setdefault(name, []).append((info["n"], info["median_s"]))
    grown = {}
    for name, points in series.items():
        n, seconds = np.array(sorted(points)).T
        if len(n) >= 3:
            grown[name] = n, seconds, float(np.polyfit(np.log(n[-3:]), np.log(seconds[-3:]), 1)[0])
    return grown


def plot(runs: list[dict], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for name, (n, seconds, exponent) in growth(runs).items():
        label = f"{name.removeprefix('bench_')}: $n^{{{exponent:.1f}}}$"
        axes.loglog(n, seconds, "o-", label=label, ms=3)
    axes.set_xlabel("pixels per axis n")
    axes.set_ylabel("seconds per image (exponent of the last three sizes)")
    if axes.lines:  # a run of a few benchmarks has no growth
        axes.legend(fontsize=7)
    figure.savefig(path, dpi=130)


def _seconds(value: float) -> str:
    return f"{1e3 * value:.3g} ms" if value < 1 else f"{value:.3g} s"


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
