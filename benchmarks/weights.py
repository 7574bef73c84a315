"""How good the weight is that `model_based` finds from the noise, beside the best one.

Phantoms of five kinds, drawn from seeds, on a grid four times finer than the image's: their data
are those of the fine grid, the true image is the mean over each pixel. 129 x 129 pixels, 500
detectors on three quarters of a circle, white noise whose standard deviation is told, f >= 0 and
total variation. The best weight is that of a scan which goes on by factors of two from the found
weight until the error grows again, and then by factors of √2. Errors are relative, in the
2-norm over the region. Seeds 0 and 3 were used to choose the constants of
jaxtat/fitting/weight.py: they prove nothing, and are not among the default ones.

    python benchmarks/weights.py [--seeds 1 2] [--noise 0.02 0.05 0.15] [--pixels 129]

With ``--penalties`` it prints the errors of all penalties instead, each with the weight it finds.
"""

import argparse
import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath

import jaxtat
from jaxtat.fitting import Ridge, SecondOrderVariation, TotalVariation

FINER = 4  # the phantom's pixels in one of the image's, along an axis
EDGE = 0.95  # of the region's radius: phantoms end there
PENALTIES = TotalVariation, SecondOrderVariation, Ridge
WORDS = ("photo acoustic", "open curve", "single layer", "cylindrical wave", "limited view")
Picture = Callable[[np.random.Generator, np.ndarray, int], np.ndarray]  # points, seed -> values


def disks(rng: np.random.Generator, points: np.ndarray, _: int) -> np.ndarray:
    """Eight, which may overlap."""
    image = np.zeros(points.shape[:-1])
    for _ in range(8):
        distance = np.linalg.norm(points - rng.uniform(-0.5, 0.5, 2), axis=-1)
        image += np.where(distance < rng.uniform(0.05, 0.3), rng.uniform(0.4, 1.4), 0.0)
    return image


def bells(rng: np.random.Generator, points: np.ndarray, _: int) -> np.ndarray:
    """Seven smooth ones, (1 - d²/a²)³: nothing that total variation is made for."""
    image = np.zeros(points.shape[:-1])
    for _ in range(7):
        distance = np.linalg.norm(points - rng.uniform(-0.5, 0.5, 2), axis=-1)
        inner = np.maximum(1 - (distance / rng.uniform(0.1, 0.35)) ** 2, 0.0)
        image += rng.uniform(0.4, 1.4) * inner**3
    return image


def vessels(rng: np.random.Generator, points: np.ndarray, _: int) -> np.ndarray:
    """Nine winding ones, two to five pixels wide."""
    image = np.zeros(points.shape[:-1])
    for _ in range(9):
        place, angle = rng.uniform(-0.6, 0.6, 2), rng.uniform(0, 2 * np.pi)
        width, height = rng.uniform(0.012, 0.04), rng.uniform(0.4, 1.3)
        for _ in range(70):
            near = np.linalg.norm(points - place, axis=-1) < width
            image = np.where(near, np.maximum(image, height), image)
            place = place + 0.018 * np.array([np.cos(angle), np.sin(angle)])
            angle += 0.18 * rng.standard_normal()
    return image


def text(_: np.random.Generator, points: np.ndarray, seed: int) -> np.ndarray:
    """Two words, one below the other; each of the first five seeds has its own."""
    font = FontProperties(family="DejaVu Sans", weight="bold")
    inside = np.zeros(points.shape[:-1], bool)
    for line, word in enumerate(WORDS[seed % len(WORDS)].split()):
        letters = TextPath((0, 0), word, size=0.28, prop=font)
        vertices = letters.vertices - letters.vertices.mean(axis=0) + [0, 0.2 - 0.4 * line]
        for outline in Path(vertices, letters.codes).to_polygons():  # of letters, and of holes
            inside ^= Path(outline).contains_points(points.reshape(-1, 2)).reshape(inside.shape)
    return inside.astype(float)


def texture(rng: np.random.Generator, points: np.ndarray, _: int) -> np.ndarray:
    """As in photographs: the amplitude falls as |frequency|^-1.6, all phases are alike."""
    n = points.shape[0]
    frequency = np.hypot(*np.meshgrid(n * np.fft.fftfreq(n), n * np.fft.fftfreq(n)))
    frequency[0, 0] = 1.0
    kept = frequency ** (-1.6) * (frequency < n / (2 * FINER))
    image = np.fft.ifft2(kept * np.fft.fft2(rng.standard_normal((n, n)))).real
    image = (image - image.min()) / np.ptp(image)
    return image * np.clip((0.9 - np.linalg.norm(points, axis=-1)) / 0.15, 0, 1)


KINDS: dict[str, Picture] = {f.__name__: f for f in (disks, bells, vessels, text, texture)}


def best_weight(error: Callable[[float], float], start: float) -> tuple[float, float]:
    """The weight with the least error, and that error: downhill on a scale of factors."""
    found = {start: error(start)}
    for factor in (2.0, 2**0.5):
        while True:
            best = min(found, key=found.__getitem__)
            new = [w for w in (best * factor, best / factor) if not _near(w, found)]
            if not new:
                break
            found |= {w: error(w) for w in new}
            if min(found, key=found.__getitem__) == best:
                break
    best = min(found, key=found.__getitem__)
    return best, found[best]


def _near(weight: float, found: dict[float, float]) -> bool:
    return any(abs(np.log(weight / other)) < 0.01 for other in found)


def row(*entries: object) -> str:
    """Of a table in Markdown."""
    return f"| {' | '.join(map(str, entries))} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--pixels", type=int, default=129)
    parser.add_argument("--detectors", type=int, default=500)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.02, 0.05, 0.15])
    parser.add_argument("--penalties", action="store_true", help="compare them")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)

    curve = jaxtat.circular_arc(1.3, 1.0, options.detectors)
    setup = jaxtat.Setup(curve, jaxtat.disk(1.0), jaxtat.ImageGrid(options.pixels))
    fine = FINER * options.pixels
    border = float(setup.grid.spacing[0]) / 2  # of the outermost pixels beyond their centres
    grid = jaxtat.ImageGrid(fine, (1 + border) * (1 - 1 / fine))
    highest = np.pi / float(grid.spacing[0])
    with warnings.catch_warnings():  # nothing is reconstructed from waves as short as these
        warnings.simplefilter("ignore", jaxtat.AccuracyWarning)
        forward = jaxtat.forward_operator(
            jaxtat.Setup(curve, setup.region, grid, setup.radii, max_frequency=highest)
        )
    points, inside = np.asarray(grid.points), setup.region.contains(setup.grid.points)

    def errors(
        truth: np.ndarray, g: jax.Array, sigma: float, weight: float | None, penalty: Any = None
    ) -> tuple[float, float, bool]:
        settings = {"penalty": penalty, "weight": weight, "dtype": jnp.float32}
        found = jaxtat.model_based(setup, g, nonnegative=True, noise=sigma, **settings)
        off = jnp.linalg.norm((found.image - truth)[inside]) / np.linalg.norm(truth[inside])
        return float(off), float(found.weight), bool(found.converged)

    print(options)
    columns = ["found weight", "its error", "best weight", "its error", "ratio"]
    if options.penalties:
        columns = [penalty.__name__ for penalty in PENALTIES]
    print(row("phantom", "seed", "noise", *columns))
    print(row(*["---"] * (3 + len(columns))))
    for kind, draw in KINDS.items():
        for seed in options.seeds:
            picture = draw(np.random.default_rng(seed), points, seed)
            picture = picture * (np.linalg.norm(points, axis=-1) < EDGE)
            truth = picture.reshape(options.pixels, FINER, options.pixels, FINER).mean((1, 3))
            exact = forward.mv(picture)
            for level in options.noise:
                noise = jaxtat.phantoms.noise_like(jax.random.key(seed), exact, level)
                g, sigma = exact + noise, level * float(jnp.sqrt(jnp.mean(exact**2)))
                case = truth, g, sigma
                if options.penalties:
                    each = [errors(*case, None, penalty())[0] for penalty in PENALTIES]
                    values = [f"{off:.4f}" for off in each]
                else:
                    off, weight, converged = errors(*case, None)
                    best, least = best_weight(lambda w: errors(*case, w)[0], weight)  # noqa: B023
                    values = [f"{weight:.3g}", f"{off:.4f}", f"{best:.3g}", f"{least:.4f}"]
                    values.append(f"{off / least:.2f}" + ("" if converged else ", not converged"))
                print(row(kind, seed, f"{100 * level:g} %", *values), flush=True)


if __name__ == "__main__":
    main()
