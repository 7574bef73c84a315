"""paper/figure.png: errors of jaxtat and of others in five arrays, and times in one of them.

Run from the root of a checkout; the numbers are those of benchmarks/peers/results.json
(`make peers`). They stand in the picture's file too, so that a test finds a picture that is old.
"""

import json
from pathlib import Path

import matplotlib.pyplot as plt

RESULTS = Path("benchmarks/peers/results.json")
OUT = Path("paper/figure.png")
ARRAYS = {  # problem: under which name
    "vessels-ring": "ring",
    "vessels-arc270": "270°",
    "vessels-ellipse": "ellipse,\n300°",
    "vessels-half": "180°",
    "vessels-arc125": "125°",
}
TIMED = "vessels-arc270"
MARKS = {  # peer: marker and colour
    "jaxtat, own choices": ("o", "navy"),
    "jaxtat, told the same, fitted": ("o", "tab:blue"),
    "jaxtat, told the same, direct": ("o", "lightskyblue"),
    "PATATO, back-projection": ("s", "lightcoral"),
    "PATATO, FFT": ("s", "tab:red"),
    "PATATO, FFT, fading mended": ("s", "maroon"),
    "PATATO, model-based": ("s", "black"),
    "k-Wave, time reversal": ("^", "tab:green"),
    "jwave, time reversal": ("v", "tab:olive"),
    "scikit-image, iradon": ("D", "tab:gray"),
    "Fast-Hankel solver": ("*", "tab:orange"),
}


def points(results: dict) -> dict[str, dict[str, list[float]]]:
    """Of every peer and array: relative L2 error, first and, if it was run, second time [s]."""
    found: dict[str, dict[str, list[float]]] = {peer: {} for peer in MARKS}
    for row in results["rows"]:
        if row.get("problem") in ARRAYS and "relative_l2" in row:
            times = [row["cold_s"], row["warm_s"]][: row["runs"]]
            found[row["peer"]][row["problem"]] = [row["relative_l2"], *times]
    return found


def main() -> None:
    found = points(json.loads(RESULTS.read_text()))
    plt.rcParams.update({"font.size": 7})
    figure, (errors, times) = plt.subplots(
        1, 2, figsize=(7.0, 2.7), dpi=200, layout="constrained", sharey=True
    )
    for peer, (marker, colour) in MARKS.items():
        of_peer, look = found[peer], {"marker": marker, "color": colour, "ms": 4}
        places = [list(ARRAYS).index(problem) for problem in of_peer]
        values = [error for error, *_ in of_peer.values()]
        errors.plot(places, values, ls="none", label=peer, **look)
        if TIMED in of_peer:
            error, *seconds = of_peer[TIMED]  # open: the first image; filled: the next
            times.plot(seconds, [error] * len(seconds), lw=0.7, mfc="w", **look)
            times.plot(seconds[1:], [error] * len(seconds[1:]), ls="none", **look)
    errors.set_xticks(range(len(ARRAYS)), ARRAYS.values())
    errors.set(xlabel="array of detectors", ylabel="relative L2 error", yscale="log")
    times.set(xlabel="processor time for an image, 270° [s]", xscale="log")
    ticks = (0.03, 0.1, 0.3, 1)
    errors.set_yticks(ticks, map(str, ticks), minor=False)
    for axes in (errors, times):
        axes.grid(alpha=0.3)
    figure.legend(*errors.get_legend_handles_labels(), loc="outside right upper", frameon=False)
    figure.savefig(OUT, metadata={"Software": None, "Description": json.dumps(found)})


if __name__ == "__main__":
    main()
