"""docs/measured_scan.png: a measured scan with a quarter open, by back-projection and by jaxtat.

Run from the root of a checkout, with JAXTAT_DATA naming the folder of the measured scan; without
it the public scan is downloaded. No option is given: everything is chosen from the file.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Array, Float

import jaxtat
from jaxtat.io import load_scan
from jaxtat.plotting import show_image

OUT = Path("docs/measured_scan.png")
LIMITS = (-2.0, 5.0)  # standard deviations of the image


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    scan = load_scan(jaxtat.datasets.fetch("msot_scan9"))
    choices = jaxtat.scans.estimate_sound_speed(scan, jaxtat.scans.choose(scan))
    print(choices.table())
    image = jaxtat.scans.reconstruct(scan, choices).image
    setup = jaxtat.scans.setup_of(scan, choices)
    g = jaxtat.scans.integrals(scan, choices, setup, scan.frame(0))
    images = {"back-projection": back_projection(setup, g), "jaxtat": image}
    inside = np.asarray(setup.region.contains(setup.grid.points))
    figure, axes = plt.subplots(1, 2, figsize=(9, 4.5), layout="constrained")
    for axis, (title, values) in zip(axes, images.items(), strict=True):
        shown = np.where(inside, np.asarray(values), np.nan)
        shown /= np.nanstd(shown)  # the two have different units
        show_image(axis, shown, setup.grid, limits=LIMITS, title=title)
        axis.set_axis_off()
    figure.savefig(OUT, dpi=100)
    print(f"{OUT}: {OUT.stat().st_size / 1e3:.0f} kB")


def back_projection(setup: jaxtat.Setup, g: Array) -> Float[np.ndarray, "x1 x2"]:
    """Σ_k dΩ_k b(z_k, |x - z_k|) / Σ_k dΩ_k, b = p - r dp/dr: for detectors all around exact.

    p = d(g/r)/dr is the same record that jaxtat gets, in the model of detectors focused into the
    plane; dΩ is the angle under which x sees a detector.

    Source: Xu, Wang, Phys. Rev. E 71 (2005) 016706, equations 20 and 22.
    """
    r, curve = setup.radii, setup.curve
    pressure = derivative(g / r, r)
    terms = pressure - r * derivative(pressure, r)
    center = jaxtat.geometry.fit_circle(curve.points).center
    points = setup.grid.points.reshape(-1, 2)

    def add(sums: tuple[Array, Array], detector: tuple[Array, ...]) -> tuple[tuple, None]:
        position, weight, values = detector
        offset = points - position
        distance = jnp.linalg.norm(offset, axis=1)
        inward = (center - position) / jnp.linalg.norm(center - position)
        angle = weight * (offset @ inward) / distance**2
        return (sums[0] + angle * jnp.interp(distance, r, values), sums[1] + angle), None

    start = jnp.zeros(len(points)), jnp.zeros(len(points))
    (total, angles), _ = jax.lax.scan(add, start, (curve.points, curve.weights, terms))
    return np.asarray(total / angles).reshape(setup.grid.shape)


def derivative(values: Array, r: Array) -> Array:
    """d/dr along the last axis, for equal steps."""
    return jnp.asarray(np.gradient(np.asarray(values), float(r[1] - r[0]), axis=-1))


if __name__ == "__main__":
    main()
