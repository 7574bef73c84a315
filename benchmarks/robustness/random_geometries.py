"""Images of exact bells in random geometries: is every one that fails announced?

    python benchmarks/robustness/random_geometries.py --number 200 --seed 1000

Arcs of 30 to 360 degrees, ellipses, lines, L, U, pairs of arcs and scattered positions, in order
and permuted, 8 to 600 detectors, regions and pixels of many sizes. An image has failed if, in that
part of the region of which every edge is recorded, it is off by more than 5 % of the bells' height,
both from the bells and from the best image of the frequencies in use. A silent failure is one
without a warning; a false alarm an AccuracyWarning about an image that is within 5 % of the latter.
Where every edge of no pixel is recorded there is nothing to compare, and so no verdict.
"""

import argparse
import warnings
from collections import Counter
from dataclasses import dataclass

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from jaxtat import (  # noqa: E402
    AccuracyWarning,
    ImageGrid,
    Setup,
    VisibilityWarning,
    circular_arc,
    data_radii,
    detector_curve,
    disk,
    elliptic_arc,
    phantoms,
    polyline,
    solve,
)
from jaxtat.geometry import (  # noqa: E402
    DetectorCurve,
    Region,
    join_curves,
    visibility_map,
)
from jaxtat.steps.inversion import invert  # noqa: E402

DETECTORS = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 300, 600)
HARM = 0.05  # of the bells' height


@dataclass(frozen=True)
class Problem:
    """A geometry, its data and what is asked for."""

    kind: str
    curve: DetectorCurve
    region: Region
    grid: ImageGrid
    radii: np.ndarray
    phantom: phantoms.Bells
    alpha: float | None
    max_frequency: float | None


@dataclass(frozen=True)
class Outcome:
    """How an image came out: largest errors in the visible part, over the height of the bells."""

    error: float
    beyond_resolution: float
    warned: frozenset[type]

    @property
    def failed(self) -> bool:
        return min(self.error, self.beyond_resolution) > HARM

    @property
    def verdict(self) -> str:
        if self.failed:
            return "failed, warned" if self.warned else "SILENT FAILURE"
        if AccuracyWarning in self.warned and self.beyond_resolution < HARM:
            return "false alarm"
        return "good, warned" if self.warned else "good"


def draw(seed: int) -> Problem:
    """A random problem. ValueError where the geometry is refused."""
    rng = np.random.default_rng(seed)
    kind = rng.choice(["arc", "ring", "ellipse", "polyline", "two arcs", "scattered", "permuted"])
    n = int(rng.choice(DETECTORS))
    curve = _curve(str(kind), n, rng)
    reach = rng.uniform(0.3, 1.0)
    cut = None if rng.random() < 0.5 else rng.uniform(-0.3, 1.0) * reach
    angle = float(getattr(curve, "angle", 0.0))  # an arc opens where its region is cut
    region = disk(reach, cut, angle=angle)
    grid = ImageGrid(int(rng.choice([25, 33, 49, 65])), reach)
    pixel = float(grid.spacing[0])
    radii = np.array(data_radii(curve, region, pixel / rng.choice([1, 1, 2])))
    if rng.random() < 0.25:
        radii[1:-1] += rng.uniform(-0.2, 0.2, len(radii) - 2) * (radii[1] - radii[0])
    wanted = np.pi / np.diff(radii).max() * 2 if rng.random() < 0.1 else None
    alpha = [None, None, 1e-10, 1e-3][rng.integers(4)]
    return Problem(str(kind), curve, region, grid, radii, _bells(region, pixel, rng), alpha, wanted)


def _curve(kind: str, n: int, rng: np.random.Generator) -> DetectorCurve:
    turned = rng.uniform(0, 2 * np.pi)
    span = np.radians(rng.uniform(30, 360))
    arc = circular_arc(1.3, -1.3 * np.cos(span / 2), n, angle=turned)
    if kind == "ring":
        return circular_arc(1.3, 1.3, n)
    if kind == "ellipse":
        start, stop = turned, turned + np.radians(rng.uniform(90, 360))
        return elliptic_arc((rng.uniform(1.3, 2.0), 1.3), n, start=start, stop=stop)
    if kind == "polyline":
        corners = [(1.2, 1.2), (-1.2, 1.2), (-1.2, -1.2), (1.2, -1.2)]
        return polyline(corners[: rng.integers(2, 5)], n)
    if kind == "two arcs":
        cut = 1.3 * np.cos(np.radians(180 - rng.uniform(15, 85)))
        return join_curves(*(circular_arc(1.3, cut, n // 2, angle=a) for a in (0.0, np.pi)))
    if kind == "scattered":
        points = np.asarray(arc.points)
        off = rng.choice([0.002, 0.01, 0.03]) * rng.standard_normal((n, 2))
        return detector_curve(points + off, closed=False, smooth=max(3, n // 40))
    if kind == "permuted":
        return detector_curve(np.asarray(arc.points)[rng.permutation(n)])  # refused
    return arc


def _bells(region: Region, pixel: float, rng: np.random.Generator) -> phantoms.Bells:
    """Up to 12 alike, of 2.5 to 12 pixels' radius, within the region."""
    reach = float(region.reach)
    radius = pixel * rng.uniform(2.5, 12)
    rim = radius * np.exp(2j * np.pi * np.arange(16) / 16)
    centers = []
    for center in rng.uniform(-reach, reach, (500, 2)):
        points = center + np.stack([rim.real, rim.imag], axis=-1)
        if np.asarray(region.contains(jax.numpy.asarray(points))).all():
            centers.append(center)
    if not centers:
        raise ValueError("no bell fits into the region")
    centers = centers[: rng.integers(1, 13)]
    return phantoms.Bells(centers, np.full(len(centers), radius))


def judge(problem: Problem) -> Outcome:
    """Reconstruct, compare, and note what was warned of."""
    p = problem
    g = p.phantom.circular_integrals(p.curve, p.radii)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # one group of frequencies compiles soonest
        setup = Setup(
            p.curve, p.region, p.grid, p.radii, max_frequency=p.max_frequency, _n_groups=1
        )
        found = solve(setup, g, p.alpha)
    kinds = AccuracyWarning, VisibilityWarning
    warned = {kind for kind in kinds if any(issubclass(w.category, kind) for w in caught)}
    frequencies, angles = setup.frequencies, setup.sizes.angles
    fhat = p.phantom.fourier(np.append(0.0, frequencies), angles)
    eta = jax.numpy.ones(len(frequencies) + 1)
    center = p.region.center  # the origin, as fhat's
    best = np.asarray(invert(fhat, frequencies[0], angles, p.grid, center, eta, "fbp"))
    image, exact = np.asarray(found.image), np.asarray(p.phantom.image(p.grid))
    seen = np.asarray(visibility_map(setup.curve, setup.grid, least=0.5)) == 1
    seen &= np.asarray(p.region.contains(p.grid.points))
    if not seen.any():
        raise ValueError("nowhere in the region every edge is recorded")
    height = np.abs(exact).max()

    def worst(of: np.ndarray) -> float:
        return float(np.abs(image - of)[seen].max() / height)

    return Outcome(worst(exact), worst(best), frozenset(warned))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    chosen = parser.parse_args()
    verdicts: dict[str, Counter] = {}
    for seed in range(chosen.seed, chosen.seed + chosen.number):
        try:
            problem = draw(seed)
            outcome = judge(problem)
        except ValueError as error:
            print(f"{seed}: refused: {error}", flush=True)
            verdicts.setdefault("any", Counter())["refused"] += 1
            continue
        verdicts.setdefault(problem.kind, Counter())[outcome.verdict] += 1
        names = ", ".join(sorted(kind.__name__ for kind in outcome.warned)) or "nothing"
        print(
            f"{seed}: {problem.kind}, {problem.curve.n_detectors} detectors, "
            f"{problem.grid.shape[0]} pixels, alpha {problem.alpha}: off by {outcome.error:.3f}, "
            f"{outcome.beyond_resolution:.3f} beyond resolution; {names}: {outcome.verdict}",
            flush=True,
        )
        if seed % 20 == 19:
            jax.clear_caches()  # every geometry is a program of its own
    columns = sorted({verdict for counts in verdicts.values() for verdict in counts})
    print(f"\n| curve | {' | '.join(columns)} |\n| --- |{' ---: |' * len(columns)}")
    for kind, counts in sorted(verdicts.items()):
        print(f"| {kind} | {' | '.join(str(counts[c]) for c in columns)} |")
    total = sum(verdicts.values(), Counter())
    print(f"| all | {' | '.join(str(total[c]) for c in columns)} |")


if __name__ == "__main__":
    main()
