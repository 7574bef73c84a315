"""The picture of docs/how-to/two-speeds.md: one body, 270 degrees, 1 % noise, and what is wrong.

    python benchmarks/two_speeds/picture.py [folder]

draws docs/two_speeds.png; the record of the full circle is kept in the folder, if there is one.
"""

import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import run

from jaxtat import DiskBody, Setup, detector_curve, solve
from jaxtat.records import pressure_to_circular_integrals

PICTURE = Path(__file__).parents[2] / "docs" / "two_speeds.png"
SPEED, OPENING, NOISE, ALPHA = 1.04, 270, 0.01, 1e-3


def images(folder):
    pressure, times = run.recorded(folder, "disk", SPEED)
    noise = np.random.default_rng(0).standard_normal(pressure.shape)
    pressure = (pressure + NOISE * np.abs(pressure).max() * noise)[:OPENING]
    curve, body = detector_curve(run.circle()[:OPENING]), DiskBody(run.CENTER, 0.45, SPEED, 1.0)
    g = np.asarray(pressure_to_circular_integrals(pressure, times, run.RADII))
    two = Setup(curve, run.REGION, run.GRID, run.RADII, medium=body)

    def single(share):
        c = 1 + share * (SPEED - 1)
        setup = Setup(curve, run.AROUND, run.GRID, run.RADII * c)
        return solve(setup, g * c, ALPHA).image

    return {
        "truth": run.phantom(np.asarray(run.GRID.points)),
        "best single speed": min(map(single, run.SHARES), key=run.error),
        "straight-ray delays": run.straight_delays(g, curve, body),
        "two speeds": solve(two, g, ALPHA).image,
    }


def main(folder):
    figure, axes = plt.subplots(2, 4, figsize=(10, 5.4), layout="constrained")
    found = images(folder)
    for (above, below), (name, image) in zip(axes.T, found.items(), strict=True):
        wrong = np.where(run.MEASURED, image - found["truth"], np.nan).T
        shown = np.where(run.MEASURED, image, np.nan).T
        above.imshow(shown, origin="lower", cmap="gray", vmin=-0.2, vmax=1.3)
        above.set_title(name, fontsize=10)
        for axis in (above, below):
            axis.axis("off")
        if name != "truth":
            below.imshow(wrong, origin="lower", cmap="RdBu_r", vmin=-0.3, vmax=0.3)
            below.set_title(f"minus truth: {run.error(image):.3f}", fontsize=10)
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as made:
            main(made)
