"""Images from data on radii that are not equispaced, against exact bells.

    python benchmarks/robustness/irregular_radii.py --seeds 3

Prints the largest error of the image in the region, bells of height 1: the radii are moved by up to
so many per cent of a step either way, or have steps that grow from the first to the last by a
factor; as many radii as the pixels suggest, and twice as many.
"""

import argparse

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from jaxtat import ImageGrid, Setup, circular_arc, data_radii, disk, phantoms, solve  # noqa: E402

CENTERS = [[0.3, 0.3], [-0.4, 0.2]]


def moved(radii: np.ndarray, jitter: float, rng: np.random.Generator) -> np.ndarray:
    """Radii moved at random by up to ``jitter`` steps, but for the first and the last."""
    off = rng.uniform(-jitter, jitter, len(radii)) * (radii[1] - radii[0])
    off[[0, -1]] = 0
    return radii + off


def graded(radii: np.ndarray, factor: float) -> np.ndarray:
    """As many radii over the same range, steps growing smoothly to ``factor`` times the first."""
    x = np.linspace(0.0, 1.0, len(radii))
    share = np.expm1(x * np.log(factor)) / (factor - 1)
    return radii[0] + (radii[-1] - radii[0]) * share


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="of the jitter; the worst is printed")
    parser.add_argument("--pixels", type=int, default=129)
    chosen = parser.parse_args()
    grid = ImageGrid(chosen.pixels)
    pixel = float(grid.spacing[0])
    curve, region = circular_arc(1.3, 1.0, 500), disk(1.0)
    inside = np.asarray(region.contains(grid.points))
    bells = {
        f"bells of {radius / pixel:.0f} pixels": phantoms.Bells(CENTERS, [radius] * 2)
        for radius in (0.5, 8 * pixel)
    }
    print(f"{chosen.pixels} x {chosen.pixels} pixels, alpha 1e-10 | default 1e-6")
    for name, phantom in bells.items():
        image = np.asarray(phantom.image(grid))
        for times in (1, 2):
            even = np.asarray(data_radii(curve, region, pixel / times))
            cases = {"equispaced": [even]}
            for jitter in (0.05, 0.1, 0.2, 0.3):
                seeds = map(np.random.default_rng, range(chosen.seeds))
                cases[f"jitter {jitter:.0%}"] = [moved(even, jitter, rng) for rng in seeds]
            cases |= {f"steps growing {f} fold": [graded(even, f)] for f in (1.5, 3.0)}
            for case, several in cases.items():
                setup = Setup(curve, region, grid, several[0])  # the same program for all
                found = []
                for alpha in (1e-10, None):
                    errors = []
                    for radii in several:
                        g = phantom.circular_integrals(curve, radii)
                        error = solve(setup.replace(radii=radii), g, alpha).image - image
                        errors.append(np.abs(error)[inside].max())
                    found.append(max(errors))
                print(
                    f"{name}, {len(even)} radii, {case}: {found[0]:.1e} | {found[1]:.1e}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
