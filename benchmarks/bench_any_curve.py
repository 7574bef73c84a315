"""Curves that are no arc, regions that are no disk: error on smooth bells, noise, and time.

At 129 x 129 pixels and 500 detectors, by `solve`. ``clean`` is the largest error with
kappa = 0.01 on exact data. With noise these are the relative L2 errors of `NoiseLevel`, which is
told its standard deviation, and of the default for noise of which nothing is known. A curve that
sees its region and one that a region pokes out of are timed.

Run as a script, with the names of cases or none for all, it prints the tables of docs/accuracy.md
for all of them, where the best of eleven fixed rules, chosen for each case by its own error, stands
beside.
"""

import sys
import time
import warnings
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from curve_cases import CASES

from jaxtat import (
    ImageGrid,
    NoiseLevel,
    RelativeTikhonov,
    Setup,
    VisibilityWarning,
    build_plan,
    phantoms,
    reconstruct,
    solve,
)
from jaxtat.geometry import visibility
from jaxtat.studies import pixel_standard_deviation, predict_noise

jax.config.update("jax_enable_x64", True)

N, DETECTORS = 129, 500
NOISE = (0.05, 0.15)
CLEAN, DEFAULT = RelativeTikhonov(0.01), None
# a number is alpha over the largest diagonal entry, or over 8 / lambda² on the boundary
FIXED = {f"kappa {x}": RelativeTikhonov(x) for x in (0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)}
FIXED |= {f"alpha {alpha}": alpha for alpha in (1e-2, 3e-2, 1e-1, 3e-1)}
LAW = ["ellipse, half disk", "jagged arc, disk", "two arcs, polygon"]  # of `predict_noise`
SEEN = "two arcs, polygon"
TIMED = [SEEN, "half circle, whole disk"]


class Trial:
    """A case, its exact and noisy data, and the setup that all of its images share."""

    def __init__(self, name: str):
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always", VisibilityWarning)
            self.setup, bells = CASES[name].setup(N, DETECTORS)
        self.flagged = bool(raised)
        curve, region, grid = self.setup.curve, self.setup.region, self.setup.grid
        g = bells.circular_integrals(curve, self.setup.radii)
        noise = [phantoms.noise_like(jax.random.key(k), g, x) for k, x in enumerate(NOISE)]
        self.data = jnp.stack([g, *(g + one for one in noise)])
        self.truth = np.asarray(bells.image(grid))
        self.inside = np.asarray(region.contains(grid.points))
        self.lost = float(visibility(curve, region).invisible_fraction)

    def misfit(self, rule, data=None):
        """Image less truth on the region's pixels: of exact data, and of both noises."""
        data = self.data if data is None else data
        found = solve(self.setup, data, rule)
        return (np.asarray(found.image) - self.truth)[:, self.inside]

    def relative(self, misfit):
        """Relative L2 errors."""
        return np.linalg.norm(misfit, axis=1) / np.linalg.norm(self.truth[self.inside])

    def with_known_noise(self):
        """Relative L2 errors with both noises, each image by itself."""
        noisy = self.data[1:]
        levels = [NoiseLevel(float(jnp.std(one - self.data[0]))) for one in noisy]
        found = [self.misfit(*pair) for pair in zip(levels, noisy[:, None], strict=True)]
        return self.relative(np.concatenate(found))


def _basis(setup: Setup) -> str:
    return "cylindrical" if setup.sizes.reached else "boundary"


@cache
def trial(name: str) -> Trial:
    return Trial(name)


def law_ratio(name: str) -> np.ndarray:
    """Exact standard deviations over predicted ones, on every eighth pixel of the inner region."""
    setup, few = trial(name).setup, ImageGrid(17, 0.96)
    inner = np.asarray(setup.region.level(few.points) < -0.1 * float(setup.region.reach))
    plan = build_plan(setup, RelativeTikhonov(0.1))
    exact = pixel_standard_deviation(plan, 1.0, grid=few, where=inner)
    law = predict_noise(setup, 1.0, grid=few)
    return np.asarray(exact / law)[inner]


def bench_clean(measure, benchmark):
    """Exact data of a region that is wholly seen."""
    case = trial(SEEN)
    assert not case.flagged
    data = case.data[0]
    measure(
        lambda: reconstruct(case.setup, data, CLEAN),
        n=N,
        error=lambda image: np.abs(np.asarray(image) - case.truth)[case.inside],
        rounds=1,
    )
    benchmark.extra_info.update(basis=_basis(case.setup))
    assert np.abs(case.misfit(CLEAN)[0]).max() <= 5e-4


@pytest.mark.parametrize("name", TIMED)
def bench_noise(measure, benchmark, name):
    """The default beside known noise; regions that poke out are flagged, and bounded."""
    case = trial(name)
    assert case.flagged != CASES[name].visible
    misfit = measure(lambda: case.misfit(DEFAULT), n=N, images=3, rounds=1)
    default = case.relative(misfit[1:])
    known = case.with_known_noise()
    assert (known < default).all()
    benchmark.extra_info.update(
        noise=NOISE,
        known=known.tolist(),
        default=default.tolist(),
        largest_error=float(np.abs(misfit[0]).max()),
    )


def print_case(name: str) -> None:
    """One row of the table."""
    case = trial(name)
    start = time.perf_counter()
    clean = case.misfit(CLEAN)
    middle = time.perf_counter()
    unknown = case.misfit(DEFAULT)
    seconds = time.perf_counter() - middle
    misfits = {label: case.misfit(rule) for label, rule in FIXED.items()}
    errors = {label: case.relative(misfit[1:]) for label, misfit in misfits.items()}
    known = case.with_known_noise()
    default, worst = case.relative(unknown[1:]), np.abs(unknown[0]).max()
    best = [min(errors, key=lambda label: errors[label][k]) for k in range(len(NOISE))]
    beside = " | ".join(
        f"{known[k]:.3f} / {default[k]:.3f} / {errors[label][k]:.3f} ({label})"
        for k, label in enumerate(best)
    )
    print(
        f"| {name} | {_basis(case.setup)} | {100 * case.lost:.1f} % | {np.abs(clean[0]).max():.1e} "
        f"| {worst:.1e} | {beside} |  # compiled {middle - start:.0f} s, again {seconds:.1f} s",
        flush=True,
    )


def print_law(name: str) -> None:
    ratio = law_ratio(name)
    low, middle, high = np.percentile(ratio, [5, 50, 95])
    print(f"| {name} | {middle:.3f} | {low:.3f} to {high:.3f} | {ratio.size} pixels", flush=True)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or CASES:
        print_case(chosen)
        if chosen in LAW:
            print_law(chosen)
        trial.cache_clear()
