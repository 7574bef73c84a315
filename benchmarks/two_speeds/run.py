"""Images through bodies of another speed of sound, from records of an independent solver.

    python benchmarks/two_speeds/run.py [folder]

prints relative L2 errors within 0.45 of the body's centre, the table of docs/accuracy.md. Records
of the full circle are kept in the folder; arcs are parts of them. Noise is white, its standard
deviation in per cent of the largest pressure, at samples 1/128 apart. Every method gets the best
of five alphas and the best of its speeds, by its own error: what it could do at most. Detectors are
1 degree apart, water has the speed 1, the body is about (0.1, -0.06).
"""

import sys
import tempfile
import warnings
from itertools import product
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import waves

from jaxtat import DiskBody, ImageGrid, OutlineBody, Setup, detector_curve, disk, solve
from jaxtat.geometry.bodies import lag
from jaxtat.records import pressure_to_circular_integrals

jax.config.update("jax_enable_x64", True)
warnings.simplefilter("ignore")  # of few detectors and of what an arc does not see

CENTER, RADIUS, AXES = np.array([0.1, -0.06]), 0.45, (0.50, 0.38)
BELLS = (  # middle, radius, height
    ((0.25, 0.10), 0.10, 1.0),
    ((-0.10, 0.12), 0.14, 0.7),
    ((0.05, -0.30), 0.08, 1.2),
    ((0.38, -0.15), 0.07, 0.9),
    ((-0.22, -0.15), 0.09, 1.0),
    ((0.12, 0.02), 0.05, 1.3),
)
EVERY = 1 / 128
RADII = np.arange(0.35, 2.25, EVERY)
GRID = ImageGrid(129, 0.5, CENTER)
REGION = disk(0.5, center=CENTER)
AROUND = disk(0.63)  # about the detectors' centre: for one speed, which is faster there
MEASURED = np.hypot(*np.moveaxis(np.asarray(GRID.points) - CENTER, -1, 0)) < 0.45
ALPHAS = 1e-6, 1e-4, 1e-3, 1e-2, 1e-1
SHARES = 0.2, 0.3, 0.4, 0.5, 0.6, 1.0  # of the difference of speeds, for one speed
ARCS, NOISE = (360, 270, 180), (0.0, 0.01, 0.05)


def phantom(points):
    total = 0.0
    for middle, radius, height in BELLS:
        t = np.minimum(np.hypot(*np.moveaxis(points - np.array(middle), -1, 0)) / radius, 1)
        total = total + height * np.cos(np.pi * t / 2) ** 4
    return total


def level(points, shape):
    """Below zero in the body."""
    x, y = np.moveaxis(points - CENTER, -1, 0)
    if shape == "disk":
        return np.hypot(x, y) - RADIUS
    a, b = AXES
    size = np.hypot(x / a, y / b)
    return (size - 1) * size / np.maximum(np.hypot(x / a**2, y / b**2), 1e-9)


def circle():
    angles = np.deg2rad(np.arange(360) + 0.5)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def recorded(folder, shape, speed):
    """Records of the full circle, from the folder if they are there."""
    path = Path(folder) / f"{shape}_{speed}.npz"
    if not path.exists():
        axis = waves.square()
        points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
        body = waves.smooth_body(level(points, shape), speed)
        pressure, times = waves.record(phantom(points), body, circle(), axis, EVERY)
        np.savez(path, pressure=pressure, times=times)
    with np.load(path) as file:
        return file["pressure"], file["times"]


def straight_delays(g, curve, body):
    """Back-projection with the delays of straight rays, in the best unit: the common practice."""
    r = np.asarray(RADII)
    pressure = np.gradient(g / r, EVERY, axis=1)
    terms = pressure - r * np.gradient(pressure, EVERY, axis=1)
    points = np.asarray(GRID.points).reshape(-1, 2)
    detectors, weights = np.asarray(curve.points), np.asarray(curve.weights)
    late = np.asarray(lag(body, curve.points, jnp.asarray(points)))
    total = angles = 0.0
    for position, weight, values, more in zip(detectors, weights, terms, late, strict=True):
        offset = points - position
        distance = np.linalg.norm(offset, axis=1)
        angle = weight * np.abs(offset @ position) / distance**2
        total = total + angle * np.interp(distance + more, r, values)
        angles = angles + angle
    image, truth = (total / angles).reshape(GRID.shape), phantom(np.asarray(GRID.points))
    return image * np.vdot(image[MEASURED], truth[MEASURED]) / np.sum(image[MEASURED] ** 2)


def error(image):
    truth = phantom(np.asarray(GRID.points))[MEASURED]
    return np.linalg.norm(np.asarray(image)[MEASURED] - truth) / np.linalg.norm(truth)


def errors(shape, speed, opening, noise, folder):
    """The best of one speed, of straight delays, and of two speeds by a disk and by the outline."""
    pressure, times = recorded(folder, shape, speed)
    kept = slice(0, opening)
    generator = np.random.default_rng(0)
    pressure = pressure[kept] + noise * np.abs(pressure).max() * generator.standard_normal(
        pressure[kept].shape
    )
    curve = detector_curve(circle()[kept], closed=opening == 360)
    g = np.asarray(pressure_to_circular_integrals(pressure, times, RADII))
    body = DiskBody(CENTER, RADIUS, speed, 1.0)
    one = Setup(curve, AROUND, GRID, RADII)
    two = Setup(curve, REGION, GRID, RADII, medium=body)
    single = min(
        error(solve(one.replace(radii=RADII * c), g * c, alpha).image)
        for c in 1 + np.array(SHARES) * (speed - 1)
        for alpha in ALPHAS
    )
    through = min(error(solve(two, g, alpha).image) for alpha in ALPHAS)
    outline = through
    if shape == "ellipse":
        ellipse = OutlineBody.ellipse(CENTER, AXES, speed, 1.0)
        setup = Setup(curve, REGION, GRID, RADII, medium=ellipse)
        outline = min(error(solve(setup, g, alpha).image) for alpha in ALPHAS)
    return single, error(straight_delays(g, curve, body)), through, outline


def main(folder):
    print("| body | c_1/c_2 | arc | noise | best one speed | straight delays | disk | outline |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for shape, speed, opening, noise in product(("disk", "ellipse"), (1.04, 0.96), ARCS, NOISE):
        found = errors(shape, speed, opening, noise, folder)
        row = shape, speed, f"{opening}°", f"{noise:.0%}", *(f"{x:.4f}" for x in found)
        print("|", " | ".join(map(str, row)), "|", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as made:
            main(made)
