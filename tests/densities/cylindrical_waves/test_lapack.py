"""Routines called by their addresses against numpy, in both precisions and on parts of matrices."""

import numpy as np
import pytest

from jaxtat.densities.cylindrical_waves.lapack import cholesky, invert, multiply, square

LIMITS = {np.float32: 1e-5, np.float64: 1e-13}


@pytest.fixture(params=LIMITS, ids=lambda dtype: dtype.__name__)
def random(request):
    rng = np.random.default_rng(0)
    return lambda *shape: rng.standard_normal(shape).astype(request.param)


def close(found, wanted):
    return np.abs(found - wanted).max() < LIMITS[found.dtype.type] * np.abs(wanted).max()


@pytest.mark.parametrize("by_rows", [True, False])
def test_squares(random, by_rows):
    wide = random(7, 12)[:, :9] if by_rows else random(9, 12)[:, :7].T
    found = np.zeros((7, 8), wide.dtype)
    square(wide, found[:, :7])
    assert close(found[:, :7], np.triu(wide @ wide.T)) and not found[:, 7].any()


def test_roots_and_inverses(random):
    wide = random(6, 20)
    whole = np.zeros((8, 9), wide.dtype)
    part = whole[1:7, 2:8]
    square(wide, part)
    assert cholesky(part)
    assert close(part.T @ part, wide @ wide.T)
    upper = part.copy()
    invert(part)
    assert close(part @ upper, np.eye(6)) and not np.tril(part, -1).any()
    part[...] = -np.eye(6)
    assert not cholesky(part)


def test_products_between_triangles(random):
    left, matrix, right = np.triu(random(3, 3)), random(3, 5), np.triu(random(5, 5))
    found = matrix.copy()
    multiply(-2.0, left, found, right)
    assert close(found, -2 * left @ matrix @ right)
