"""Derivatives of public functions against central differences, in both modes.

Random small problems, see `derivative_cases`. Differences are extrapolated (Richardson) at several
steps, of which the best counts: an error that no step brings below 1e-6 is one of the derivative.
They are taken of the compiled function and of the one that sees concrete numbers. Each argument is
moved by itself.

    python benchmarks/robustness/derivatives.py --seed 0
    python benchmarks/robustness/derivatives.py --only elliptic_arc

prints a table; the exit code is 1 if something smooth is off by more than 1e-6.
"""

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

sys.path.insert(0, str(Path(__file__).resolve().parent))

TOLERANCE = 1e-6
STEPS = (1e-3, 1e-4, 1e-5)


class Case(NamedTuple):
    """A function, and where its derivatives are taken.

    Attributes:
        name: of the function and its problem.
        function: of the arguments, to any tree of numbers.
        arguments: by name, each moved by itself, all others at rest.
        jit: whether it can be compiled; what searches for its result cannot.
        exact: the same to rounding, of which differences are taken; by default the function.
    """

    name: str
    function: Callable[..., Any]
    arguments: dict[str, Any]
    jit: bool = True
    exact: Callable[..., Any] | None = None


def real_numbers(tree: Any) -> jax.Array:
    """All real and complex numbers of a tree in one row, real parts before imaginary ones."""
    leaves = [jnp.asarray(leaf) for leaf in jax.tree.leaves(tree)]
    leaves = [leaf.ravel() for leaf in leaves if jnp.issubdtype(leaf.dtype, jnp.inexact)]
    parts = [*map(jnp.real, leaves), *(jnp.imag(leaf) for leaf in leaves if jnp.iscomplexobj(leaf))]
    return jnp.concatenate(parts)


def errors(case: Case, rng: np.random.Generator) -> Iterator[tuple[str, float, float]]:
    """By argument: of forward mode against differences, and of reverse against forward mode.

    Both are relative to the largest slope.
    """
    at, back = ravel_pytree({k: jnp.asarray(v, float) for k, v in case.arguments.items()})

    def function(x: jax.Array) -> jax.Array:
        return real_numbers(case.function(**back(x)))

    def exact(x: jax.Array) -> jax.Array:
        return real_numbers((case.exact or case.function)(**back(x)))

    def pushed(x: jax.Array, along: jax.Array) -> jax.Array:
        return jax.jvp(function, (x,), (along,))[1]

    def pulled(x: jax.Array, test: jax.Array) -> jax.Array:
        return jax.vjp(function, x)[1](test)[0]

    value, push, pull = map(jax.jit if case.jit else lambda f: f, (exact, pushed, pulled))
    values = (value, exact) if case.jit else (exact,)  # of traced and of concrete arguments
    test = jnp.asarray(rng.normal(size=value(at).shape))
    gradient = pull(at, test)
    for name in case.arguments:
        some = {k: np.ones(np.shape(v)) * (k == name) for k, v in case.arguments.items()}
        along = rng.normal(size=at.shape) * ravel_pytree(some)[0]
        slope = push(at, along)
        size, forward = float(jnp.abs(slope).max()), float(test @ slope)
        error = max(_least_error(each, at, along, slope) for each in values)
        difference = abs(forward - float(gradient @ along))
        scale = max(abs(forward), size)
        yield name, error / size if size else np.inf, difference / scale if scale else np.inf


def _least_error(value: Callable, at: jax.Array, along: jax.Array, slope: jax.Array) -> float:
    """Of the slope against differences, at the best of all steps."""
    best = np.inf
    for step in STEPS:
        wide, narrow = (
            (value(at + h * along) - value(at - h * along)) / (2 * h) for h in (step, step / 2)
        )
        best = min(best, float(jnp.abs((4 * narrow - wide) / 3 - slope).max()))
    return best


def measure(case: Case, rng: np.random.Generator) -> tuple[bool, str]:
    """Whether all is right, and a line for the table."""
    start = time.perf_counter()
    try:
        found = list(errors(case, rng))
    except Exception as error:  # the sweep goes on
        return False, f"| {case.name} | {type(error).__name__}: {str(error)[:150]!r} | | | WRONG |"
    took = time.perf_counter() - start
    wrong = [f"{name} {max(two):.0e}" for name, *two in found if not max(two) < TOLERANCE]
    forward, modes = (max(column) for column in list(zip(*found, strict=True))[1:])
    line = f"| {case.name} | {', '.join(case.arguments)} | {forward:.1e} | {modes:.1e} | "
    print(f"{took:.1f} s", file=sys.stderr, end=" ")
    return not wrong, line + (f"WRONG: {', '.join(wrong)} |" if wrong else "|")


def main() -> int:
    from derivative_cases import FAMILIES

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--families", nargs="+", default=[f.__name__ for f in FAMILIES])
    parser.add_argument("--only", nargs="+", default=[""], help="names that hold one of these")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")  # of small problems
    wrong = number = 0
    print("| function | arguments | differences | modes | |\n| --- | --- | ---: | ---: | --- |")
    for k, family in enumerate(FAMILIES):
        if family.__name__ not in options.families:
            continue
        for case in family(np.random.default_rng([options.seed, k])):
            if not any(part in case.name for part in options.only):
                continue
            right, line = measure(case, np.random.default_rng([options.seed, number]))
            wrong, number = wrong + (not right), number + 1
            print(line, flush=True)
        jax.clear_caches()
    print(f"\n{number} functions, {wrong} of them wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
