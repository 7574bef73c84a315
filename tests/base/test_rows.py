"""Rows of arrays in groups: as one by one, and made into a program once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat.base.rows import map_rows

ROWS = np.random.default_rng(0).uniform(0.5, 2.0, (7, 3))


@pytest.mark.parametrize("n", [0, 1, 4, 5, 6, 7])
@pytest.mark.parametrize("at_once", [1, 2, 3, 7, 10])
def test_trees_of_rows_are_mapped_one_by_one(n, at_once):
    rows = {"a": ROWS[:n], "b": np.arange(n)}
    found = map_rows(lambda row: (row["b"] * jnp.log(row["a"]), row["b"] + 1), rows, at_once)
    np.testing.assert_allclose(found[0], rows["b"][:, None] * np.log(rows["a"]), rtol=1e-14)
    np.testing.assert_array_equal(found[1], rows["b"] + 1)


def test_what_fills_the_last_group_is_in_no_derivative():
    def total(rows):
        return jnp.sum(map_rows(lambda row: jnp.sum(row**3), rows, 3))

    np.testing.assert_allclose(jax.grad(total)(jnp.asarray(ROWS)), 3 * ROWS**2, rtol=1e-14)


@pytest.mark.parametrize("at_once", [2, 3, 7])
def test_the_function_is_traced_once_and_never_for_more_rows_than_allowed(at_once):
    programs = jax.make_jaxpr(lambda rows: map_rows(jnp.sin, rows, at_once))(ROWS)
    assert str(programs).count(" sin ") == 1
    (sine,) = [line for line in str(programs).splitlines() if " sin " in line]
    assert int(sine.split("[")[1].split(",")[0]) <= at_once
