"""Factors in blocks against the matrices that they are of."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import DTypeLike

from jaxtat.densities.cylindrical_waves.cholesky import Cholesky, block_bounds, factorize

solve = eqx.filter_jit(Cholesky.solve)


def factor_of(wide, alpha, size, dtype: DTypeLike = float):
    """With whatever was in memory before."""
    sizes = [(start, stop - start) for start, stop in block_bounds(size)]
    above = [np.full(shape, 7.0, dtype) for shape in sizes]
    inverse = [np.full((b, b), 7.0, dtype) for _, b in sizes]
    factorize(wide, alpha, above, inverse)
    return Cholesky(*(tuple(map(jnp.asarray, part)) for part in (above, inverse)))


@pytest.mark.parametrize("size", [3, 256, 600])
def test_it_solves(size):
    """In one block, less than full and full, and in three."""
    rng = np.random.default_rng(0)
    wide, columns = rng.standard_normal((size, 40)), rng.standard_normal((size, 3))
    factor = factor_of(wide, 0.5, size)
    assert factor.size == size and len(factor.above) == -(-size // 256)
    wanted = np.linalg.solve(wide @ wide.T + 0.5 * np.eye(size), columns)
    assert np.abs(solve(factor, columns) - wanted).max() < 1e-11 * np.abs(wanted).max()


@pytest.mark.parametrize("used", [200, 400])
def test_rows_that_lack_stay_as_they_are(used):
    """The rest of a block, and a block as a whole."""
    rng = np.random.default_rng(1)
    wide, columns = rng.standard_normal((used, 50)), rng.standard_normal((500, 2))
    found = solve(factor_of(wide, 2.0, 500), columns)
    wanted = np.linalg.solve(wide @ wide.T + 2 * np.eye(used), columns[:used])
    found = np.asarray(found)
    assert np.abs(found[:used] - wanted).max() < 1e-12 * np.abs(wanted).max()
    assert (found[used:] == columns[used:]).all()


def test_found_in_double_and_kept_in_single():
    rng = np.random.default_rng(2)
    wide, columns = rng.standard_normal((300, 200)), rng.standard_normal((300, 1))
    factor = factor_of(wide, 10.0, 300, np.float32)
    wanted = np.linalg.solve(wide @ wide.T + 10 * np.eye(300), columns)
    assert factor.inverse[1].dtype == np.float32
    assert np.abs(solve(factor, columns) - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_no_alpha():
    with pytest.raises(np.linalg.LinAlgError, match="less than rounding"):
        factor_of(np.ones((5, 1)), 1e-30, 5)
