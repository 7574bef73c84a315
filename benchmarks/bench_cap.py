"""Volumes from a spherical cap: all five steps by size, the hemisphere, and derivatives."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from jaxtat import NoiseLevel, Setup, VolumeGrid, reconstruct
from jaxtat.phantoms import noise_like
from jaxtat.spherical import SolidBells, back_projection, ball, cap_radii, spherical_cap

DETECTORS = {33: (48, 128), 65: (96, 256), 129: (192, 512)}


@dataclass(frozen=True)
class CapProblem:
    """R_g = 1.3, R = 1; bells inside the ball, or inside its lower half."""

    setup: Setup
    phantom: SolidBells
    g: Array

    def error(self, volume: Array, below: float = np.inf) -> float:
        """Largest over the voxels of the region with x_3 < below."""
        grid = self.setup.grid
        points = np.asarray(grid.points)
        inside = np.asarray(self.setup.region.contains(grid.points)) & (points[..., 2] < below)
        return float(np.abs(np.asarray(volume - self.phantom.volume(grid)))[inside].max())


def cap_problem(n: int, top: float = 1.0) -> CapProblem:
    """n^3 voxels on [-1, 1]^3; a cap up to z_3 = top, where the region ends too if it is cut."""
    cap, grid, whole = spherical_cap(1.3, top, *DETECTORS[n]), VolumeGrid(n), ball(1.0)
    centers, sizes = [[0.15, 0.2, 0.25], [-0.25, -0.1, -0.3], [0.1, -0.35, 0.3]], [0.6, 0.55, 0.4]
    region, bells = whole, SolidBells(centers, sizes, [1.0, 1.0, -0.5])
    if top < 1.0:
        region = ball(1.0, top)
        bells = SolidBells([[0.1, 0.15, -0.5], [-0.3, -0.2, -0.48]], [0.45, 0.4])
    radii = cap_radii(cap, region, grid.spacing[0] / 2, sources=whole)
    setup = Setup(cap, region, grid, radii)
    return CapProblem(setup, bells, bells.spherical_integrals(cap, setup.radii))


@pytest.mark.parametrize("n", [33, 65, 129])
def bench_cap(measure, n):
    case = cap_problem(n)
    measure(
        lambda: reconstruct(case.setup, case.g, 1e-8, inversion="fourier"),
        n=n,
        error=case.error,
        rounds=3,
    )


@pytest.mark.parametrize("method", ["jaxtat", "back-projection"])
def bench_cap_noise(measure, benchmark, method):
    """5 % noise, its size known."""
    case = cap_problem(33)
    setup = case.setup
    g = case.g + noise_like(jax.random.key(0), case.g, 0.05)
    sigma = jnp.std(g - case.g)

    def work():
        if method == "jaxtat":
            return reconstruct(case.setup, g, NoiseLevel(sigma), inversion="fourier")
        return back_projection(setup.curve, setup.radii, g, setup.grid.points)

    found = measure(work, n=33, error=case.error, rounds=1)
    inside = np.asarray(setup.region.contains(setup.grid.points))
    truth = np.asarray(case.phantom.volume(case.setup.grid))[inside]
    error = np.linalg.norm(np.asarray(found)[inside] - truth) / np.linalg.norm(truth)
    benchmark.extra_info.update(relative_error=float(error))


def bench_hemisphere(measure):
    """The region is the lower half ball; errors are those of x_3 < -0.1."""
    case = cap_problem(65, top=0.0)
    measure(
        lambda: reconstruct(case.setup, case.g, 1e-8, inversion="fourier"),
        n=65,
        error=lambda volume: case.error(volume, below=-0.1),
        rounds=1,
    )


@pytest.mark.parametrize("what", ["value", "gradient"])
def bench_cap_loss_of_sound_speed_and_alpha(measure, what):
    """The squared error, and its derivatives in (c, alpha, g)."""
    case = cap_problem(33)
    truth = case.phantom.volume(case.setup.grid)

    def loss(speed, alpha, g):
        setup = case.setup.replace(radii=speed * case.setup.radii)
        return jnp.sum((reconstruct(setup, g, alpha, inversion="fourier") - truth) ** 2)

    compiled = jax.jit(loss if what == "value" else jax.value_and_grad(loss, (0, 1, 2)))
    measure(lambda: compiled(jnp.array(1.001), jnp.array(1e-6), case.g), n=33, rounds=3)
