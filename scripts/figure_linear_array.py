"""docs/pictures/linear_array.png: what a straight line of detectors sees of disks and layers.

    python scripts/figure_linear_array.py

96 detectors 0.3 mm apart over a rectangle of 22 x 12 mm, 1 % of noise.
"""

from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxtat
from jaxtat.geometry import rectangle
from jaxtat.plotting import show_image

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "linear_array.png"
CENTER = (0.0, -8.0)  # [mm]


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    disks = jaxtat.phantoms.Disks(
        [[-6, -6], [0, -8], [6, -10], [-4, -11], [3, -4.5], [8, -5]],
        [2.0, 1.5, 2.0, 0.7, 0.6, 1.0],
        [1.0, 1.5, 1.0, 1.5, 1.3, 0.8],
    )
    along = 0.3 * (np.arange(96) - 47.5)
    curve = jaxtat.detector_curve(np.stack([along, 0 * along], axis=1))
    region, grid = (
        rectangle((11.0, 6.0), center=CENTER),
        jaxtat.ImageGrid((111, 61), (11, 6), CENTER),
    )
    setup = jaxtat.Setup(curve, region, grid)
    g = disks.circular_integrals(curve, setup.radii)
    noise = jaxtat.phantoms.noise_like(jax.random.key(0), g, 0.01)
    sigma = float(noise.std())
    direct = jaxtat.reconstruct(setup, g + noise, jaxtat.NoiseLevel(sigma))
    fitted = jaxtat.model_based(setup, g + noise, noise=sigma, nonnegative=True).image
    seen = jaxtat.geometry.visibility_map(setup.curve, setup.grid)

    figure, axes = plt.subplots(2, 2, figsize=(9, 5.6), layout="constrained")
    pictures = {"object": disks.image(grid), "direct": direct, "with constraints": fitted}
    for axis, (name, image) in zip(axes.flat, pictures.items(), strict=False):
        drawn = show_image(axis, image, grid, limits=(0, 2), title=name)
        figure.colorbar(drawn, ax=axis)
    title = "share of edge directions that are seen"
    drawn = show_image(axes[1, 1], seen, grid, limits=(0, 1), cmap="viridis", title=title)
    figure.colorbar(drawn, ax=axes[1, 1])
    for axis in axes.flat:
        axis.plot(*np.asarray(curve.points).T, ".", color="tab:red", ms=2)
        axis.set(xlim=(-15, 15), ylim=(-14.5, 1), xlabel="mm", ylabel="mm")
    figure.savefig(PICTURE, dpi=130)


if __name__ == "__main__":
    main()
