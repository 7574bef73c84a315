"""Images with constraints beside the direct reconstruction of the same data.

The paper's size, exact or with 5 or 15 % of white noise, of the smooth phantom and of disks, whose
edges are what total variation is for. Iterations know the region too. The number of steps of
conjugate gradients is, of a few tried, that closest to the disks, which in practice nobody knows;
alpha of the direct reconstruction and the weight of the variation follow from the noise's size.
Errors are against means over pixels.
"""

import jax
import numpy as np
import pytest
from problems import problem

from jaxtat import NoiseLevel, Setup, model_based, phantoms, reconstruct
from jaxtat.fitting import NoPenalty

DISKS = phantoms.Disks(
    [[0.3, 0.25], [-0.4, 0.1], [-0.1, -0.45], [0.35, -0.4], [0.05, 0.1], [-0.35, 0.55]],
    [0.28, 0.2, 0.25, 0.12, 0.08, 0.1],
    [1.0, 0.7, 1.3, 0.9, 1.5, 1.0],
)
KINDS = {"bells": 0.0, "disks-5": 0.05, "disks-15": 0.15}  # noise
STEPS = 10  # of conjugate gradients


@pytest.fixture(scope="module", params=KINDS)
def case(request):
    """(name, problem, phantom, data, standard deviation of the noise)."""
    given = problem(129)
    phantom = given.phantom if request.param.startswith("bells") else DISKS
    g = phantom.circular_integrals(given.setup.curve, given.setup.radii)
    noise = phantoms.noise_like(jax.random.key(0), g, KINDS[request.param])
    return request.param, given, phantom, g + noise, float(noise.std())


def pixel_means(phantom, grid, n=8):
    """Of n x n points in each pixel."""
    steps = ((np.arange(n) + 0.5) / n - 0.5) * np.asarray(grid.spacing)[:, None]
    shifts = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.mean([np.asarray(phantom(grid.points + shift)) for shift in shifts], axis=0)


@pytest.fixture
def compare(measure, benchmark, case):
    """Measure ``work() -> (image, iterations)``: largest and relative error in the region."""
    _, given, phantom, _, _ = case
    inside = np.asarray(given.setup.region.contains(given.setup.grid.points))
    truth = pixel_means(phantom, given.setup.grid)[inside]

    def run(work, rounds, compiles=None):
        image, iterations = measure(
            work,
            n=129,
            error=lambda found: np.abs(np.asarray(found[0])[inside] - truth),
            rounds=rounds,
            compiles=compiles,
        )
        error = np.linalg.norm(np.asarray(image)[inside] - truth) / np.linalg.norm(truth)
        benchmark.extra_info.update(relative_error=float(error), iterations=int(iterations))

    return run


def bench_direct_reconstruction(compare, case):
    _, given, _, g, sigma = case
    alpha = NoiseLevel(sigma) if sigma else 1e-12
    compare(lambda: (reconstruct(given.setup, g, alpha), 0), rounds=5)


@pytest.mark.parametrize("case", ["disks-5"], indirect=True)
def bench_conjugate_gradients(compare, case):
    _, given, _, g, _ = case

    def work(max_steps=STEPS):
        found = model_based(given.setup, g, penalty=NoPenalty(), max_steps=max_steps)
        return found.image, found.steps

    compare(work, rounds=3, compiles=lambda: work(1))


def bench_total_variation(compare, case):
    """In float32 where there is noise."""
    _, given, _, g, sigma = case
    dtype = "float32" if sigma else "float64"

    def work():
        found = model_based(given.setup, g, noise=sigma or None, nonnegative=True, dtype=dtype)
        return found.image, found.steps

    compare(work, rounds=3)


@pytest.mark.parametrize("case", ["disks-5"], indirect=True)
def bench_total_variation_on_finer_pixels(compare, case):
    """Half as wide, in float32; the image is their means."""
    _, given, _, g, sigma = case
    setup, grid = given.setup, given.setup.grid
    fine = Setup(setup.curve, setup.region, grid.finer(2), setup.radii)

    def work():
        found = model_based(fine, g, noise=sigma, nonnegative=True, dtype="float32")
        return grid.means(found.image), found.steps

    compare(work, rounds=3)
