"""docs/pictures/k_wave.png: k-Wave's record of disks, by back-projection and by jaxtat.

    python scripts/figure_k_wave.py

The record is made by docs/snippets/k_wave.py, as the page on k-Wave shows it, in an environment
with k-wave-python (half a minute); `record.npz`, where there is one in this folder, is taken
instead. No option is given.
"""

import runpy
import warnings
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import RegularGridInterpolator

import jaxtat
from jaxtat.plotting import add_scale_bar, show_image
from jaxtat.steps import universal_back_projection

DOCS = Path(__file__).parents[1] / "docs"
RECORD = Path("record.npz")
NODES = 0.15e-3 * (np.arange(320) - 160)  # of k-Wave's grid [m]


def initial_pressure(points: np.ndarray) -> np.ndarray:
    """The disks of the simulation, (..., 2) [m]."""
    f = np.zeros(points.shape[:-1])
    for x, y, radius, value in [
        (3, 2, 4, 1.0),
        (-4, 1, 2.5, 0.6),
        (-1, -5, 1.5, 1.5),
        (1, 1, 1, 1),
    ]:
        f += value * (
            np.hypot(*np.moveaxis(points - 1e-3 * np.array([x, y]), -1, 0)) < 1e-3 * radius
        )
    return f


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    if not RECORD.exists():
        runpy.run_path(str(DOCS / "snippets" / "k_wave.py"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxtat.AccuracyWarning)  # a scanner's record is in-plane
        made = jaxtat.reconstruct_file(RECORD)
    print(made.choices.table())
    scan = jaxtat.io.load_scan(RECORD)
    setup = jaxtat.scans.setup_of(scan, made.choices)
    grid, region = setup.grid, setup.region
    points = np.asarray(grid.points)
    mesh = np.stack(np.meshgrid(NODES, NODES, indexing="ij"), axis=-1)
    truth = RegularGridInterpolator((NODES, NODES), initial_pressure(mesh))(points)
    g = jaxtat.scans.integrals(scan, made.choices, setup, scan.frame(0))
    projected = np.asarray(
        universal_back_projection(g, setup.radii, setup.curve, grid, jax.numpy.zeros(2))
    )
    inside = np.asarray(region.contains(grid.points))
    # its formula is for waves in space: in the unit in which it is nearest to the truth
    projected = projected * (projected * truth)[inside].sum() / (projected**2)[inside].sum()
    for image in (projected, made.image):
        error = np.linalg.norm((np.asarray(image) - truth)[inside]) / np.linalg.norm(truth[inside])
        print(f"relative L2 error {error:.3f}")

    figure, axes = plt.subplots(1, 3, figsize=(10.5, 3.5), layout="constrained")
    titles = ("initial pressure", "back-projection", "jaxtat")
    for axis, title, image in zip(axes, titles, (truth, projected, made.image), strict=True):
        shown = np.where(inside, np.asarray(image), np.nan)
        show_image(axis, shown, grid, limits=(-0.2, 2.0), title=title, unit="m")
        add_scale_bar(axis)
        axis.set_axis_off()
    figure.colorbar(
        axes[0].images[0], ax=axes, label="initial pressure, as in the simulation", shrink=0.9
    )
    figure.savefig(DOCS / "pictures" / "k_wave.png", dpi=100)


if __name__ == "__main__":
    main()
