"""Volumes from a spherical cap: all five steps by size, the hemisphere, and derivatives."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from jaxtat import NoiseLevel, VolumeGrid
from jaxtat.phantoms import noise_like
from jaxtat.spherical import (
    Bells,
    SphericalCap,
    back_projection,
    ball,
    cap_layout,
    cap_radii,
    solve,
    spherical_cap,
)

DETECTORS = {33: (48, 128), 65: (96, 256), 129: (192, 512), 257: (384, 1024)}


@dataclass(frozen=True)
class CapProblem:
    """R_g = 1.3, R = 1; bells inside the ball, or inside its lower half."""

    cap: SphericalCap
    region: BallPart
    grid: VolumeGrid
    radii: Array
    phantom: Bells
    g: Array

    @property
    def where(self) -> tuple:
        return self.cap, self.region, self.grid, self.radii

    def error(self, volume: Array, below: float = np.inf) -> float:
        """Largest over the voxels of the region with x_3 < below."""
        points = np.asarray(self.grid.points)
        inside = np.asarray(self.region.contains(self.grid.points)) & (points[..., 2] < below)
        return float(np.abs(np.asarray(volume - self.phantom.volume(self.grid)))[inside].max())


def cap_problem(n: int, top: float = 1.0) -> CapProblem:
    """n^3 voxels on [-1, 1]^3; a cap up to z_3 = top, where the region ends too if it is cut."""
    cap, grid, ball = spherical_cap(1.3, top, *DETECTORS[n]), VolumeGrid(n), ball(1.0)
    centers, sizes = [[0.15, 0.2, 0.25], [-0.25, -0.1, -0.3], [0.1, -0.35, 0.3]], [0.6, 0.55, 0.4]
    region, bells = ball, Bells(centers, sizes, [1.0, 1.0, -0.5])
    if top < 1.0:
        region = ball(1.0, top)
        bells = Bells([[0.1, 0.15, -0.5], [-0.3, -0.2, -0.48]], [0.45, 0.4])
    radii = cap_radii(cap, region, grid.spacing[0] / 2, sources=ball)
    return CapProblem(cap, region, grid, radii, bells, bells.spherical_integrals(cap, radii))


@pytest.mark.parametrize("n", [33, 65, 129, 257])
def bench_cap(measure, n):
    case = cap_problem(n)
    measure(
        lambda: solve(Setup(*case.where), case.g, 1e-8, inversion="fourier").volume,
        n=n,
        error=case.error,
        rounds=3 if n < 257 else 1,
    )


@pytest.mark.parametrize("method", ["jaxtat", "back-projection"])
def bench_cap_noise(measure, benchmark, method):
    """5 % noise, its size known."""
    case = cap_problem(65)
    g = case.g + noise_like(jax.random.key(0), case.g, 0.05)
    sigma = jnp.std(g - case.g)

    def work():
        if method == "jaxtat":
            return solve(Setup(*case.where), g, NoiseLevel(sigma), inversion="fourier").volume
        return back_projection(case.cap, case.radii, g, case.grid.points)

    found = measure(work, n=65, error=case.error, rounds=1)
    inside = np.asarray(case.region.contains(case.grid.points))
    truth = np.asarray(case.phantom.volume(case.grid))[inside]
    error = np.linalg.norm(np.asarray(found)[inside] - truth) / np.linalg.norm(truth)
    benchmark.extra_info.update(relative_error=float(error))


@pytest.mark.parametrize("n", [33, 65])
def bench_hemisphere(measure, n):
    """The region is the lower half ball; errors are those of x_3 < -0.1."""
    case = cap_problem(n, top=0.0)
    measure(
        lambda: solve(Setup(*case.where), case.g, 1e-8, inversion="fourier").volume,
        n=n,
        error=lambda volume: case.error(volume, below=-0.1),
        rounds=1,
    )


@pytest.mark.parametrize("what", ["value", "gradient"])
def bench_cap_loss_of_sound_speed_and_alpha(measure, what):
    """The squared error, and its derivatives in (c, alpha, g)."""
    case = cap_problem(33)
    layout = cap_layout(*case.where)
    truth = case.phantom.volume(case.grid)

    def loss(speed, alpha, g):
        where = case.cap, case.region, case.grid, speed * case.radii
        found = solve(Setup(*where), g, alpha, inversion="fourier")
        return jnp.sum((found.volume - truth) ** 2)

    compiled = jax.jit(loss if what == "value" else jax.value_and_grad(loss, (0, 1, 2)))
    measure(lambda: compiled(jnp.array(1.001), jnp.array(1e-6), case.g), n=33, rounds=3)
