"""docs/pictures/own_phantom.png: a picture, its record, and images of that.

    python scripts/figure_own_phantom.py

Three letters, 250 detectors on three quarters of a circle, two-dimensional waves, noise of half
the record's standard deviation.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import jaxtat
from jaxtat.plotting import show_image

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "own_phantom.png"
PIXELS, FINER = 129, 4  # grey at the edges


def letters() -> np.ndarray:
    """JAX in white on black, rows from the top."""
    figure = Figure((1, 1), dpi=PIXELS * FINER)
    figure.text(0.5, 0.5, "JAX", size=27, weight="bold", ha="center", va="center")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    ink = 1 - np.asarray(canvas.buffer_rgba())[..., 0] / 255
    return ink.reshape(PIXELS, FINER, PIXELS, FINER).mean(axis=(1, 3))


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    truth = letters()[::-1].T
    curve, region, grid = (
        jaxtat.circular_arc(1.3, 1.0, 250),
        jaxtat.disk(1.0),
        jaxtat.ImageGrid(PIXELS),
    )
    setup = jaxtat.Setup(curve, region, grid)
    radii = jaxtat.data_radii(curve, region, step=grid.spacing[0] / 4)
    times = jnp.linspace(0.0, 1.3 * radii[-1], 1601)
    g = jaxtat.forward_operator(jaxtat.Setup(curve, region, grid, radii))(truth)
    record = jaxtat.records.circular_integrals_to_pressure(g, radii, times)
    noisy = record + jaxtat.phantoms.noise_like(jax.random.key(0), record, 0.5)
    data = jaxtat.records.pressure_to_circular_integrals(noisy, times, setup.radii)
    images = {
        "picture": truth,
        "direct": jaxtat.reconstruct(setup, data, 1e-3),
        "fitted": jaxtat.model_based(setup, data, nonnegative=True).image,
    }

    inside = np.asarray(region.contains(grid.points))
    figure, axes = plt.subplots(1, 4, figsize=(12, 3), layout="constrained")
    extent = (float(times[0]), float(times[-1]), len(record), 0)
    limit = float(jnp.quantile(jnp.abs(record), 0.99))
    shown = {"aspect": "auto", "cmap": "gray", "vmin": -limit, "vmax": limit, "extent": extent}
    axes[1].imshow(noisy, **shown)
    axes[1].set_title("record, 50 % noise", fontsize=9)
    axes[1].set(xlabel="t", ylabel="detector")
    for axis, (name, image) in zip(axes[[0, 2, 3]], images.items(), strict=True):
        error = np.linalg.norm((np.asarray(image) - truth)[inside]) / np.linalg.norm(truth)
        title = name if name == "picture" else f"{name}: error {error:.2f}"
        values = np.where(inside, np.asarray(image), np.nan)
        show_image(axis, values, grid, limits=(-0.2, 1.2), title=title)
        axis.set_axis_off()
    axes[0].plot(*np.asarray(curve.points).T, color="tab:red", lw=2)
    axes[0].set(xlim=(-1.4, 1.4), ylim=(-1.4, 1.4))
    figure.savefig(PICTURE, dpi=100)


if __name__ == "__main__":
    main()
