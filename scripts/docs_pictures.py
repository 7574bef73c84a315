"""The pictures of the documentation, from jaxtat itself: `make pictures` writes docs/pictures.

One example runs through all of them: the paper's smooth phantom, three quarters of a circle with
500 detectors, 129 x 129 pixels.
"""

from pathlib import Path

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

import jaxtat
from jaxtat.densities import potential
from jaxtat.plotting import DIVERGING, GRAY, new_figure, show_geometry, show_image
from jaxtat.steps import (
    filtered_back_projection,
    offset_step,
    polar_fourier,
    radial_transform,
    radon_projections,
    total_integrals,
)

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
FREQUENCY = 15  # whose densities are shown
LOWEST = 24  # frequencies, of which the transforms are shown


def main() -> None:
    """Compute the five steps and draw each."""
    jax.config.update("jax_enable_x64", True)
    curve = jaxtat.circular_arc(radius=1.3, cut=1.0, n_detectors=500)
    setup = jaxtat.Setup(curve, jaxtat.disk(1.0), jaxtat.ImageGrid(129))
    region, grid, radii = setup.region, setup.grid, setup.radii
    inside = np.asarray(region.contains(grid.points))
    phantom = jaxtat.phantoms.Bells(centers=[[0.3, 0.3], [-0.4, 0.2]], radii=[0.55, 0.5])
    truth, g = phantom.image(grid), phantom.circular_integrals(curve, radii)
    plan = jaxtat.build_plan(setup)
    transformed = radial_transform(g, radii, plan.frequencies)
    fhat = polar_fourier(transformed, plan.densities, curve.weights, total_integrals(g, radii))
    projections = radon_projections(fhat, plan.frequency_step, np.ones(len(plan.frequencies) + 1))
    step = offset_step(plan.frequency_step, len(plan.frequencies))
    image = filtered_back_projection(projections, step, plan.angles, grid, region.center)
    rho = plan.densities.of_frequency(FREQUENCY, curve.weights)[:1]
    wave = potential(plan.frequencies[FREQUENCY], rho, curve, grid.points)[..., 0]

    FOLDER.mkdir(exist_ok=True)
    axes = start()
    show_image(axes[0], truth, grid, title="f, region and detectors")
    show_geometry(axes[0], curve, region)
    as_matrix(axes[1], g, (radii[0], radii[-1], 500, 0), "g: integrals over circles")
    axes[1].set(xlabel="r", ylabel="detector")
    finish(axes, "data")

    axes = start()
    for name, values in zip(("J", "Y"), np.asarray(rho[0]), strict=True):
        axes[0].plot(np.abs(values), label=rf"$|\rho_{name}|$", lw=1)
    axes[0].legend(fontsize=8)
    axes[0].set_title(f"densities of one plane wave, λ = {plan.frequencies[FREQUENCY]:.0f}")
    axes[0].title.set_fontsize(9)
    axes[0].set_xlabel("detector", fontsize=8)
    shown = np.where(inside, np.asarray(wave.real), np.nan)
    show_image(axes[1], shown, grid, cmap=DIVERGING, title="their potential is the wave")
    finish(axes, "step1")

    axes = start()
    extent = (0, 500, float(plan.frequencies[LOWEST]), 0)
    lowest = np.moveaxis(np.asarray(transformed), -2, 0)[:, :LOWEST]
    for axis, values, name in zip(axes, lowest, "JY", strict=True):
        limit = np.quantile(np.abs(values), 0.98)
        as_matrix(axis, values, extent, f"$G_{name}$", DIVERGING, (-limit, limit))
        axis.set(xlabel="detector", ylabel="λ")
    finish(axes, "step2")

    axes = start()
    exact = phantom.fourier(np.concatenate([[0.0], plan.frequencies]), plan.angles)
    extent = (0, 180, float(plan.frequencies[-1]), 0)
    for axis, values, name in (
        (axes[0], np.abs(fhat), r"$\log_{10}|\hat f(\lambda\theta)|$"),
        (axes[1], np.abs(fhat - exact), r"$\log_{10}$ of its error"),
    ):
        as_matrix(axis, np.log10(values + 1e-18), extent, name, "viridis", (-14, -1), bar=True)
        axis.set(xlabel="direction [degrees]", ylabel="λ")
    finish(axes, "step3")

    axes = start()
    n = projections.shape[-1]
    offsets = (np.arange(n) - n // 2) * float(step)
    as_matrix(axes[0], projections, (offsets[0], offsets[-1], 180, 0), "integrals over lines")
    axes[0].set(xlabel="s", ylabel="direction [degrees]")
    error = np.abs(projections - phantom.radon(plan.angles, offsets))
    axes[1].semilogy(np.degrees(plan.angles), np.asarray(error).max(axis=1), lw=1)
    axes[1].set(title="largest error", xlabel="direction [degrees]")
    axes[1].title.set_fontsize(9)
    finish(axes, "step4")

    axes = start()
    show_image(axes[0], np.where(inside, image, np.nan), grid, title="reconstruction")
    error = np.where(inside, image - truth, np.nan)
    bar = show_image(axes[1], error, grid, cmap=DIVERGING, title="minus the truth")
    axes[1].figure.colorbar(bar, ax=axes[1], shrink=0.9)
    finish(axes, "step5")


def start() -> np.ndarray:
    """Two axes beside each other."""
    return new_figure(7.2, 3.0).subplots(1, 2)


def as_matrix(
    axes: Axes,
    values: ArrayLike,
    extent: tuple,
    title: str,
    cmap: str = GRAY,
    limits: tuple[float, float] | None = None,
    bar: bool = False,
) -> None:
    """Draw a matrix whose axes are no lengths."""
    low, high = limits or (None, None)
    shown = axes.imshow(
        np.asarray(values), aspect="auto", extent=extent, cmap=cmap, vmin=low, vmax=high
    )
    axes.set_title(title, fontsize=9)
    if bar:
        axes.figure.colorbar(shown, ax=axes)


def finish(axes: np.ndarray, name: str) -> None:
    """Write the figure of these axes, small enough for a repository."""
    figure = axes[0].figure
    assert isinstance(figure, Figure)
    for axis in axes:
        axis.tick_params(labelsize=7)
        axis.xaxis.label.set_fontsize(8)
        axis.yaxis.label.set_fontsize(8)
    path = FOLDER / f"{name}.png"
    # no metadata, so that the same picture is the same file
    figure.savefig(path, dpi=100, metadata={"Software": None}, pil_kwargs={"optimize": True})
    print(f"{path.name}: {path.stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
