"""docs/pictures/half_circle.png: a disk from half a circle, and which edges the data determine.

    python scripts/figure_half_circle.py

Disks with 1 % of noise, the problem of `benchmarks/bench_limited_data.py`.
"""

from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxtat
from jaxtat.plotting import show_image

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "half_circle.png"


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    disks = jaxtat.phantoms.Disks(
        [[0.3, 0.25], [-0.4, 0.1], [-0.1, -0.45], [0.35, -0.4], [0.05, 0.1], [-0.35, 0.55]],
        [0.28, 0.2, 0.25, 0.12, 0.08, 0.1],
        [1.0, 0.7, 1.3, 0.9, 1.5, 1.0],
    )
    curve, region, grid = (
        jaxtat.circular_arc(1.3, 0.0, 500),
        jaxtat.disk(1.0),
        jaxtat.ImageGrid(129),
    )
    setup = jaxtat.Setup(curve, region, grid)
    g = disks.circular_integrals(curve, setup.radii)
    noise = jaxtat.phantoms.noise_like(jax.random.key(0), g, 0.01)
    sigma = float(noise.std())
    direct = jaxtat.reconstruct(setup, g + noise, jaxtat.NoiseLevel(sigma))
    fitted = jaxtat.model_based(setup, g + noise, noise=sigma, nonnegative=True).image
    seen = jaxtat.geometry.visibility_map(setup.curve, setup.grid, least=0.5)
    inside = np.asarray(region.contains(grid.points))

    figure, axes = plt.subplots(1, 4, figsize=(13, 3.2), layout="constrained")
    pictures = {"object": disks.image(grid), "direct": direct, "with constraints": fitted}
    for axis, (name, image) in zip(axes, pictures.items(), strict=False):
        drawn = show_image(axis, np.where(inside, image, np.nan), grid, limits=(0, 2), title=name)
        if axis is axes[2]:
            figure.colorbar(drawn, ax=axis)
    shown, title = np.where(inside, seen, np.nan), "share of edges that are seen"
    drawn = show_image(axes[3], shown, grid, limits=(0.5, 1), cmap="viridis", title=title)
    figure.colorbar(drawn, ax=axes[3])
    for axis in axes:
        axis.plot(*np.asarray(curve.points).T, color="tab:red", lw=2)
    figure.savefig(PICTURE, dpi=150)


if __name__ == "__main__":
    main()
