"""The paper's figures, from the results of its experiments."""

from pathlib import Path
from typing import Any

import numpy as np

from ..base.atomic import replacing
from ..plotting import DIVERGING, new_figure, show_geometry, show_image
from ..plotting.canvas import beyond
from .experiments import Results

_WORDS = 11  # size of the letters in the figures of disks [points]


def draw_all(first: Results, second: Results, folder: Path) -> list[str]:
    """Write every figure into a folder; returns their names."""
    figures = {
        "figure1_geometry.png": geometry_figure(first, second),
        "figure2_geometry1_disks.png": disks_figure(first),
        "figure3_geometry2_disks.png": disks_figure(second),
        "figure4_outside_sources.png": outside_figure(second),
        "accuracy_geometry1.png": accuracy_figure(first),
        "accuracy_geometry2.png": accuracy_figure(second),
    }
    for name, figure in figures.items():
        with replacing(folder / name) as temporary:
            figure.savefig(temporary, dpi=130)
    return list(figures)


def geometry_figure(first: Results, second: Results):
    """Acquisition curve and region of interest of both geometries."""
    figure = new_figure(8, 4)
    for axes, results in zip(figure.subplots(1, 2), (first, second), strict=True):
        show_geometry(axes, results.case.setup.curve, results.case.setup.region)
        axes.set_title(results.case.name, fontsize=9)
        axes.set_xlabel("$x_1$")
        axes.set_ylabel("$x_2$")
        axes.legend(fontsize=7, loc="center")
    return figure


def disks_figure(results: Results):
    """Figures 2 and 3: exact, clean, 15 % noise, noise and filter; classical FBP and profiles.

    Narrow, so that the words are readable where a page shows the whole figure.
    """
    figure = new_figure(9, 7)
    rows = figure.subplots(3, 4)
    titles = ("exact", "exact data", "15 % noise", "noise and filter")
    ours = ("disks exact", "disks", "disks noisy", "disks noisy filtered")
    classical = ("disks exact", "fbp", "fbp noisy", "fbp noisy filtered")
    exact = results.images["disks exact"]
    limits = (float(np.nanmin(exact)) - 0.2, float(np.nanmax(exact)) + 0.2)
    for names, axes_row, method in ((ours, rows[0], "from the arc"), (classical, rows[1], "FBP")):
        shown = [
            show_image(axes, results.images[name], results.case.setup.grid, limits=limits)
            for name, axes in zip(names, axes_row, strict=True)
        ]
        for axes in axes_row:
            axes.set(xlabel="", ylabel="", xticks=[], yticks=[])
        axes_row[0].set_ylabel(method, fontsize=_WORDS)
        values = np.stack([results.images[name] for name in names])
        ends: Any = beyond(values, limits)
        figure.colorbar(shown[-1], ax=axes_row, shrink=0.8, extend=ends)
    for axes, title in zip(rows[0], titles, strict=True):
        axes.set_title(title, fontsize=_WORDS)
    _profiles(rows[2], results, ours, limits)
    return figure


def outside_figure(results: Results):
    """Figure 4: a phantom half outside the region, and what is reconstructed inside it."""
    figure = new_figure(12.5, 3.8)
    grid = results.case.setup.grid
    panels = figure.subplots(1, 3)
    shown = show_image(
        panels[0], results.images["outside exact"], grid, limits=(0, 1), title="phantom"
    )
    show_geometry(panels[0], results.case.setup.curve, results.case.setup.region)
    show_image(
        panels[1], results.images["outside"], grid, limits=(0, 1), title="reconstruction in region"
    )
    ends: Any = beyond(results.images["outside"], (0, 1))
    figure.colorbar(shown, ax=panels[:2], extend=ends)
    _error_panel(figure, panels[2], results, "outside error", "error")
    figure.suptitle("geometry2: sources outside the region of interest", fontsize=10)
    return figure


def accuracy_figure(results: Results):
    """Smooth phantom, its error, and the error of the vertical plane wave at lambda_Nyquist."""
    figure = new_figure(12.5, 3.8)
    grid = results.case.setup.grid
    panels = figure.subplots(1, 3)
    shown = show_image(panels[0], results.images["smooth"], grid, title="smooth phantom")
    figure.colorbar(shown, ax=panels[0])
    _error_panel(figure, panels[1], results, "smooth error", "its error")
    wave = show_image(
        panels[2],
        results.images["plane wave error"],
        grid,
        cmap="viridis",
        title="log$_{10}$ error of the vertical plane wave at $\\lambda_{Nyquist}$",
    )
    figure.colorbar(wave, ax=panels[2])
    figure.suptitle(results.case.name, fontsize=10)
    return figure


def _error_panel(figure, axes, results: Results, name: str, title: str) -> None:
    error = results.images[name]
    most = float(np.nanmax(np.abs(error)))
    shown = show_image(
        axes, error, results.case.setup.grid, limits=(-most, most), cmap=DIVERGING, title=title
    )
    figure.colorbar(shown, ax=axes)


def _profiles(axes_row, results: Results, names, limits: tuple[float, float]) -> None:
    """Cross-sections along x_2 through the middle of the brightest disk's column."""
    grid = results.case.setup.grid
    column = int(np.argmin(np.abs(np.asarray(grid.x1) - float(results.case.disks.centers[0, 0]))))
    exact = results.images["disks exact"][column]
    for name, axes in zip(names, axes_row, strict=True):
        if name != "disks exact":
            axes.plot(grid.x2, results.images[name][column], lw=0.8)
        axes.plot(grid.x2, exact, "k", lw=1.0)
        axes.set(ylim=limits, xticks=[-1, 0, 1], yticks=[0, 1, 2])
        axes.set_xlabel(
            f"$x_2$, at $x_1$ = {round(float(grid.x1[column]), 2) + 0.0:.2f}", fontsize=_WORDS
        )
    for axes in axes_row[1:]:
        axes.set_yticklabels([])
