"""The forward operator in SciPy and PyLops: their own judge, and refusals."""

import numpy as np
import pytest
from pylops.utils import dottest
from scipy.sparse.linalg import lsqr

from jaxtat import forward_operator, phantoms
from jaxtat.interop import pylops_operator, scipy_operator


@pytest.fixture(scope="module")
def operator(arc):
    return forward_operator(arc)


def test_pylops_judges_the_transpose(operator):
    for A in (operator, operator.T):
        wrapped = pylops_operator(A)
        assert wrapped.dims == A.in_structure().shape
        assert wrapped.dimsd == A.out_structure().shape
        assert dottest(wrapped, *wrapped.shape, rtol=1e-12)


def test_scipy_has_vectors_columns_and_the_transpose(operator, arc):
    A = scipy_operator(operator)
    image = phantoms.Bells([[0.1, 0.2]], [0.6]).image(arc.grid)
    g = np.ravel(operator.mv(image))
    x = np.ravel(image)
    assert np.array_equal(A @ x, g)
    assert np.allclose(A @ np.stack([x, -x], axis=1), np.stack([g, -g], axis=1), atol=1e-14)
    back = np.ravel(operator.T.mv(g.reshape(arc.data_shape)))
    assert np.array_equal(A.T @ g, back)
    assert np.allclose(A.T @ np.stack([g, -g], axis=1), np.stack([back, -back], axis=1))
    found = lsqr(A, g, iter_lim=30)[0]
    assert np.linalg.norm(A @ found - g) < 1e-3 * np.linalg.norm(g)


def test_others_are_refused(operator):
    for wrap in (pylops_operator, scipy_operator):
        with pytest.raises(ValueError, match="got a function, expected what forward_operator"):
            wrap(lambda x: x)
    with pytest.raises(ValueError, match="NaN"):
        scipy_operator(operator) @ np.full(21 * 21, np.nan)
