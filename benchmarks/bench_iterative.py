"""Iterations with the forward operator, which users know, beside jaxtat's own reconstruction.

The same data for all: the paper's size, exact or with 5 % of white noise, of the smooth phantom and
of disks, whose edges are what total variation is for. Iterations know the region too. Where noise
asks for a choice, the number of steps and the weight are, of a few tried, those closest to the
phantom, which in practice nobody knows; alpha of the direct reconstruction knows the noise's size.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import problem

from jaxtat import NoiseLevel, build_plan, cosine_filter, phantoms, reconstruct
from jaxtat.studies import least_squares, total_variation

DISKS = phantoms.Disks(
    [[0, 0], [0.2, 0.35], [-0.35, -0.1], [0.3, -0.4]], [0.8, 0.25, 0.15, 0.2], [1, 0.5, -0.5, 1]
)
KINDS = ("bells", "bells-noise", "disks-noise")
# steps of conjugate gradients, weight of the variation
STEPS = {"bells": 20, "bells-noise": 4, "disks-noise": 6}
WEIGHTS = {"bells": 1e-6, "bells-noise": 1e-2, "disks-noise": 5e-2}


@pytest.fixture(scope="module", params=KINDS)
def case(request):
    """(name, problem, phantom, data, standard deviation of the noise)."""
    given = problem(129)
    phantom = given.phantom if request.param.startswith("bells") else DISKS
    g = phantom.circular_integrals(given.setup.curve, given.setup.radii)
    noise = phantoms.noise_like(jax.random.key(0), g, 0.05 if "noise" in request.param else 0.0)
    return request.param, given, phantom, g + noise, float(noise.std())


@pytest.fixture
def compare(measure, benchmark, case):
    """Measure ``work() -> (image, iterations)``: largest and relative error in the region."""
    _, given, phantom, _, _ = case
    inside = np.asarray(given.setup.region.contains(given.setup.grid.points))
    truth = np.asarray(phantom.image(given.setup.grid))[inside]

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


def bench_reconstruction_with_plan(compare, case):
    _, given, _, g, sigma = case
    plan = build_plan(given.setup)
    low_pass = cosine_filter if sigma else None
    compare(lambda: (reconstruct(plan, g, low_pass=low_pass), 0), rounds=7)


def bench_conjugate_gradients(compare, case):
    name, given, _, g, _ = case

    def work(max_steps=STEPS[name]):
        found = least_squares(given.setup, g, max_steps=max_steps)
        return found.image, found.iterations

    compare(work, rounds=1, compiles=lambda: work(1))


def bench_total_variation(compare, case):
    name, given, _, g, _ = case

    def work(tolerance=1e-4):
        found = total_variation(
            given.setup,
            g,
            jnp.asarray(WEIGHTS[name]),
            tolerance=tolerance,
            max_steps=50,
        )
        return found.image, found.iterations

    compare(work, rounds=1, compiles=lambda: work(1e6))
