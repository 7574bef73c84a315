"""Whether the errors that are said of fitted images are those they have: 20 simulated scans.

    python benchmarks/scans/intervals.py [--from N] [--to N] [--out FOLDER]

Speed of sound, region and model are known, all else is chosen. An interval is the image's mean over
a pixel of a coarse grid, plus and minus 1.645 times what `fit_errors` of jaxtat.scans says. The
pixels are counted whose true mean is in it, of the region and of the body (where the truth is above
a hundredth of its largest value).
"""

import argparse
import warnings
from pathlib import Path

import jax
import numpy as np
from cases import SIZES, Case, truth, write
from oracle import region_radius

ARRAYS = "arc270", "arc180", "ring", "ellipse", "arc125"
BODIES = "vessels", "mouse", "derenzo", "bells", "off-middle"
SEED, N = 77, 20


def case(k: int) -> Case:
    """Every array with every body but one, of three sizes of noise; every third one coloured."""
    rng = np.random.default_rng([SEED, k])
    speed, noise = float(rng.uniform(1450, 1600)), float(rng.choice([0.01, 0.03, 0.1]))
    dirt = () if k % 3 else ("coloured",)
    body = BODIES[(k // 5 + k) % 5]
    return Case(k, ARRAYS[k % 5], body, "in-plane", speed, speed, noise, dirt)


def examined(k: int, folder: Path) -> tuple[float, float, float]:
    """Shares of pixels held, of region and body; error over what is said, root mean squares."""
    from jaxtat.fitting import NINETY
    from jaxtat.io import load_scan
    from jaxtat.scans import choose, reconstruct, with_best_method
    from jaxtat.scans.errors_of_images import fit_errors

    this, size = case(k), SIZES["quick"]
    body = truth(this, size)
    scan = load_scan(write(this, size, folder))
    known = {"sound_speed": this.speed, "model": "in-plane", "region_center": (0.0, 0.0)}
    choices = with_best_method(scan, choose(scan, **known, region_radius=region_radius(body)))
    image = jax.device_put(reconstruct(scan, choices).image)
    found = fit_errors(scan, choices, np.asarray(scan.frame(0), float), image)
    true = np.asarray(found.grid.means(body.image(np.asarray(found.grid.finer(4).points))))
    said = np.asarray(found.deviation)
    inside = np.isfinite(said)
    error, said, true = np.abs(np.asarray(found.image) - true)[inside], said[inside], true[inside]
    largest = true.max()
    held = error <= NINETY * said + 1e-6 * largest
    ratio = float(np.sqrt(np.mean(error**2) / np.mean(said**2)))
    return float(held.mean()), float(held[true > 0.01 * largest].mean()), ratio


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="first", type=int, default=0, metavar="N")
    parser.add_argument("--to", dest="end", type=int, default=N, metavar="N")
    parser.add_argument("--out", type=Path, default=Path("out/intervals"), metavar="FOLDER")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    rows = []
    for k in range(options.first, options.end):
        rows.append(examined(k, options.out))
        held, of_body, ratio = rows[-1]
        this = case(k)
        print(
            f"{k:2d} {this.array:8} {this.body:10} noise {this.noise:.2f}: held {held:.2f}, of the "
            f"body {of_body:.2f}; error over what is said {ratio:.2f}",
            flush=True,
        )
    for name, column in zip(("region", "body"), np.transpose(rows), strict=False):
        low, middle = np.quantile(column, (0.1, 0.5))
        print(
            f"{name}: held {np.mean(column):.2f} in the mean over scans, median {middle:.2f}, a "
            f"tenth below {low:.2f}"
        )


if __name__ == "__main__":
    main()
