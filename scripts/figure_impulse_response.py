"""docs/impulse_response.png: a measured cross-section before and after `remove_impulse_response`.

Run from the root of a checkout, with JAXTAT_DATA naming the folder of the measured scan.
"""

import os
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import map_coordinates

import jaxtat
from jaxtat.plotting import add_scale_bar

DATA = Path(os.environ.get("JAXTAT_DATA", "../shared/data"))
OUT = Path("docs/impulse_response.png")
SOUND_SPEED, RADIUS, MAX_FREQUENCY = 1477.0, 0.0146, 12346.0  # m/s, m, rad/m
DEAD_TIME, BAND = 5e-6, (1e5, 7e6)  # s, Hz
EPS = 1e-2
PIXELS, DETAIL = 301, (slice(50, 185), slice(75, 210))


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    scan = np.load(DATA / "msot_scan9.npz")
    times = np.arange(scan["raw"].shape[1]) / float(scan["fs"])
    record = jaxtat.records.condition_record(scan["raw"], times, dead_time=DEAD_TIME)
    response = np.fromfile(DATA / "msot_scan9_raw" / "Scan_9.irf", "<f8")
    response[0] -= 1000  # a mark that the scanner's software adds
    sharp = jaxtat.records.remove_impulse_response(
        record, times, response, regularization=EPS, origin=len(response) // 2
    )
    curve = jaxtat.detector_curve(scan["geometry"])
    center = jaxtat.geometry.fit_circle(curve.points).center
    region = jaxtat.disk(RADIUS, center=center)
    grid = jaxtat.ImageGrid(PIXELS, RADIUS, center)
    sources = jaxtat.disk(0.033, center=center)
    radii = jaxtat.data_radii(curve, region, grid.spacing[0], sources=sources)
    setup = jaxtat.Setup(curve, region, grid, radii, max_frequency=MAX_FREQUENCY)
    images = {}
    for name, pressure in (("as recorded", record), ("response divided out", sharp)):
        # the same band for both: what differs is the response alone
        limited = jaxtat.records.condition_record(pressure, times, band=BAND, baseline=False)
        g = jaxtat.records.pressure_to_circular_integrals(
            limited, times, radii, sound_speed=SOUND_SPEED, model="in-plane"
        )
        image = np.asarray(jaxtat.reconstruct(setup, g, 1e-3, low_pass=jaxtat.cosine_filter))
        inside = np.asarray(region.contains(grid.points))
        images[name] = image / image[inside].std()  # the response changes the scale
        sharpness = RADIUS**2 * float(jaxtat.studies.sharpness(images[name], grid, region))
        sharpness /= np.pi * RADIUS**2
        width = 1e3 * edge_width(images[name], 2 * RADIUS / (PIXELS - 1))
        print(f"{name}: sharpness {sharpness:.1f}, skin falls from 90 to 10 % in {width:.2f} mm")
    draw(images)


def edge_width(image: np.ndarray, pixel: float) -> float:
    """Median over directions of how far the outermost bright line takes from 90 to 10 % [m]."""
    middle, reach = image.shape[0] / 2 - 5, np.arange(20, 135, 0.2)
    threshold = 0.35 * np.percentile(image, 99)
    widths = []
    for theta in np.arange(0, 2 * np.pi, np.pi / 360):
        along = middle + reach * np.array([[np.cos(theta)], [np.sin(theta)]])
        line = map_coordinates(image, along, order=3)
        peaks = (line[1:-1] > line[:-2]) & (line[1:-1] >= line[2:]) & (line[1:-1] > threshold)
        if peaks.any():
            outward = line[np.flatnonzero(peaks)[-1] + 1 :]
            low, high = (
                np.argmax(outward <= 0.1 * outward[0]),
                np.argmax(outward <= 0.9 * outward[0]),
            )
            widths.append(0.2 * pixel * (low - high))
    return float(np.median(widths))


def draw(images: dict[str, np.ndarray]) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(7, 7.3), layout="constrained")
    for column, (name, image) in zip(axes.T, images.items(), strict=True):
        low, high = np.percentile(image, [1, 99.7])
        column[0].set_title(name)
        for axis, part in zip(column, (image, image[DETAIL]), strict=True):
            sides = 1e3 * 2 * RADIUS / (PIXELS - 1) * np.array(part.shape)  # [mm]
            extent = (0.0, sides[0], 0.0, sides[1])
            axis.imshow(part.T, origin="lower", cmap="gray", vmin=low, vmax=high, extent=extent)
            add_scale_bar(axis)
            axis.set_axis_off()
    figure.savefig(OUT, dpi=80)
    print(f"{OUT}: {OUT.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
