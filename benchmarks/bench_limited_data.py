"""Direct and model-based images where data are few, end early, or miss half of the edges.

Each problem is reconstructed by `reconstruct`, if it can be, and by `model_based` with f >= 0,
total variation and the automatic weight. The relative error is over the region; of the public scan,
of which no truth is known, it is what the image leaves unexplained of the record.
"""

from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bench_model_based import DISKS, pixel_means
from jaxtyping import Array

from jaxtat import (
    ImageGrid,
    NoiseLevel,
    Setup,
    VolumeGrid,
    circular_arc,
    data_radii,
    disk,
    model_based,
    phantoms,
    reconstruct,
    scans,
)
from jaxtat.io import load_scan
from jaxtat.io.datasets import fetch
from jaxtat.records import pressure_to_circular_integrals
from jaxtat.scans.constrained import fitted
from jaxtat.spherical import Balls, ball, cap_radii, spherical_cap

HEIGHTS = [[0.1], [-0.3], [0.2], [-0.2], [0.35], [-0.1]]
BALLS = Balls(np.hstack([DISKS.centers, HEIGHTS]), DISKS.radii, DISKS.amplitudes)


@dataclass(frozen=True)
class Problem:
    """Data with noise of a known size (None: none), and what is true of each pixel."""

    setup: Setup
    g: Array
    truth: np.ndarray
    sigma: float | None = None

    def relative(self, image: Array) -> float:
        inside = np.asarray(self.setup.region.contains(self.setup.grid.points))
        wrong = (np.asarray(image) - self.truth)[inside]
        return float(np.linalg.norm(wrong) / np.linalg.norm(self.truth[inside]))

    def direct(self) -> Array:
        return reconstruct(self.setup, self.g, NoiseLevel(self.sigma) if self.sigma else 1e-3)

    def constrained(self, **options):
        dtype = jnp.float32 if self.sigma else None
        return model_based(
            self.setup, self.g, nonnegative=True, noise=self.sigma, dtype=dtype, **options
        )


def few_detectors() -> Problem:
    """Sixty-four, simulated by another code."""
    try:
        file = np.load(fetch("full_circle_64_detectors"))
    except OSError as error:
        pytest.skip(f"the data are not here: {error}")
    setup = Setup(circular_arc(1.0, 1.0, 64, angle=-np.pi / 64), disk(0.98), ImageGrid(257))
    pressure, times = file["pressure"].T, np.linspace(0, 6, 769)
    g = pressure_to_circular_integrals(pressure, times, setup.radii)
    return Problem(setup, g, file["truth"].T)


def half_circle() -> Problem:
    """The whole disk from half a circle, which misses half of the edges, with 1 % of noise."""
    curve, region, grid = circular_arc(1.3, 0.0, 500), disk(1.0), ImageGrid(129)
    setup = Setup(curve, region, grid, data_radii(curve, region, grid.spacing[0]))
    g = DISKS.circular_integrals(curve, setup.radii)
    noise = phantoms.noise_like(jax.random.key(0), g, 0.01)
    return Problem(setup, g + noise, pixel_means(DISKS, grid), float(noise.std()))


def ends_early(kind: str) -> Problem:
    """A full circle whose data end at radius 1, of 2 that meet the region."""
    curve, grid = circular_arc(1.0, 1.0, 512), ImageGrid(257)
    setup = Setup(curve, disk(0.98), grid, np.arange(0.02, 1.0, float(grid.spacing[0])))
    if kind == "bells":
        bells = phantoms.Bells([[0.3, 0.3], [-0.4, 0.2]], [0.55, 0.5])
        return Problem(setup, bells.circular_integrals(curve, setup.radii), bells.image(grid))
    small = phantoms.Disks(DISKS.centers, 0.9 * DISKS.radii, DISKS.amplitudes)
    g = small.circular_integrals(curve, setup.radii)
    return Problem(setup, g, pixel_means(small, grid))


def cap() -> Problem:
    """Balls from a cap, 5 % of noise."""
    curve, grid, region = spherical_cap(1.3, 1.0, 96, 256), VolumeGrid(65), ball(1.0)
    setup = Setup(curve, region, grid, cap_radii(curve, region, grid.spacing[0] / 2))
    g = BALLS.spherical_integrals(curve, setup.radii)
    noise = phantoms.noise_like(jax.random.key(0), g, 0.05)
    steps = ((np.arange(4) + 0.5) / 4 - 0.5) * float(grid.spacing[0])
    shifts = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    truth = np.mean([np.asarray(BALLS(grid.points + shift)) for shift in shifts], axis=0)
    return Problem(setup, g + noise, truth, float(noise.std()))


WHOLE = {"few_detectors": few_detectors, "half_circle": half_circle, "cap": cap}


@pytest.fixture(scope="module", params=WHOLE)
def problem(request) -> Problem:
    return WHOLE[request.param]()


def _measured(measure, benchmark, given: Problem, work):
    n = given.setup.grid.shape[0]
    found = measure(work, n=n, error=lambda found: given.relative(_image(found)), rounds=1)
    steps = int(found.steps) if hasattr(found, "steps") else 0
    benchmark.extra_info.update(relative_error=given.relative(_image(found)), iterations=steps)


def _of_means(grid: ImageGrid, fine: Problem):
    found = fine.constrained()
    return eqx.tree_at(lambda found: found.image, found, grid.means(found.image))


def _image(found) -> Array:
    return getattr(found, "image", found)


def bench_limited_direct(measure, benchmark, problem):
    _measured(measure, benchmark, problem, problem.direct)


def bench_limited_model_based(measure, benchmark, problem):
    _measured(measure, benchmark, problem, problem.constrained)


def bench_half_circle_on_finer_pixels(measure, benchmark):
    """Pixels half as wide; the image is their means."""
    given = half_circle()
    coarse = given.setup
    fine = Setup(coarse.curve, coarse.region, coarse.grid.finer(2), coarse.radii)
    _measured(measure, benchmark, given, lambda: _of_means(coarse.grid, replace(given, setup=fine)))


@pytest.mark.parametrize("kind", ["bells", "disks"])
def bench_record_that_ends_early(measure, benchmark, kind):
    given = ends_early(kind)
    _measured(measure, benchmark, given, given.constrained)


def bench_scan_model_based(measure, benchmark):
    """The public scan from its raw record, 300 x 300 pixels."""
    try:
        scan = load_scan(fetch("msot_scan9"))
    except OSError as error:
        pytest.skip(f"the public scan is not here: {error}")
    choices = scans.choose(scan, pixels=300, sound_speed=1477.2, nonnegative=True)
    setup, frame = scans.setup_of(scan, choices), scan.frame(0)
    found = measure(lambda: fitted(scan, choices, setup, frame), n=300, rounds=3)
    benchmark.extra_info.update(relative_error=float(found.residual), iterations=int(found.steps))
