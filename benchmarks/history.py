"""What `make bench` measured, run after run: a file of rows, and a picture of the main ones.

Whoever renames a benchmark renames it in the file too, so that its curve goes on.
"""

import csv
import json
from pathlib import Path

FIELDS = ("date", "version", "machine", "benchmark", "median_s", "max_error", "peak_mb")
PANELS = {
    "median_s": "seconds per image",
    "max_error": "largest error",
    "peak_mb": "peak memory [MB]",
}
DRAWN = {
    "direct[129]": "direct, 129 x 129",
    "direct[513]": "direct, 513 x 513",
    "plan[cylindrical]": "a plan, 129 x 129",
    "with_plan[1-fourier-double]": "with a plan, 129 x 129",
}
Row = dict[str, str]


def rows_of(results: dict, version: str) -> list[Row]:
    """A row for each benchmark of a run; empty cells where nothing was measured."""
    cpu = results["machine_info"]["cpu"]
    run = {
        "date": results["datetime"][:16],
        "version": version,
        "machine": f"{cpu['brand_raw']}, {cpu['count']} cores",
    }
    rows = []
    for benchmark in results["benchmarks"]:
        name = benchmark["name"].removeprefix("bench_")
        numbers = {field: benchmark["extra_info"][field] for field in PANELS}
        cells = {field: f"{x:.4g}" if x == x else "" for field, x in numbers.items()}  # NaN != NaN
        rows.append(run | {"benchmark": name} | cells)
    return rows


def append(rows: list[Row], path: Path) -> list[Row]:
    """Add a run to the file, which has it once however often it is added; all rows there."""
    earlier = [row for row in read(path) if row["date"] != rows[0]["date"]]
    every = sorted([*earlier, *rows], key=lambda row: row["date"])
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(every)
    return every


def read(path: Path) -> list[Row]:
    """All rows of the file; none if there is no file yet."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def curves(rows: list[Row]) -> dict[str, dict[str, list[tuple[str, float]]]]:
    """For each panel and each benchmark that is drawn: labels of the runs, and numbers."""
    return {
        field: {
            name: [(label(row), float(row[field])) for row in rows if _shows(row, name, field)]
            for name in DRAWN
        }
        for field in PANELS
    }


def label(row: Row) -> str:
    """What stands under a run: numbers of different machines cannot be compared."""
    return f"{row['date'].replace('T', ' ')}\n{row['version']}\n{row['machine']}"


def _shows(row: Row, name: str, field: str) -> bool:
    return row["benchmark"] == name and row[field] != ""


def draw(rows: list[Row], path: Path) -> None:
    """The picture, which has its numbers in its description."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 8), layout="constrained")
    panels = figure.subplots(len(PANELS), sharex=True)
    for axes, (field, by_name) in zip(panels, curves(rows).items(), strict=True):
        axes.set_ylabel(PANELS[field])
        axes.set_yscale("log")
        for name, points in by_name.items():
            labels, numbers = zip(*points, strict=True) if points else ((), ())
            axes.plot(labels, numbers, "o-", label=DRAWN[name], ms=4)
    panels[0].legend(fontsize=8)
    panels[-1].tick_params(axis="x", labelsize=7)
    figure.savefig(path, dpi=110, metadata={"Description": json.dumps(curves(rows))})
