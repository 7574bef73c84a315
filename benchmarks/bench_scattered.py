"""Fits of volumes to scattered elements, beside back-projection: 5 % noise, 5 % of them dead.

Balls or bells, whose pressure is known in closed form, about every element the mean over it; errors
are relative, in the 2-norm over the region, beside means over voxels. The deviation of the
noise is 5 % of the largest pressure. Back-projection is given its best factor. Lengths are in radii
of the region. Times are given in products with the fit's operator too, measured in the same run, so
that they can be compared between machines: of the fit with it and its transpose, one of each, of
the formula's solution (``direct``) with it alone.

    pytest benchmarks/bench_scattered.py -c benchmarks/pytest.ini [-k 33]
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import RelativeTikhonov, Setup, VolumeGrid, model_based, solve
from jaxtat.forward import pressure_terms
from jaxtat.reconstruction import operator_on
from jaxtat.spherical import DetectorPoints, back_projection, ball, pressure_to_spherical_integrals
from jaxtat.spherical.sizes import resolved_frequency

NOISE, DEAD, PARTS = 0.05, 0.05, 4  # PARTS of a sample, over which records are means
# voxels, elements on a whole sphere, its part below this share of the radius, radii of elements
FIBONACCI = {"fibonacci-33": (33, 366, 0.4, 0.1), "fibonacci-65": (65, 1013, 0.4, 0.05)}
HEMISPHERE = 33, 7e-3, 2e-3 / np.sqrt(3)  # voxels, region and element of `hemisphere_256` [m]
RNG = np.random.default_rng(7)
CENTERS, RADII = RNG.uniform(-0.45, 0.45, (8, 3)), RNG.uniform(0.15, 0.35, 8)
VALUES = RNG.uniform(0.5, 1.5, 8)
PROFILES = {"balls": lambda t: jnp.where(t < 1, 1.0, 0.0), "bells": lambda t: (1 - t**2) ** 3}


@dataclass(frozen=True)
class Scattered:
    """Elements that live, their record, and the volume behind it."""

    setup: Setup
    times: np.ndarray
    record: np.ndarray
    truth: np.ndarray


def elements(name: str) -> tuple[int, DetectorPoints]:
    """Voxels along an axis, and those elements that are not dead, weighted by area."""
    if name == "hemisphere-33":
        path = Path(os.environ.get("JAXTAT_DATA", "../shared/data")) / "arrays_in_space.npz"
        if not path.exists():
            pytest.skip(f"{path} is not there")
        voxels, region, radius = HEMISPHERE
        points, radius = np.load(path)["hemisphere_256"] / region, radius / region
        size = np.linalg.norm(points[0])
        share = (size - np.abs(points[:, 2]).min()) / (2 * size)
    else:
        voxels, whole, top, radius = FIBONACCI[name]
        height, turn = -1 + 2 * (np.arange(whole) + 0.5) / whole, np.pi * (3 - np.sqrt(5))
        ring, turns = np.sqrt(1 - height**2), turn * np.arange(whole)
        points = np.stack([ring * np.cos(turns), ring * np.sin(turns), height], axis=1)
        points, share = 2 * points[height < top], (1 + top) / 2
    return voxels, living(points, share, radius)


def living(points: np.ndarray, share: float, radius: float | None) -> DetectorPoints:
    """Elements that are not dead, each of an equal part of that share of the sphere."""
    n, size = len(points), np.linalg.norm(points[0])
    alive = np.sort(np.random.default_rng(1).permutation(n)[round(DEAD * n) :])
    areas = np.full(len(alive), share * 4 * np.pi * size**2 / len(alive))
    return DetectorPoints(points[alive], areas, element_radius=radius)


def pressure(points: jax.Array, paths: np.ndarray, profile) -> jax.Array:
    """Σ v ((d - ct) b(|d - ct|/a) + (d + ct) b((d + ct)/a)) / 2d."""
    total = jnp.zeros((len(points), len(paths)))
    for center, radius, value in zip(CENTERS, RADII, VALUES, strict=True):
        distance = jnp.linalg.norm(points - center, axis=1)[:, None]
        near, far = distance - paths, distance + paths
        wave = near * profile(jnp.minimum(jnp.abs(near) / radius, 1.0))
        total += value * (wave + far * profile(jnp.minimum(far / radius, 1.0))) / (2 * distance)
    return total


def largest(record: np.ndarray) -> float:
    """The largest pressure."""
    return float(np.abs(record).max())


def parts_of(times: np.ndarray) -> np.ndarray:
    """Times within each sample, over which records are means."""
    within = (np.arange(PARTS) + 0.5) / PARTS - 0.5
    return (times[:, None] + (times[1] - times[0]) * within).ravel()


def recorded(fine: np.ndarray, size: Callable[[np.ndarray], float] = largest) -> np.ndarray:
    """Means over the parts of samples, and noise, relative to that size of these."""
    means = fine.reshape(len(fine), -1, PARTS).mean(axis=-1)
    noise = np.random.default_rng(2).standard_normal(means.shape)
    return means + NOISE * size(means) * noise


def truth_on(grid: VolumeGrid, profile) -> jax.Array:
    """Means of the bodies over voxels."""
    points = grid.finer(3).points
    total = jnp.zeros(points.shape[:-1])
    for center, radius, value in zip(CENTERS, RADII, VALUES, strict=True):
        share = jnp.linalg.norm(points - center, axis=-1) / radius
        total = total + value * profile(jnp.minimum(share, 1.0))
    return grid.means(total)


def by_best_factor(values: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Nearest to the truth; of a fit the factor is 1."""
    return values * (values @ truth) / (values @ values)


CASES = [("balls", name) for name in ("hemisphere-33", *FIBONACCI)] + [("bells", "fibonacci-33")]


@pytest.fixture(scope="module", params=CASES, ids="-".join)
def case(request):
    body, array = request.param
    voxels, curve = elements(array)
    profile, grid = PROFILES[body], VolumeGrid(voxels)
    setup = Setup(curve, ball(1.0), grid, max_frequency=4.0)  # of the formula: a fit has its own
    distance, step = float(np.asarray(curve.distance)[0]), float(grid.spacing[0]) / 2
    times = np.arange(distance - 1, distance + 1 + step, step)
    parts = parts_of(times)
    record = recorded(
        np.asarray(curve.mean_over_elements(lambda points: pressure(points, parts, profile), 3))
    )
    return Scattered(setup, times, record, np.asarray(truth_on(grid, profile)))


def seconds(work: Callable[[], object], rounds: int = 7) -> float:
    """The median once it is compiled."""
    jax.block_until_ready(work())
    spent = []
    for _ in range(rounds):
        start = time.perf_counter()
        jax.block_until_ready(work())
        spent.append(time.perf_counter() - start)
    return float(np.median(spent))


def products(case: Scattered) -> tuple[float, float]:
    """Times of a product with the fit's operator and of one with its transpose [s]."""
    setup = case.setup
    record = pressure_terms(setup.kind.sizes_inside(setup), jnp.asarray(case.times))
    operator = operator_on(setup, setup.grid, record=record, dtype="float32")
    volume, data = (jnp.asarray(array, "float32") for array in (case.truth, case.record))
    return seconds(lambda: operator.mv(volume)), seconds(lambda: operator.T.mv(data))


@pytest.mark.parametrize("method", ["jaxtat", "direct", "back-projection"])
def bench_scattered(measure, benchmark, case, method):
    setup = case.setup
    inside = np.asarray(setup.region.contains(setup.grid.points))
    truth, given = case.truth[inside], {"times": case.times, "dtype": "float32"}

    def work():
        if method == "jaxtat":
            return model_based(setup, case.record, nonnegative=True, tolerance=1.5e-2, **given)
        radii = case.times[1:-1]
        g = pressure_to_spherical_integrals(case.record, case.times, radii)
        if method == "direct":
            highest = resolved_frequency(setup.curve, 1.0)
            by_formula = Setup(setup.curve, setup.region, setup.grid, radii, max_frequency=highest)
            return solve(by_formula, g, RelativeTikhonov(0.1))
        return back_projection(setup.curve, radii, g, setup.grid.points)

    def fitting(found):
        values = np.asarray(getattr(found, "image", found))[inside]
        return by_best_factor(values, truth) if method == "back-projection" else values

    n = setup.grid.shape[0]
    found = measure(work, n=n, error=lambda f: np.abs(fitting(f) - truth).max(), rounds=1)
    error = np.linalg.norm(fitting(found) - truth) / np.linalg.norm(truth)
    forward, transpose = products(case)
    took = benchmark.extra_info["median_s"]
    relative = {"in_forwards": took / forward, "in_products": took / (forward + transpose)}
    steps = int(getattr(found, "steps", 0))
    benchmark.extra_info.update(relative_error=float(error), iterations=steps, **relative)
    print(f"relative error {error:.3f}, {steps} steps, {relative}")
