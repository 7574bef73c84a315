"""A third of a ring of detectors, its data of shapes, and images of them in three ways."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from network import Unrolled
from shapes import Strokes, drawn, halved

import jaxtat

NOISE = 0.05  # standard deviation, of the data's root mean square
ALPHAS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)


class Problem(NamedTuple):
    """A setup, its operators in single precision, and the operator on half the spacing."""

    setup: jaxtat.Setup
    A: Callable
    transposed: Callable
    fine: Callable
    fine_grid: jaxtat.ImageGrid
    weight: Array
    inside: np.ndarray


class Examples(NamedTuple):
    """Noisy data, the true images, and the standard deviation of each one's noise."""

    g: np.ndarray
    truth: np.ndarray
    sigma: np.ndarray


def problem(pixels: int, n_detectors: int) -> Problem:
    """A third of a circle, open towards x_1 > 0, and the whole disk within it."""
    curve, region = jaxtat.circular_arc(1.3, -0.65, n_detectors), jaxtat.disk(1.0)
    grid, fine_grid = jaxtat.ImageGrid(pixels), jaxtat.ImageGrid(2 * pixels - 1)
    setup = jaxtat.Setup(curve, region, grid)
    A = jaxtat.forward_operator(setup, dtype=jnp.float32)
    fine = jaxtat.forward_operator(jaxtat.Setup(curve, region, fine_grid, setup.radii))
    weight = jnp.asarray(1 / np.asarray(setup.radii), jnp.float32)
    inside = np.asarray(region.contains(grid.points))
    return Problem(setup, A, A.T, fine, fine_grid, weight, inside)


def examples(
    of: Problem, kind: Callable[[np.random.Generator], Strokes], n: int, seed: int
) -> Examples:
    """Data from images of half the spacing: what reconstructs is not what simulated."""
    rng = np.random.default_rng(seed)
    fine = np.stack([drawn(kind(rng), of.fine_grid) for _ in range(n)])
    exact = np.asarray(of.fine(fine))
    sigma = NOISE * np.sqrt((exact**2).mean(axis=(1, 2)))
    g = exact + sigma[:, None, None] * rng.standard_normal(exact.shape)
    truth = np.stack([halved(image) for image in fine])
    return Examples(g.astype(np.float32), truth.astype(np.float32), sigma)


def best_alpha(of: Problem, known: Examples) -> float:
    """Tikhonov's, by which direct images of known shapes err least."""
    return min(ALPHAS, key=lambda alpha: errors(direct_images(of, known.g, alpha), known).mean())


def direct_images(of: Problem, g: np.ndarray, alpha: float) -> np.ndarray:
    # named: with another inversion the network has another start, and other figures
    data = np.asarray(g, float)
    found = np.asarray(jaxtat.reconstruct(of.setup, data, alpha, inversion="fbp"))
    return np.where(of.inside, found, 0.0).astype(np.float32)


def model_based_images(of: Problem, some: Examples) -> np.ndarray:
    """Total variation and f >= 0, its weight from the noise of each record."""
    options = {"nonnegative": True}
    pairs = zip(some.g.astype(float), some.sigma, strict=True)
    found = [jaxtat.model_based(of.setup, g, noise=s, **options).image for g, s in pairs]
    return np.stack(found).astype(np.float32)


def learned_images(of: Problem, network: Unrolled, direct: Array, g: Array) -> Array:
    return of.inside * network(direct, g, of.A, of.transposed, of.weight)


def errors(images: np.ndarray, some: Examples) -> np.ndarray:
    """Relative L2, of each image; below zero they are cut off, for nothing shines so."""
    left = np.maximum(images, 0.0) - some.truth
    return np.linalg.norm(left, axis=(1, 2)) / np.linalg.norm(some.truth, axis=(1, 2))
