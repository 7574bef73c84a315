"""docs/four_methods.png: a measured and a simulated scan with a gap, each by four methods.

Run from the root of a checkout, with JAXTAT_DATA naming the folder of both scans. The images of a
scan have the same data, speed of sound, region and pixels; each is multiplied by the factor with
which it is nearest to the truth, or, where that is not known, to the direct image.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import scipy.special
from figure_measured_scan import back_projection

import jaxtat
from jaxtat.io import load_scan
from jaxtat.plotting import add_scale_bar, show_image
from jaxtat.steps import fourier_inversion

OUT = Path("docs/four_methods.png")
MODEL_BASED = {"model_based": True, "nonnegative": True}


def full_circle(setup: jaxtat.Setup, g: np.ndarray) -> np.ndarray:
    """The formula for a full circle |z| = R, where detectors that are missing record nothing.

    With u(z) = ∫ g(z, r) (J_0 + i Y_0)(lambda r) dr and its Fourier coefficients u_k over the angle
    of z, the coefficients of fhat are (-i)^k u_k / H_k(lambda R), since
    H_0(lambda |x - z|) = Σ_k H_k(lambda R) J_k(lambda |x|) exp(ik (theta_z - theta_x)).

    Source: Norton, J. Acoust. Soc. Am. 67 (1980) 1266-1273; with FFTs: Kunyansky, Inverse Probl.
    Imaging 6 (2012) 111-131.
    """
    circle = jaxtat.geometry.fit_circle(setup.curve.points)
    center, radius = np.asarray(circle.center), float(circle.radius)
    x, y = (np.asarray(setup.curve.points) - center).T
    weights = np.asarray(setup.curve.weights) / (2 * np.pi * radius)
    frequencies = np.asarray(setup.sizes.frequencies)
    angles = np.arange(setup.sizes.n_directions) * np.pi / setup.sizes.n_directions
    radii = np.asarray(setup.radii)
    orders = np.arange(-(len(x) // 2), len(x) // 2 + 1)
    turned = np.exp(-1j * orders[:, None] * np.arctan2(y, x)) * weights
    argument = frequencies[:, None] * radii
    kernel = scipy.special.j0(argument) + 1j * scipy.special.y0(argument)
    step = np.gradient(radii)
    u = turned @ (g * step) @ kernel.T
    hankel = scipy.special.hankel1(orders[:, None], frequencies * radius)
    hankel[~np.isfinite(hankel)] = np.inf  # high orders at low frequencies: nothing of them is left
    coefficients = u / hankel
    waves = (-1j) ** orders[:, None] * np.exp(1j * orders[:, None] * angles)
    fhat = coefficients.T @ waves / (2 * np.pi)
    mass = weights @ (g @ step) / (2 * np.pi)  # silent detectors count here too
    fhat = np.concatenate([np.full((1, len(angles)), mass, complex), fhat])
    image = fourier_inversion(
        jnp.asarray(fhat),
        jnp.asarray(frequencies[0]),
        jnp.asarray(angles),
        setup.grid,
        jnp.asarray(center),
        jnp.ones(len(fhat)),
    )
    return np.asarray(image)


def images(scan, choices, constrained) -> tuple[dict[str, np.ndarray], jaxtat.Setup]:
    """Those of the four methods, and their setup."""
    setup = jaxtat.scans.setup_of(scan, choices)
    g = jaxtat.scans.integrals(scan, choices, setup, scan.frame(0))
    made = {
        "back-projection": back_projection(setup, g),
        "formula for a full circle": full_circle(setup, np.asarray(g)),
        "jaxtat, direct": jaxtat.scans.reconstruct(scan, choices).image,
        "jaxtat, model-based": jaxtat.scans.reconstruct(scan, constrained).image,
    }
    return {name: np.asarray(image) for name, image in made.items()}, setup


def measured():
    """The public scan: no option but the constraints of the last image."""
    scan = load_scan(jaxtat.io.datasets.fetch("msot_scan9"))
    choices = jaxtat.scans.choose(scan)
    given = {"sound_speed": choices.sound_speed, "pixels": choices.pixels}
    constrained = jaxtat.scans.choose(scan, **given, **MODEL_BASED)
    made, setup = images(scan, choices, constrained)
    return "measured", made, setup, made["jaxtat, direct"]


def simulated():
    """Waves of a known object from another code, a quarter of the circle missing."""
    path = jaxtat.io.datasets.fetch("half_disk_three_quarter_arc")
    angles = 2 * np.pi * np.arange(1024) / 1024
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    scan = jaxtat.scans.with_facts(load_scan(path), detectors=ring, times=np.linspace(0, 6, 769))
    used = (*range(921, 1024), *range(1, 616))
    given = {
        "use": used,
        "pixels": 257,
        "half_width": 1.0,
        "region_center": (0.0, 0.0),
        "region_radius": 0.97,
        "region_cut": 0.0,
        "region_angle": -90.0,
    }
    made, setup = images(
        scan,
        jaxtat.scans.choose(scan, **given),
        jaxtat.scans.choose(scan, **given, **MODEL_BASED),
    )
    truth = np.load(path)["truth"].T.astype(float)  # stored as (x2, x1)
    return "simulated", made, setup, truth


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    figure, axes = plt.subplots(2, 4, figsize=(13, 5.6), height_ratios=(2, 1), layout="constrained")
    for row, (kind, made, setup, reference) in zip(axes, (measured(), simulated()), strict=True):
        inside = np.asarray(setup.region.contains(setup.grid.points))
        low, high = np.percentile(reference[inside], [1, 99.7])
        for axis, (name, image) in zip(row, made.items(), strict=True):
            factor = np.vdot(image[inside], reference[inside]) / np.vdot(
                image[inside], image[inside]
            )
            shown = np.where(inside, factor * image, np.nan)
            error = np.linalg.norm((shown - reference)[inside]) / np.linalg.norm(reference[inside])
            label = f"{name}\nrelative error {100 * error:.2g} %" if kind == "simulated" else name
            print(f"{kind:10} {name:28} {100 * error:.3g} %")
            unit = "m" if kind == "measured" else None
            show_image(axis, shown, setup.grid, limits=(low, high), title=label, unit=unit)
            axis.set_axis_off()
            if unit:
                add_scale_bar(axis)
            else:
                axis.set_ylim(0.0, 1.0)  # the region
    figure.savefig(OUT, dpi=90)
    print(f"{OUT}: {OUT.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
