"""Reconstructs all scans with no option, and shows what came of it beside the truth.

    python benchmarks/scans/run.py [--half rules|held-out] [--first NUMBER] [--only NAME] [--quick]
        [--last NUMBER] [--no-oracle] [--speeds unsaid|one|two|two-water-given] [--ablation]
        [--out FOLDER]

The image without options is the fitted one for most records; "direct" is the formula's error.
Writes scans.csv, scans.md and contact sheets (truth, with no option, oracle) into the folder.
Rules in `jaxtat.scans` are made by looking at the half "rules" alone; the other half is what
documentation quotes, and decides nothing. Scans through a body and water of different speeds are
among them if `two_speeds.py` has written their records into the folder.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
COLUMNS = (
    "name",
    "half",
    "dirt",
    "error",
    "direct",
    "oracle",
    "speed_error",
    "speed_grade",
    "speed_standard_error",
    "region_ratio",
    "start",
    "start_error",
    "start_grade",
    "model_right",
    "alpha",
    "max_frequency",
    "oracle_method",
    "oracle_alpha",
    "oracle_weight",
    "oracle_frequency",
    "pixels",
    "seconds",
    "speed_why",
    "failed",
)
LONGEST = 1500  # s that a scan may take with its oracle
# small scans are compiled longer than they are computed
UNOPTIMISED = {"XLA_FLAGS": "--xla_backend_optimization_level=0"}
ON_A_SHEET = 12  # scans
NEAR = 2e-7  # s


def main() -> None:
    from cases import HALVES, SPEEDS, cases, simulated_by_k_wave

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--half", choices=HALVES)
    parser.add_argument(
        "--first", type=int, default=0, metavar="NUMBER", help="of a scan that is made"
    )
    parser.add_argument("--last", type=int, metavar="NUMBER", help="of a scan that is made")
    parser.add_argument("--only", metavar="NAME", help="scans whose name holds this")
    parser.add_argument("--quick", action="store_true", help="0.3 of all detectors and samples")
    parser.add_argument("--no-oracle", action="store_true", help="but what jaxtat chooses alone")
    parser.add_argument("--speeds", choices=SPEEDS, default="unsaid", help="of sound, estimated")
    parser.add_argument("--ablation", action="store_true", help="also without each of the rules")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="scans at a time")
    parser.add_argument("--out", type=Path, default=Path("out/scans"), metavar="FOLDER")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    wanted = [
        case
        for case in cases()
        if options.half in (None, case.half)
        and case.number >= options.first
        and (options.last is None or case.number <= options.last)
        and (options.only or "") in case.name
        and ("k-wave" not in case.dirt or simulated_by_k_wave(case, options.out).exists())
    ]
    rows: list[dict] = []
    size = "quick" if options.quick else "full"
    script = "ablation.py" if options.ablation else "examine.py"
    # without the rule of starts a body would be looked for as well
    speeds = "one" if options.ablation else options.speeds
    how = (script, size, not options.no_oracle, speeds, options.out)
    with ThreadPoolExecutor(options.jobs) as pool:
        made = pool.map(lambda case: examined(case, *how), wanted)
        for row in made:
            rows.append(row)
            print(line(row), flush=True)
            write_tables(rows, options.out)
    if options.ablation:
        write_ablation(rows, options.out)
    names = [row["name"] for row in rows]
    for sheet, start in enumerate(range(0, len(names), ON_A_SHEET), 1):
        draw(names[start : start + ON_A_SHEET], options.out, options.out / f"sheet-{sheet}.png")
    draw(worst(rows), options.out, options.out / "worst.png", columns=3)


def examined(case, *how) -> dict:
    row = in_a_process(case.name, *how)
    return row | {"half": case.half, "dirt": described(case)}


def in_a_process(
    name: str, script: str, size: str, oracle: bool, speeds: str, folder: Path
) -> dict:
    """Of a child, whose end, whatever it was, is a row."""
    against = "oracle" if oracle else "alone"
    command = [sys.executable, str(HERE / script), name, size, against, speeds, str(folder)]
    start = time.perf_counter()
    try:
        environment = os.environ | (UNOPTIMISED if size == "quick" else {})
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=LONGEST, env=environment
        )
        row = json.loads(done.stdout.splitlines()[-1])
    except (subprocess.TimeoutExpired, IndexError, json.JSONDecodeError) as problem:
        said = getattr(problem, "stderr", None) or done.stderr  # type: ignore[possibly-undefined]
        return {"name": name, "failed": f"no answer: {str(said)[-300:]}"}
    row["seconds_in_all"] = time.perf_counter() - start
    return row


def described(case) -> str:
    speeds = f"{case.speed:.0f}" + (f" in {case.water:.0f}" if case.water != case.speed else "")
    noise = f"noise {100 * case.noise:.0f} %"
    return ", ".join([case.model, f"{speeds} m/s", noise, *case.dirt])


def moved(row: dict) -> bool:
    """Whether another start than the file's was chosen."""
    return number(row, "start_error") + number(row, "start") != 0


def number(row: dict, name: str) -> float:
    value = row.get(name)
    return float("nan") if value is None else float(value)


def least(row: dict) -> float:
    """The least error with all known: the oracle, which tries few combinations, misses some."""
    return float(np.minimum(number(row, "oracle"), number(row, "error")))


def over_least(row: dict) -> float:
    return number(row, "error") / least(row)


def line(row: dict) -> str:
    """Of the table in Markdown."""
    speed = number(row, "speed_error")
    cells = (
        row["name"],
        row["dirt"],
        f"{number(row, 'error'):.3f}",
        f"{number(row, 'oracle'):.3f}" + f" {row.get('oracle_method', '')}".rstrip(),
        f"{over_least(row):.2f}",
        "" if np.isnan(speed) else f"{100 * speed:+.2f} %",
        row.get("speed_grade", ""),
        f"{number(row, 'region_ratio'):.2f}",
        "right" if row.get("model_right") else "wrong",
        f"{1e6 * number(row, 'start_error'):+.2f}",
        f"{number(row, 'seconds'):.0f}",
        row["failed"][:120],
    )
    return "| " + " | ".join(cells) + " |"


HEAD = (
    "| scan | what it is | error | oracle's | ratio | speed | graded | region | model "
    "| start off [us] | s | failed |\n|" + " --- |" * 12
)


def errors_in_words(done: list[dict]) -> list[str]:
    """Errors themselves, median and quartiles, of the default image and of those beside it."""
    lines = []
    for name, error in (
        ("without options", lambda row: number(row, "error")),
        ("formula", lambda row: number(row, "direct")),
        ("all known", least),
    ):
        errors = np.array([error(row) for row in done])
        errors = errors[np.isfinite(errors)]
        if len(errors):
            quarter, median, three = np.quantile(errors, (0.25, 0.5, 0.75))
            lines.append(
                f"- Error, {name}: median {median:.3f}, a quarter below {quarter:.3f}, three "
                f"quarters below {three:.3f} ({len(errors)} scans)."
            )
    return lines


def summary(rows: list[dict]) -> str:
    """The figures that are wanted, and those that are had."""
    done = [row for row in rows if not row["failed"]]
    ratio = np.array([over_least(row) for row in done])
    ratio = ratio[np.isfinite(ratio)]
    region = np.array([number(row, "region_ratio") for row in done])
    late = [row for row in done if number(row, "start") != 0]
    others = [row for row in done if number(row, "start") == 0]
    off = [abs(number(row, "start_error")) for row in late]
    known = [row for row in done if not np.isnan(number(row, "speed_error"))]
    right = [abs(row["speed_error"]) < 5e-3 for row in known]
    wrong = [r for r in known if abs(r["speed_error"]) > 5e-3 and r["speed_grade"] != "guessed"]
    lines = [
        f"- {len(rows)} scans, {len(rows) - len(done)} ended in an error.",
        *errors_in_words(done),
        f"- Speed within 0.5 %: {sum(right)} of {len(known)} that have one; wrong by more with a "
        f"confident reason: {len(wrong)}.",
        f"- Region holds the body and is at most 1.5 times its size: "
        f"{int(np.sum((region >= 0.99) & (region <= 1.5)))} of {len(done)}.",
        f"- Model right: {sum(row['model_right'] for row in done)} of {len(done)}.",
        f"- Start within {1e6 * NEAR:.1f} us: {sum(o < NEAR for o in off)} of {len(late)} scans "
        f"that start at another time; changed in {sum(map(moved, others))} others.",
    ]
    if len(ratio):
        lines.append(
            f"- Error over the least with all known: median {np.median(ratio):.2f}, 95 % below "
            f"{np.quantile(ratio, 0.95):.2f}; at most 2 in {int(np.sum(ratio <= 2))} of "
            f"{len(ratio)}."
        )
    if done:
        slowest = max(number(row, "seconds") for row in done)
        lines.append(f"- Slowest: {slowest:.0f} s of a processor, in a new process.")
    return "\n".join(lines)


def write_tables(rows: list[dict], folder: Path) -> None:
    text = [summary(rows), "", HEAD, *map(line, rows)]
    (folder / "scans.md").write_text("\n".join(text) + "\n")
    with (folder / "scans.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def write_ablation(rows: list[dict], folder: Path) -> None:
    """What each rule is worth, and the rows by which it is known."""
    from ablation import table

    (folder / "ablation.json").write_text(json.dumps(rows, indent=1))
    (folder / "ablation.md").write_text(table(rows) + "\n")


def worst(rows: list[dict], n: int = 5) -> list[str]:
    """Names of the scans whose error is the most over the least with all known."""
    known = [row for row in rows if np.isfinite(over_least(row))]
    known.sort(key=over_least, reverse=True)
    return [row["name"] for row in known[:n]]


def draw(names: list[str], folder: Path, path: Path, columns: int = 6) -> None:
    """Truth, with no option, and oracle where it was asked, for each of the scans."""
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxtat import ImageGrid
    from jaxtat.plotting import contact_sheet

    panels = []
    for name in names:
        if not (folder / f"{name}.images.npz").exists():
            continue
        with np.load(folder / f"{name}.images.npz") as pictures:
            low, high = pictures["corners"]
            half_width, center = float(high[0] - low[0]) / 2, (low + high) / 2
            for kind, title in (("truth", name), ("chosen", "no option"), ("oracle", "oracle")):
                if kind == "oracle" and kind not in pictures:
                    continue
                image = pictures[kind] if kind in pictures else 0 * pictures["truth"]
                image = image if image.ndim == 2 else image[..., image.shape[2] // 2]
                grid = ImageGrid(len(image), half_width=half_width, center=center)
                panels.append((image, grid, title))
    if panels:
        contact_sheet(panels, columns=columns, unit="m").savefig(path, dpi=70)


if __name__ == "__main__":
    main()
