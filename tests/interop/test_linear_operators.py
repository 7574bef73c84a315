"""The forward operator in SciPy, PyLops and SCICO: their own judges, and refusals."""

import sys

import numpy as np
import pytest
from pylops.utils import dottest
from scipy.sparse.linalg import lsqr

from jaxtat import forward_operator, phantoms, reconstruct
from jaxtat.interop import direct_operator, pylops_operator, scico_operator, scipy_operator


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


def test_the_direct_inverse_is_judged_too(operator, arc):
    """Its transpose by PyLops; and it inverts, as the formula does, what lies in the region."""
    inverse = direct_operator(arc, 1e-8)
    wrapped = pylops_operator(inverse)
    assert (wrapped.dims, wrapped.dimsd) == (arc.data_shape, arc.grid.shape)
    assert dottest(wrapped, *wrapped.shape, rtol=1e-9)
    image = phantoms.Bells([[0.1, 0.2]], [0.6]).image(arc.grid)
    g = np.ravel(operator.mv(image))
    A = scipy_operator(inverse)
    found = (A @ g).reshape(arc.grid.shape)
    inside = np.asarray(arc.region.contains(arc.grid.points))
    direct = np.where(inside, reconstruct(arc, g.reshape(arc.data_shape), 1e-8), 0.0)
    assert np.allclose(found, direct, atol=1e-12)
    assert np.linalg.norm(found - image) < 0.01 * np.linalg.norm(image)
    both = A @ np.stack([g, -g], axis=1)
    assert np.allclose(both[:, 0], np.ravel(found)) and np.allclose(both[:, 1], -np.ravel(found))


@pytest.mark.filterwarnings("default")  # its own, of functions that newer JAX has not
def test_scico_judges_the_adjoint_and_solves(operator, arc):
    pytest.importorskip("scico", reason="SCICO is not installed: make test-interop")
    from scico import linop, solver

    for A in (operator, operator.T):
        wrapped = scico_operator(A)
        assert linop.valid_adjoint(wrapped, wrapped.T, eps=1e-10)
    image = phantoms.Bells([[0.1, 0.2]], [0.6]).image(arc.grid)
    A = scico_operator(operator)
    found, _ = solver.cg(A.T @ A, A.T @ operator.mv(image), maxiter=30)
    assert np.linalg.norm(found - image) < 0.1 * np.linalg.norm(image)


def test_without_scico_it_says_how_to_install_it(operator, monkeypatch):
    monkeypatch.setitem(sys.modules, "scico.linop", None)
    with pytest.raises(ValueError, match=r"pip install --no-deps scico\.$"):
        scico_operator(operator)


def test_others_are_refused(operator):
    for wrap in (pylops_operator, scipy_operator):
        with pytest.raises(ValueError, match="got a function, expected what forward_operator"):
            wrap(lambda x: x)
    with pytest.raises(ValueError, match="NaN"):
        scipy_operator(operator) @ np.full(21 * 21, np.nan)
