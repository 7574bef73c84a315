"""Tikhonov's minimum by jaxopt: against the closed form, and who gets to see jaxopt."""

import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import Tikhonov
from jaxtat.regularization.filtered import filtered_solve
from jaxtat.studies.ridge_solver import _jaxopt, ridge


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(0)
    blocks = rng.standard_normal((2, 6, 9))
    blocks[1] = blocks[0]  # every singular value twice
    rhs = rng.standard_normal((2, 6, 3)) + 1j * rng.standard_normal((2, 6, 3))
    return jnp.asarray(blocks), jnp.asarray(rhs)


@pytest.mark.parametrize("size", [1.0, 1e-9])
def test_it_is_tikhonovs_solution(problem, size):
    blocks, rhs = problem
    found = ridge(size * blocks, rhs, 0.3 * size**2, tolerance=1e-11)
    rule = Tikhonov(0.3 * size**2)
    exact = filtered_solve(size * blocks, rhs, rule, jnp.array(1.0)).q
    np.testing.assert_allclose(found.q, exact, atol=1e-9 * np.abs(exact).max())
    assert found.converged
    assert 5 < found.iterations < 100
    assert found.error < 1e-11


def test_too_few_steps_are_told(problem):
    found = ridge(*problem, 1e-6, max_steps=3)
    assert (int(found.iterations), bool(found.converged)) == (3, False)
    assert found.error > 1e-6


def test_derivatives_in_both_modes(problem, check_both_modes):
    """In matrix, right-hand side and alpha."""
    blocks, rhs = problem

    def of(blocks, real, alpha):
        q = ridge(jnp.asarray(blocks), jnp.asarray(real) + 0j, jnp.asarray(alpha), tolerance=1e-11)
        return q.q.real

    check_both_modes(of, (blocks, rhs.real, 0.3))


def test_nothing_to_solve(problem):
    found = ridge(problem[0], 0 * problem[1], 0.1)
    assert not np.any(found.q)
    assert found.converged


def test_bad_arguments_are_refused(problem):
    with pytest.raises(ValueError, match="alpha"):
        ridge(*problem, -1.0)
    with pytest.raises(ValueError, match="max_steps is 0"):
        ridge(*problem, 1.0, max_steps=0)


@pytest.mark.parametrize("asks_for", ["jax.tree_map", "jax.experimental.host_callback"])
def test_a_jaxopt_that_no_longer_works_is_named(tmp_path, monkeypatch, asks_for):
    """One that asks JAX for what it has dropped: a name, or a module."""
    module, name = asks_for.rsplit(".", 1)
    (tmp_path / "jaxopt.py").write_text(f"from {module} import {name}\nimport jax\njax.{name}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "jaxopt", raising=False)
    with pytest.raises(
        ImportError, match=r"jaxopt.* does not work beside JAX .*Tikhonov"
    ) as caught:
        _jaxopt()
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_jaxopt_is_imported_by_those_who_use_it_and_its_warning_seen_by_nobody():
    program = """
import sys
import jaxtat
assert jaxtat.studies.compare_regularizations  # which uses it, and all else, is imported
assert "jaxopt" not in sys.modules
from jaxtat.studies.ridge_solver import _jaxopt
assert "jaxopt" not in sys.modules
_jaxopt()  # as ridge does
assert "jaxopt" in sys.modules
"""
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)
