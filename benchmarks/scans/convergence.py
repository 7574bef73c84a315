"""How far fits are, where they end, from their images after ten times as many steps.

    python benchmarks/scans/convergence.py [--full] [--out FOLDER] [FILE ...]

Eight scans that are made here (arcs, a ring, an ellipse, a quarter of a circle, a cap in space,
circular integrals) with speed of sound, region and model known, and files with what is chosen for
them. Fits as `jaxtat reconstruct` makes them; differences are relative to the second image, in the
2-norm over all pixels. Small size, or with --full that of a scanner.
"""

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
from cases import SIZES, Case, truth, write
from intervals import case
from oracle import region_radius

from jaxtat import circular_arc, data_radii, disk, phantoms
from jaxtat.io import Scan, load_scan
from jaxtat.scans import Choices, choose, with_best_method
from jaxtat.scans.constrained import fitted
from jaxtat.scans.frames import lit_frames, setup_of

HEAD = "| scan | grid | steps | estimated to remain | difference | further steps | |"
HEAD += "\n|" + 7 * " --- |"
FURTHER = (
    Case(20, "quarter", "vessels", "in-plane", 1500.0, 1500.0, 0.03, ()),
    Case(21, "cap", "balls", "in-space", 1500.0, 1500.0, 0.03, ()),
)


def problems(size: str, folder: Path, files: list[str]) -> Iterator[tuple[str, Scan, Choices]]:
    for this in (*map(case, range(5)), *FURTHER):
        body, scan = truth(this, SIZES[size]), load_scan(write(this, SIZES[size], folder))
        known = {"sound_speed": this.speed, "region_radius": region_radius(body)}
        if this.model != "in-space":
            known |= {"model": this.model, "region_center": (0.0, 0.0)}
        yield f"{this.array}, {this.body}", scan, with_best_method(scan, choose(scan, **known))
    scan = integrals()
    yield "circular integrals", scan, with_best_method(scan, choose(scan, region_radius=1.0))
    for file in files:
        scan = load_scan(file)
        yield Path(file).name, scan, with_best_method(scan, choose(scan))


def integrals() -> Scan:
    """Of disks, by 256 detectors on an arc of 281 degrees, with 5 % of noise."""
    curve = circular_arc(1.3, 1.0, 256)
    radii = np.asarray(data_radii(curve, disk(1.0), 2 / 128))
    disks = phantoms.Disks([[0.2, 0.1], [-0.4, 0.3], [0.1, -0.5]], [0.3, 0.2, 0.15], [1, 0.5, 0.8])
    g = np.asarray(disks.circular_integrals(curve, radii))
    g = g + 0.05 * np.std(g) * np.random.default_rng(0).standard_normal(g.shape)
    return Scan("circular_integrals", g, {"detectors": np.asarray(curve.points), "radii": radii})


def row(name: str, scan: Scan, choices: Choices) -> str:
    setup, frame = setup_of(scan, choices), lit_frames(scan, choices, 0, 1)[0]
    found = fitted(scan, choices, setup, frame)
    steps = 10 * int(found.steps)
    far = fitted(scan, choices, setup, frame, tolerance=1e-9, max_steps=steps)
    image, last = np.asarray(found.image), np.asarray(far.image)
    off = np.linalg.norm(image - last) / np.linalg.norm(last)
    shape = " x ".join(map(str, image.shape))
    said = "ended" if bool(found.converged) else found.unsettled()
    return (
        f"| {name} | {shape} | {int(found.steps)} | {float(found.remaining):.3f} | {off:.3f} | "
        f"{int(far.steps)} | {said} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", metavar="FILE", help="scans besides")
    parser.add_argument("--full", action="store_true", help="all detectors and samples")
    parser.add_argument("--out", type=Path, default=Path("out/convergence"), metavar="FOLDER")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    print(HEAD)
    size = "full" if options.full else "quick"
    for problem in problems(size, options.out, options.files):
        print(row(*problem), flush=True)


if __name__ == "__main__":
    main()
