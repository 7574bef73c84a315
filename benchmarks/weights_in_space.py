"""How good the weight is that `model_based` finds for volumes, beside others.

Balls, bells and vessels drawn from seeds, on a grid three times finer than the volume's: their data
are those of the fine grid, the true volume is the mean over each voxel. Detectors on a cap, white
noise whose standard deviation is told, f >= 0 and total variation, float32. The best weight is that
of a scan, as in benchmarks/weights.py; errors are relative, in the 2-norm over the region. The
constants of jaxtat/fitting/weight.py for space were chosen on other such phantoms, in a
periodic model in which A^T A is c/|xi|² exactly.

    python benchmarks/weights_in_space.py [--seeds 11] [--noise 0.02 0.05 0.15] [--voxels 33]
"""

import argparse
import warnings
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from weights import best_weight, row

import jaxtat
from jaxtat.spherical import ball, cap_radii, spherical_cap

FINER = 3  # the phantom's voxels in one of the volume's, along an axis
Draw = Callable[[np.random.Generator, np.ndarray], np.ndarray]  # points along an axis -> volume


def squares(x: np.ndarray, center: np.ndarray) -> np.ndarray:
    """Squared distances of all nodes from a centre."""
    first, second, third = ((x - c) ** 2 for c in center)
    return first[:, None, None] + second[:, None] + third


def balls(rng: np.random.Generator, x: np.ndarray) -> np.ndarray:
    """Eight, which may overlap."""
    volume = np.zeros((len(x),) * 3)
    for _ in range(8):
        square = squares(x, rng.uniform(-0.45, 0.45, 3))
        volume += np.where(square < rng.uniform(0.05, 0.3) ** 2, rng.uniform(0.4, 1.4), 0.0)
    return volume


def bells(rng: np.random.Generator, x: np.ndarray) -> np.ndarray:
    """Seven smooth ones, (1 - d²/a²)³."""
    volume = np.zeros((len(x),) * 3)
    for _ in range(7):
        square = squares(x, rng.uniform(-0.45, 0.45, 3))
        volume += (
            rng.uniform(0.4, 1.4) * np.maximum(1 - square / rng.uniform(0.1, 0.35) ** 2, 0) ** 3
        )
    return volume


def vessels(rng: np.random.Generator, x: np.ndarray) -> np.ndarray:
    """Nine winding ones, of radii 0.03 to 0.07."""
    volume = np.zeros((len(x),) * 3)
    for _ in range(9):
        place, way = rng.uniform(-0.5, 0.5, 3), rng.standard_normal(3)
        width, height = rng.uniform(0.03, 0.07), rng.uniform(0.4, 1.3)
        for _ in range(60):
            way = way / np.linalg.norm(way)
            part = tuple(slice(*np.searchsorted(x, [c - width, c + width])) for c in place)
            first, second, third = ((x[s] - c) ** 2 for s, c in zip(part, place, strict=True))
            near = first[:, None, None] + second[:, None] + third < width**2
            volume[part] = np.where(near, np.maximum(volume[part], height), volume[part])
            place, way = place + 0.02 * way, way + 0.15 * rng.standard_normal(3)
    return volume


KINDS: dict[str, Draw] = {f.__name__: f for f in (balls, bells, vessels)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--voxels", type=int, default=33)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--seeds", type=int, nargs="+", default=[11])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.02, 0.05, 0.15])
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)

    n = options.voxels
    curve = spherical_cap(1.3, 1.0, 3 * n // 2, 4 * n)
    region, grid = ball(1.0), jaxtat.VolumeGrid(n)
    setup = jaxtat.Setup(curve, region, grid, cap_radii(curve, region, grid.spacing[0] / 2))
    with warnings.catch_warnings():  # nothing is reconstructed from waves as short as these
        warnings.simplefilter("ignore", jaxtat.AccuracyWarning)
        fine = jaxtat.Setup(curve, region, grid.finer(FINER), setup.radii)
        forward = jaxtat.forward_operator(fine, dtype=jnp.float32)
    x, edge = np.asarray(fine.grid.x1), np.linalg.norm(np.asarray(fine.grid.points), axis=-1) < 0.95
    inside = np.asarray(region.contains(grid.points))

    def errors(
        truth: np.ndarray, g: jax.Array, sigma: float, weight: float | None
    ) -> tuple[float, float]:
        settings = {"weight": weight, "noise": sigma, "dtype": jnp.float32}
        found = jaxtat.model_based(setup, g, nonnegative=True, **settings)
        off = jnp.linalg.norm((found.image - truth)[inside]) / np.linalg.norm(truth[inside])
        return float(off), float(found.weight)

    print(options)
    columns = ["found weight", "its error", "best weight", "its error", "ratio"]
    print(row("phantom", "seed", "noise", *columns))
    print(row(*["---"] * (3 + len(columns))))
    for kind in options.kinds:
        for seed in options.seeds:
            volume = KINDS[kind](np.random.default_rng(seed), x) * edge
            truth = np.asarray(grid.means(volume))
            exact = forward.mv(volume).astype(float)
            for level in options.noise:
                noise = jaxtat.phantoms.noise_like(jax.random.key(seed), exact, level)
                case = truth, exact + noise, level * float(jnp.sqrt(jnp.mean(exact**2)))
                off, weight = errors(*case, None)
                best, least = best_weight(lambda w: errors(*case, w)[0], weight)  # noqa: B023
                values = [f"{weight:.3g}", f"{off:.4f}", f"{best:.3g}", f"{least:.4f}"]
                values.append(f"{off / least:.2f}")
                print(row(kind, seed, f"{100 * level:g} %", *values), flush=True)


if __name__ == "__main__":
    main()
