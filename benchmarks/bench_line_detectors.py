"""Volumes of 129 x 129 x 129 voxels from integrating line detectors, exact data against the truth.

The paper's arcs in the plane of the 2-D problem, both open: three quarters of a circle, open at the
top of the axis, and half a circle at one side of it, with which the object takes a whole turn.
"""

import math
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    PAPER_K,
    ImageGrid,
    NormBound,
    Setup,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    line_detectors,
    phantoms,
)
from jaxtat.line_detectors import LineDetectorScan, PolynomialBalls

N = 129
BELLS = PolynomialBalls(
    [[0.3, 0.1, 0.2], [-0.35, 0.25, -0.3], [0.1, -0.45, -0.1]],
    [0.55, 0.45, 0.4],
    [1.0, -0.7, 0.8],
    exponent=8,
)
BALLS = PolynomialBalls(
    [[0, 0, 0], [0.3, 0.2, 0.25], [-0.35, 0.1, -0.3], [0.1, -0.45, -0.1], [-0.2, 0.3, 0.45]],
    [0.85, 0.25, 0.2, 0.15, 0.1],
    [0.5, 0.5, -0.3, 0.5, 0.5],
)


def setup_of(arc: str) -> Setup:
    """The problem of one projection."""
    # half a circle reaches a little beyond the axis, so that its region can hold the axis
    arc_end, region_end, angle = (1.0, 1.0, math.pi / 2) if arc == "top" else (0.2, 0.1, 0.0)
    curve, grid = circular_arc(1.3, arc_end, 500, angle=angle), ImageGrid(N)
    whole = disk(1.0)
    region = disk(1.0, region_end, angle=angle)
    return Setup(curve, region, grid, data_radii(curve, region, grid.spacing[0], sources=whole))


@cache
def plan_of(arc: str):
    """What one side alone shows has a few directions that need larger densities."""
    rule = NormBound(PAPER_K if arc == "top" else 12.0)
    return build_plan(setup_of(arc), rule)


def scan_of(arc: str) -> LineDetectorScan:
    """256 rotations for every half turn."""
    turns = 1 if arc == "top" else 2
    return LineDetectorScan(np.arange(turns * 256) * np.pi / 256)


def exact(phantom: PolynomialBalls) -> tuple[np.ndarray, np.ndarray]:
    """The volume, and which of its voxels are at most 0.95 from the origin."""
    grid = ImageGrid(N)
    x = np.asarray(grid.x1)
    inside = x[:, None, None] ** 2 + x[:, None] ** 2 + x**2 < 0.95**2
    return np.asarray(phantom.volume(grid, grid.x2)), inside


@pytest.fixture
def compare(measure, benchmark):
    """Measure ``work() -> volume``: largest and relative error."""

    def run(work, phantom, rounds=1):
        truth, inside = exact(phantom)
        found = measure(
            work,
            n=N,
            error=lambda volume: np.abs(np.asarray(volume) - truth)[inside],
            rounds=rounds,
        )
        error = np.linalg.norm((np.asarray(found) - truth)[inside])
        benchmark.extra_info.update(relative_error=float(error / np.linalg.norm(truth[inside])))

    return run


def bench_everything(compare):
    """Plan and volume, as for a new scanner."""
    setup, scan = setup_of("top"), scan_of("top")
    g = BELLS.circular_integrals(scan, setup.curve, setup.radii)

    def work():
        return line_detectors.reconstruct_stack(build_plan(setup), g, scan)

    compare(work, BELLS)


@pytest.mark.parametrize("inversion", ["fbp", "fourier"])
def bench_rotations(compare, inversion):
    plan, scan = plan_of("top"), scan_of("top")
    g = BELLS.circular_integrals(scan, plan.curve, plan.radii)
    compare(lambda: line_detectors.reconstruct(plan, g, scan, inversion=inversion), BELLS)


def bench_arc_at_one_side(compare):
    """From half the projections of a whole turn."""
    plan, scan = plan_of("side"), scan_of("side")
    g = BELLS.circular_integrals(scan, plan.curve, plan.radii)
    compare(lambda: line_detectors.reconstruct(plan, g, scan), BELLS)


def narrow(relative_frequency):
    """A cosine that ends at half the Nyquist frequency: details of four voxels and more."""
    return jnp.cos(jnp.pi * jnp.minimum(relative_frequency, 0.5))


@pytest.mark.parametrize(("noise", "low_pass"), [(0.0, None), (0.05, None), (0.05, narrow)])
def bench_balls(compare, noise, low_pass):
    """Sharp edges, whose voxels alone make most of the error without noise."""
    plan, scan = plan_of("top"), scan_of("top")
    g = BALLS.circular_integrals(scan, plan.curve, plan.radii)
    g = jnp.asarray(g + phantoms.noise_like(jax.random.key(0), g, noise))
    compare(lambda: line_detectors.reconstruct(plan, g, scan, low_pass=low_pass), BALLS)
