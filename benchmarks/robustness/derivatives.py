"""Derivatives of public functions against central differences, in both modes.

Random small problems. Differences are extrapolated (Richardson) at several steps, of which the best
counts: an error that no step brings below 1e-6 is one of the derivative.

    python benchmarks/robustness/derivatives.py [seed]

prints a table; the exit code is 1 if something smooth is off by more than 1e-6.
"""

import sys
from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxtat import (
    ImageGrid,
    RelativeTikhonov,
    Setup,
    Tikhonov,
    build_plan,
    circular_arc,
    data_radii,
    detector_curve,
    disk,
    elliptic_arc,
    phantoms,
    problem_layout,
    reconstruct,
    solve,
)
from jaxtat.geometry import transverse_weight
from jaxtat.records import condition_record, pressure_to_circular_integrals
from jaxtat.studies import predict_noise

TOLERANCE = 1e-6
STEPS = (1e-3, 1e-4, 1e-5)
Case = tuple[str, Callable, np.ndarray]


def errors(function: Callable, at: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """Of forward mode against differences, and of reverse against forward mode; relative."""
    function, at = jax.jit(function), jnp.asarray(at, float)
    along = jnp.asarray(rng.normal(size=at.shape))
    value, slope = jax.jvp(function, (at,), (along,))
    test = jnp.asarray(rng.normal(size=value.shape))
    forward = float(jnp.vdot(test, slope))
    reverse = float(jnp.vdot(jax.vjp(function, at)[1](test)[0], along))
    size = float(jnp.abs(slope).max())
    best = np.inf
    for step in STEPS:
        wide, narrow = (
            np.asarray(function(at + h * along) - function(at - h * along)) / (2 * h)
            for h in (step, step / 2)
        )
        best = min(best, float(np.abs((4 * narrow - wide) / 3 - slope).max()))
    return best / size, abs(forward - reverse) / max(abs(forward), size)


def of_curves(rng: np.random.Generator) -> Iterator[Case]:
    regular = np.asarray(circular_arc(1.3, 0.3, 24).points)
    lines = jnp.asarray(rng.uniform(0, 3, 5)), jnp.asarray(rng.uniform(-0.5, 0.5, 5))
    for name, points in (
        ("regular", regular),
        ("scattered", regular + 0.01 * rng.normal(size=regular.shape)),
    ):
        yield (
            f"transverse_weight, {name} positions",
            lambda p: transverse_weight(detector_curve(p, closed=False), *lines),
            points,
        )
        yield (
            f"predict_noise, {name} positions",
            lambda p: predict_noise(
                detector_curve(p, closed=False), ImageGrid(4, 0.3), 1.0, radial_step=0.1
            ),
            points,
        )
    for name, ends in (
        ("any", rng.uniform((0, 3), (2, 6))),
        ("symmetric", (np.pi / 2, np.pi * 1.5)),
    ):
        for what in ("points", "weights", "normals"):
            yield (
                f"elliptic_arc, {name} ends, {what}",
                lambda s, what=what: getattr(
                    elliptic_arc((1.6, 1.2), 13, start=s[0], stop=s[1]), what
                ),
                np.asarray(ends),
            )


def of_records(rng: np.random.Generator) -> Iterator[Case]:
    times = jnp.arange(96) / 96
    record = rng.normal(size=(2, 96))
    yield "condition_record, pressure", lambda p: condition_record(p, times, band=(2, 20)), record
    yield (
        "condition_record, dead time and band",
        lambda d: condition_record(record, times, dead_time=d[0], band=(d[1], d[2])),
        np.array([0.06, 2.0, 20.0]),
    )
    for model in ("2d", "in-plane"):
        yield (
            f"pressure_to_circular_integrals, {model}, radii and speed",
            lambda x, model=model: pressure_to_circular_integrals(
                record, times, x[1:], sound_speed=x[0], model=model
            ),
            np.array([1.1, 0.3, 0.5, 0.8]),
        )


def of_images(rng: np.random.Generator) -> Iterator[Case]:
    """In radius and opening of the arc, radius and chord of the region."""
    grid = ImageGrid(9)
    bell = phantoms.Bells([rng.uniform(-0.5, -0.1, 2)], [0.4])
    for right in (2.0, 0.5, 0.0):
        curve, region = circular_arc(1.3, right, 40), disk(1.0, right)
        chord = int(np.sum(np.abs(np.asarray(region.points)[:, 0] - right) < 1e-12))
        radii = data_radii(curve, region, 0.1)
        layout = problem_layout(
            curve, region, grid, radii, max_frequency=10.0, n_directions=8, n_groups=1
        )
        g = bell.circular_integrals(curve, radii)

        def moved(p, curve=curve, right=right, chord=chord):
            arc = eqx.tree_at(
                lambda arc: (arc.radius, arc.half_opening),
                curve,
                (1.3 + p[0], curve.half_opening + p[1]),
            )
            return arc, disk(1.0 + p[2], right + p[3])

        for alpha in (1e-3, 1e-6, RelativeTikhonov(0.1)):
            yield (
                f"reconstruct_direct, chord {right}, alpha {alpha}",
                lambda p, m=moved, r=radii, g=g, a=alpha, lay=layout: (
                    solve(Setup(*m(p)), grid, r, g, a).image
                ),
                np.zeros(4),
            )
        yield (
            f"build_plan and reconstruct, chord {right}, Tikhonov(1e-3)",
            lambda p, m=moved, r=radii, g=g, lay=layout: reconstruct(
                build_plan(Setup(*m(p)), grid, r, Tikhonov(1e-3)), g
            ),
            np.zeros(4),
        )


def main(seed: int = 0) -> int:
    jax.config.update("jax_enable_x64", True)
    rng, wrong = np.random.default_rng(seed), 0
    print(f"{'function and argument':72s} differences    modes", flush=True)
    for cases in (of_curves, of_records, of_images):
        for name, function, at in cases(rng):
            found = errors(function, at, rng)
            bad = not max(found) < TOLERANCE
            wrong += bad
            print(f"{name:72s} {found[0]:.1e}  {found[1]:.1e}{'  WRONG' * bad}", flush=True)
    print(f"{wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
