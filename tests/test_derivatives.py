"""A small part of the sweep of derivatives, and whether it would tell."""

import sys
from pathlib import Path

import jax
import numpy as np
import pytest

SCRIPTS = Path(__file__).parents[1] / "benchmarks" / "robustness"


@pytest.fixture(scope="module")
def sweep():
    sys.path.insert(0, str(SCRIPTS))
    try:
        import derivative_cases
        import derivatives
    finally:
        sys.path.remove(str(SCRIPTS))
    return derivatives, derivative_cases


@pytest.mark.parametrize(
    ("family", "name"),
    [
        ("of_curves", "elliptic_arc, symmetric ends"),
        ("of_records", "condition_record, baseline True"),
    ],
)
def test_derivatives_are_those_of_differences(sweep, family, name):
    derivatives, cases = sweep
    (case,) = (c for c in getattr(cases, family)(np.random.default_rng(7)) if c.name == name)
    right, line = derivatives.measure(case, np.random.default_rng(7))
    assert right, line


def test_the_sweep_tells_what_is_wrong(sweep):
    derivatives, _ = sweep

    def held(x, y):
        return x**2 + jax.lax.stop_gradient(y) ** 2

    case = derivatives.Case("held", held, {"x": np.ones(2), "y": np.ones(2)})
    right, line = derivatives.measure(case, np.random.default_rng(0))
    assert not right
    assert "WRONG: y" in line
    assert "x " not in line.partition("WRONG")[2]
