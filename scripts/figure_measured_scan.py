"""docs/measured_scan.png: a measured scan by back-projection, the formula, and a fit.

Run from the root of a checkout, with JAXTAT_DATA naming the folder of the measured scan; without
it the public scan is downloaded. No option is given: everything is chosen from the file.
"""

from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxtat
from jaxtat.io import load_scan
from jaxtat.plotting import add_scale_bar, show_image
from jaxtat.steps import universal_back_projection

OUT = Path("docs/measured_scan.png")
SHOWN = (0.5, 99.7)  # percentiles that are black and white


def back_projection(setup: jaxtat.Setup, g: jax.Array) -> jax.Array:
    """Of detectors that look to the middle of their circle."""
    middle = jaxtat.geometry.fit_circle(setup.curve.points).center
    return universal_back_projection(g, setup.radii, setup.curve, setup.grid, middle)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    scan = load_scan(jaxtat.io.datasets.fetch("msot_scan9"))
    choices = jaxtat.scans.choose(scan)
    best = jaxtat.scans.with_best_method(scan, choices)
    print(best.table())
    setup = jaxtat.scans.setup_of(scan, choices)
    g = jaxtat.scans.integrals(scan, choices, setup, scan.frame(0))
    projected = back_projection(setup, g)
    images = {
        "back-projection": projected,
        "jaxtat --direct": jaxtat.scans.reconstruct(scan, choices).image,
        "jaxtat": jaxtat.scans.reconstruct(scan, best).image,
    }
    inside = np.asarray(setup.region.contains(setup.grid.points))
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.2), layout="constrained")
    for axis, (title, values) in zip(axes, images.items(), strict=True):
        shown = np.where(inside, np.asarray(values), np.nan)
        low, high = np.nanpercentile(shown, SHOWN)  # back-projection has another unit
        show_image(axis, shown, setup.grid, limits=(low, high), title=title, unit="m")
        add_scale_bar(axis)
        axis.set_axis_off()
    figure.savefig(OUT, dpi=100)
    print(f"{OUT}: {OUT.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
