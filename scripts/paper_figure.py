"""paper/figure.png: time and largest error of jaxtat and of others, on one problem.

Run from the root of a checkout; the numbers are those of benchmarks/results.json (`make bench`).
The problem is geometry 1 of Kunyansky's paper: 500 detectors on three quarters of a circle.
"""

import json
from pathlib import Path

import matplotlib.pyplot as plt

RESULTS = Path("benchmarks/results.json")
OUT = Path("paper/figure.png")
# what is drawn: benchmark, words beside the point, colour, and where the words stand
OURS, OTHERS = "tab:blue", "tab:red"
DRAWN = (
    ("direct[129-cholesky]", "direct", OURS, (8, -3)),
    ("direct[129-cg]", "direct, conjugate gradients", OURS, (8, -3)),
    ("with_plan[1-fbp-double]", "with a plan", OURS, (8, -3)),
    ("jaxtat_from_the_record_of_k_wave", "direct, from k-Wave's record", OURS, (8, -3)),
    ("k_wave_time_reversal", "k-Wave: time reversal\nof its own record", OTHERS, (-30, -28)),
    ("circular_back_projection", "back-projection for a full circle", OTHERS, (8, 5)),
)


def main() -> None:
    runs = json.loads(RESULTS.read_text())["benchmarks"]
    measured = {run["name"].removeprefix("bench_"): run["extra_info"] for run in runs}
    plt.rcParams.update({"font.size": 8})
    figure, axes = plt.subplots(figsize=(5.5, 3.2), dpi=200, layout="constrained")
    for name, words, colour, offset in DRAWN:
        point = measured[name]["median_s"], measured[name]["max_error"]
        axes.loglog(*point, "o", color=colour)
        axes.annotate(words, point, offset, textcoords="offset points", color=colour)
    axes.set(xlabel="time on two cores [s]", ylabel="largest error", xlim=(0.02, 20))
    axes.set_ylim(1e-11, 10)
    axes.grid(alpha=0.3)
    figure.savefig(OUT, metadata={"Software": None})


if __name__ == "__main__":
    main()
