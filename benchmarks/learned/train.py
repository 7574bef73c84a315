"""Trains an unrolled network on vessels, and tries it on vessels and on shapes that are none.

    python benchmarks/learned/train.py [--steps 2000] [--out benchmarks/learned]

Writes results.json and, into docs/pictures, learned.png. Nothing is kept between runs. With the
numbers below it took the time that results.json says, on one core.
"""

import argparse
import json
import os
import platform
import time
import warnings
from datetime import date
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import shapes
from judged import judged, residuals
from network import Unrolled, n_parameters, trained
from problem import (
    Examples,
    Problem,
    best_alpha,
    direct_images,
    errors,
    examples,
    learned_images,
    model_based_images,
    problem,
)

import jaxtat
from jaxtat.geometry import visibility_map
from jaxtat.plotting import show_image

PIXELS, DETECTORS = 65, 64
ITERATIONS, CHANNELS = 5, 8
TRAINING, TRIED = 240, 24  # shapes
BATCH, RATE = 8, 3e-3
KINDS = {"vessels": shapes.vessels, "disks": shapes.disks, "rings": shapes.rings}
WAYS = ("direct", "model-based", "learned")
PICTURE = Path("docs/pictures/learned.png")


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=2000, help="of training")
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parent)
    options = parser.parse_args()
    with warnings.catch_warnings():
        # that some lines miss the curve is what this is about
        warnings.simplefilter("ignore", jaxtat.geometry.VisibilityWarning)
        of = problem(PIXELS, DETECTORS)
    known = examples(of, shapes.vessels, TRAINING, seed=0)
    alpha = best_alpha(of, Examples(*(part[:16] for part in known)))
    start = time.perf_counter()
    network, history = learned(of, known, alpha, options.steps)
    seconds = time.perf_counter() - start
    # other seeds than the training's: none of these shapes was seen
    tried = {
        name: examples(of, kind, TRIED, seed=1 + k) for k, (name, kind) in enumerate(KINDS.items())
    }
    images = {name: images_of(of, network, some, alpha) for name, some in tried.items()}
    seen = np.asarray(visibility_map(of.setup.curve, of.setup.grid))
    results = {
        "date": date.today().isoformat(),
        "versions": {"jaxtat": jaxtat.__version__, "jax": jax.__version__},
        "machine": f"{os.cpu_count()} cores, {platform.machine()}",
        "parameters": n_parameters(network),
        "training": {"shapes": TRAINING, "steps": options.steps, "seconds": seconds},
        "loss": {"first": float(np.mean(history[:20])), "last": float(np.mean(history[-20:]))},
        "alpha": alpha,
        "tried": {
            name: {way: figures(of, each, tried[name], seen) for way, each in found.items()}
            for name, found in images.items()
        },
        "residual_of_truth": {
            name: float(residuals(of, some.truth, some).mean()) for name, some in tried.items()
        },
    }
    text = json.dumps(results, indent=1) + "\n"
    (options.out / "results.json").write_text(text)
    print(text)
    draw(of, tried, images, seen)


def figures(of: Problem, images: np.ndarray, some: Examples, seen: np.ndarray) -> dict:
    """What is told of the images of one kind by one method."""
    return {
        "error": float(errors(images, some).mean()),
        "residual": float(residuals(of, images, some).mean()),
        "by_visibility": judged(images, some, seen, of.inside),
    }


def learned(of: Problem, known: Examples, alpha: float, steps: int) -> tuple[Unrolled, list[float]]:
    """The network after training, and its losses."""

    def loss(network: Unrolled, direct: jax.Array, g: jax.Array, truth: jax.Array) -> jax.Array:
        return jnp.mean((learned_images(of, network, direct, g) - truth) ** 2)

    network = Unrolled.drawn(np.random.default_rng(0), ITERATIONS, CHANNELS)
    parts = direct_images(of, known.g, alpha), known.g, known.truth
    return trained(network, loss, parts, batch=BATCH, steps=steps, rate=RATE, seed=0)


def images_of(
    of: Problem, network: Unrolled, some: Examples, alpha: float
) -> dict[str, np.ndarray]:
    direct = direct_images(of, some.g, alpha)
    by_network = jax.jit(lambda direct, g: learned_images(of, network, direct, g))
    return {
        "direct": direct,
        "model-based": model_based_images(of, some),
        "learned": np.asarray(by_network(direct, some.g)),
    }


def draw(
    of: Problem,
    tried: dict[str, Examples],
    images: dict[str, dict[str, np.ndarray]],
    seen: np.ndarray,
) -> None:
    """One shape of each kind, all images of it, and what the network made up."""
    figure, axes = plt.subplots(len(KINDS), 6, figsize=(9, 4.6), dpi=150, layout="constrained")
    plt.rcParams.update({"font.size": 7})
    blank = np.where(of.inside, 0.0, np.nan)
    for row, name in zip(axes, KINDS, strict=True):
        shown = {"truth": tried[name].truth[0]} | {way: images[name][way][0] for way in WAYS}
        for axis, (title, image) in zip(row, shown.items(), strict=False):
            show_image(axis, image + blank, of.setup.grid, limits=(0, 1), title=title)
        left = shown["learned"] - shown["truth"]
        options = {"limits": (-0.6, 0.6), "cmap": "RdBu_r"}
        show_image(row[4], left + blank, of.setup.grid, title="learned − truth", **options)
        options = {"limits": (0, 1), "cmap": "viridis"}
        show_image(row[5], seen + blank, of.setup.grid, title="share of edges seen", **options)
        for axis in row:
            axis.set_axis_off()
            axis.plot(*np.asarray(of.setup.curve.points).T / 1.3 * 1.06, ".", ms=1, color="tab:red")
            axis.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1))
    figure.savefig(PICTURE)


if __name__ == "__main__":
    main()
