"""Draw docs/line_detectors.png: balls, two open arrays of line detectors and slices of volumes.

    python scripts/draw_line_detectors.py docs/line_detectors.png

129 x 129 x 129 voxels, 500 line detectors; a few minutes on 2 cores.
"""

import math
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxtat
from jaxtat.base.atomic import replacing
from jaxtat.line_detectors import LineDetectorScan, PolynomialBalls, reconstruct
from jaxtat.plotting import new_figure, show_geometry, show_image

PARTS = (
    [[0, 0, 0], [0.3, 0.2, 0.25], [-0.35, 0.1, -0.3], [0.1, -0.45, -0.1], [-0.2, 0.1, 0.45]],
    [0.85, 0.25, 0.2, 0.15, 0.1],
    [0.5, 0.5, -0.3, 0.5, 0.5],
)
LIMITS = (-0.2, 1.2)


def narrow(relative_frequency):
    """A cosine that ends at half the Nyquist frequency: details of four voxels and more."""
    return jnp.cos(jnp.pi * jnp.minimum(relative_frequency, 0.5))


def main(path: Path) -> None:
    jax.config.update("jax_enable_x64", True)
    grid, balls = jaxtat.ImageGrid(129), PolynomialBalls(*PARTS)
    exact = np.asarray(balls.volume(grid, grid.x2))
    figure = new_figure(12.5, 6.4)
    rows = figure.subplots(2, 4)
    for row, name, (arc_end, region_end, angle, turns, K) in zip(
        rows,
        ("open at the top, half a turn", "at one side, a whole turn"),
        ((1.0, 1.0, math.pi / 2, 1, jaxtat.PAPER_K), (0.2, 0.1, 0.0, 2, 12.0)),
        strict=True,
    ):
        curve = jaxtat.circular_arc(1.3, arc_end, 500, angle=angle)
        region = jaxtat.disk(1.0, region_end, angle=angle)
        whole = jaxtat.disk(1.0)
        radii = jaxtat.data_radii(curve, region, grid.spacing[0], sources=whole)
        plan = jaxtat.build_plan(jaxtat.Setup(curve, region, grid, radii), jaxtat.NormBound(K))
        scan = LineDetectorScan(np.arange(256 * turns) * np.pi / 256)
        g = balls.circular_integrals(scan, curve, radii)
        noisy = g + jaxtat.phantoms.noise_like(jax.random.key(0), g, 0.05)
        volumes = (
            reconstruct(plan, g, scan),
            reconstruct(plan, noisy, scan, low_pass=narrow),
        )
        show_image(row[0], balls.projection(0.0).image(grid), grid)
        row[0].set_title(f"projection; array {name}", fontsize=8)
        draw(figure, row, plan, exact, [np.asarray(volume) for volume in volumes])
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=90)


def draw(figure, row, plan, exact: np.ndarray, volumes: list[np.ndarray]) -> None:
    """The array, before a projection; slices through the axis: exact, reconstructed, with noise."""
    show_geometry(row[0], plan.curve, plan.region)
    row[0].axvline(0, color="tab:green", lw=0.8, ls="--", label="axis of rotation")
    row[0].set(xlim=(-1.45, 1.45), ylim=(-1.45, 1.45))
    row[0].legend(fontsize=5, loc="lower right")
    row[0].set_xlabel("$u$", fontsize=8)
    row[0].set_ylabel("$v$", fontsize=8)
    middle = 70  # x2 = 0.09, through four of the balls
    titles = ("exact", "exact data", "5 % noise, smoothed")
    shown = [
        show_image(axes, volume[:, middle], plan.grid, limits=LIMITS, title=title)
        for axes, title, volume in zip(row[1:], titles, [exact, *volumes], strict=True)
    ]
    for axes in row[1:]:
        axes.set_ylabel("$x_3$", fontsize=8)
    figure.colorbar(shown[0], ax=row[1:], shrink=0.8)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
