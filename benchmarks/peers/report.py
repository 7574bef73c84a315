"""The tables of docs/comparison.md and its picture, from results.json and the images.

    python benchmarks/peers/report.py [--out out/peers]

The picture is drawn where the images are; the page's tables stand between two marks.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "comparison.md"
PICTURE = HERE.parents[1] / "docs" / "pictures" / "peers.png"
MARKS = "<!-- tables of benchmarks/peers/report.py -->", "<!-- end of these tables -->"
SHOWN, SHOWN_TOO = "vessels-arc270", "two-speeds-disk"
COLUMNS = 6  # of the picture
PROBLEMS = {
    "vessels-ring": "ring",
    "vessels-arc270": "270°",
    "vessels-ellipse": "ellipse, 300°",
    "vessels-half": "180°",
    "vessels-arc125": "125°",
    "full_circle_64_detectors": "64 on a ring*",
    "half_disk_three_quarter_arc": "270°, half disk*",
}
UNKNOWN = {
    "late": "start 1 µs late",
    "two-speeds-disk": "two speeds, disk",
    "two-speeds-ellipse": "two speeds, ellipse",
    "hemisphere": "hemisphere, 256",
}
OWN = "jaxtat, own choices"
MEASURED = "relative_l2"  # rows of images whose truth is known have it
BETTER = {  # measure: its name, and 1 where larger is better
    "relative_l2": ("relative L2", -1),
    "ssim": ("SSIM", 1),
    "haar_psi": ("HaarPSI", 1),
    "jensen_shannon": ("Jensen-Shannon", -1),
    "median_absolute_error": ("median absolute", -1),
}


def main() -> None:
    parser = argparse.ArgumentParser(description="Tables and picture of the comparison.")
    parser.add_argument("--out", type=Path, default=Path("out/peers"), help="where images are")
    folder = parser.parse_args().out
    results = json.loads((HERE / "results.json").read_text())
    text = PAGE.read_text()
    before, rest = text.split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    PAGE.write_text(f"{before}{MARKS[0]}\n{tables(results)}\n{MARKS[1]}{after}")
    if any(folder.glob("image-*.npz")):
        draw(folder)
    else:
        print(f"no images in {folder}: the picture is left as it is", file=sys.stderr)


def of_problem(rows: list[dict], problem: str) -> list[dict]:
    """Those that made an image of it."""
    return [row for row in rows if row.get("problem") == problem and "cold_s" in row]


def best(rows: list[dict], measure: str) -> str:
    """The peer of the best value, of rows of one problem."""
    sign = BETTER[measure][1]
    return max((row for row in rows if measure in row), key=lambda row: sign * row[measure])["peer"]


def tables(results: dict) -> str:
    """Where others are better; errors by problem; all measures of one; firsts; absent."""
    rows = results["rows"]
    peers = list(dict.fromkeys(row["peer"] for row in rows if "cold_s" in row))
    arrays = "Relative L2 errors, for the vessels in five arrays and two records of others (*):"
    unknown = "Relative L2 errors where not all is known, 270° of the vessels, and in space:"
    parts = [_better(rows), f"{arrays}\n\n{_errors(rows, peers, PROBLEMS)}"]
    parts += [f"{unknown}\n\n{_errors(rows, peers, UNKNOWN)}", _on_one(rows), _firsts(rows, peers)]
    return "\n\n".join([*parts, _absent(rows)])


def _table(head: list[str], lines: list[list[str]]) -> str:
    every = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in every)


def _errors(rows: list[dict], peers: list[str], problems: dict[str, str]) -> str:
    """A line for each peer that has any of the problems."""
    there = {row["peer"] for row in rows if row.get("problem") in problems and MEASURED in row}
    lines = [[peer] for peer in peers if peer in there]
    for problem in problems:
        found = {row["peer"]: row for row in of_problem(rows, problem)}
        first = best(list(found.values()), "relative_l2") if found else ""
        for line in lines:
            value = _digits(found[line[0]]["relative_l2"]) if line[0] in found else ""
            line.append(f"**{value}**" if line[0] == first else value)
    return _table(["", *problems.values()], lines)


def _digits(value: float) -> str:
    return f"{value:.3f}" if value > 0.01 else f"{value:.5f}"


def _better(rows: list[dict]) -> str:
    """Who is better than each of jaxtat's methods, and in which problems."""
    ours = [peer for peer in dict.fromkeys(row["peer"] for row in rows) if "jaxtat" in peer]
    compared = [(OWN, name) for name in ("ssim", "haar_psi") if OWN in ours]
    lines = []
    for own, measure in [*((peer, MEASURED) for peer in ours), *compared]:
        name, sign = BETTER[measure]
        values = {r["problem"]: r[measure] for r in rows if r["peer"] == own and measure in r}
        found: dict[str, list[str]] = {}
        for row in rows:
            of_ours = values.get(row.get("problem"))
            if "jaxtat" in row["peer"] or of_ours is None or measure not in row:
                continue
            if sign * row[measure] > sign * of_ours:
                found.setdefault(row["peer"], []).append(row["problem"])
        said = [f"{peer} in {len(where)} ({', '.join(where)})" for peer, where in found.items()]
        lines.append(f"- {own}, {name}, {len(values)} problems: {'; '.join(said) or 'nobody'}.")
    return "**Others are better than:**\n\n" + "\n".join(lines)


def _on_one(rows: list[dict]) -> str:
    found = of_problem(rows, SHOWN)
    firsts = {measure: best(found, measure) for measure in BETTER}
    lines = []
    for row in found:
        values = [
            f"**{row[name]:.3f}**" if row["peer"] == firsts[name] else f"{row[name]:.3f}"
            for name in BETTER
        ]
        warm = f"{row['warm_s']:.2g}" if row["runs"] > 1 else ""
        cost = [f"{row['cold_s']:.2g}", warm, f"{row['memory_mib']:.0f}"]
        lines.append([row["peer"], row["version"], *values, *cost])
    head = ["", "version", *(name for name, _ in BETTER.values())]
    head += ["first run [CPU s]", "again [CPU s]", "memory [MiB]"]
    return "All measures, and cost, for the vessels in the arc of 270°:\n\n" + _table(head, lines)


def _firsts(rows: list[dict], peers: list[str]) -> str:
    problems = [row["problem"] for row in rows if row["peer"] == OWN and MEASURED in row]
    judged = [row for row in rows if row.get("problem") in problems and MEASURED in row]
    counts = {peer: dict.fromkeys(BETTER, 0) for peer in peers}
    for problem in problems:
        for measure in BETTER:
            counts[best(of_problem(judged, problem), measure)][measure] += 1
    tried = {peer: sum(row["peer"] == peer for row in judged) for peer in peers}
    lines = [
        [peer, str(tried[peer]), *(str(counts[peer][name]) for name in BETTER)] for peer in peers
    ]
    head = ["", "problems", *(name for name, _ in BETTER.values())]
    return (
        f"Of {len(problems)} problems, those of the first row, it is the best of all in:\n\n"
        + _table(head, lines)
    )


def _absent(rows: list[dict]) -> str:
    lines = [f"- {row['peer']}: {row['reason']}" for row in rows if "problem" not in row]
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if "reason" in row and "problem" in row:
            reasons.setdefault((row["peer"], row["reason"]), []).append(row["problem"])
    for (peer, reason), where in reasons.items():
        named = f" ({', '.join(where)})" if len(where) < 5 else ""
        lines.append(f"- {peer}, {len(where)} problems{named}: {reason}")
    made = sorted({row["made"] for row in rows})
    return f"Made on {'; '.join(made)}. Not run, or without an image:\n\n" + "\n".join(lines)


def draw(folder: Path) -> None:
    """Truth and images of one problem, and of the same through a body of another speed."""
    import matplotlib.pyplot as plt
    from environments import PEERS

    made = {path.stem.split("-")[-1] for path in folder.glob("image-*.npz")}
    scripts = [peer for peer in PEERS if peer.script in made]
    rows = []  # of pictures, one problem after the other
    for name in (SHOWN, SHOWN_TOO):
        with np.load(folder / f"problem-{name}.npz") as problem:
            known = {key: problem[key] for key in problem.files if key != "record"}
        cells = [("truth", known["truth"])]
        cells += [(peer.title, _image(folder, name, peer.script, known)) for peer in scripts]
        cells = [(*cell, known) for cell in cells if cell[1] is not None]
        rows += [cells[i : i + COLUMNS] for i in range(0, len(cells), COLUMNS)]
    plt.rcParams.update({"font.size": 7})
    size = (1.5 * COLUMNS, 1.85 * len(rows))
    figure, axes = plt.subplots(len(rows), COLUMNS, figsize=size, dpi=110, layout="constrained")
    for axis in axes.flat:
        axis.axis("off")
    for row, cells in zip(axes, rows, strict=True):
        for axis, cell in zip(row, cells, strict=False):
            _show(axis, *cell)
    axes[0, 0].set(xlabel="x [mm]", ylabel="y [mm]")
    figure.savefig(PICTURE, metadata={"Software": None})


def _show(axis, title: str, image: np.ndarray, known: dict) -> None:
    half = 1e3 * float(known["half_width"])
    axis.axis("on")
    axis.imshow(image.T, "gray", origin="lower", extent=(-half, half, -half, half), clim=(0, 1))
    axis.set_title(title.replace(", ", ",\n", 1))


def _image(folder: Path, problem: str, script: str, known: dict) -> np.ndarray | None:
    """Calibrated; nothing if the peer made no image."""
    from measures import calibrated

    path = folder / f"image-{problem}-{script}.npz"
    if not path.is_file():
        return None
    with np.load(path) as found:
        if "image" not in found:
            return None
        image = found["image"].astype(float)
    return calibrated(image, known["truth"].astype(float), known["inside"])


if __name__ == "__main__":
    main()
