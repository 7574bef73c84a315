"""The forward operator as a linear operator of SciPy and of PyLops, on flat NumPy vectors."""

from typing import Any

import numpy as np
import scipy.sparse.linalg

from ..base.optional_packages import optional
from ..reconstruction import ForwardOperator


def scipy_operator(A: ForwardOperator) -> scipy.sparse.linalg.LinearOperator:
    """A as a `scipy.sparse.linalg.LinearOperator`, for `lsqr`, `lsmr`, `svds`, ...

    Args:
        A: made by `forward_operator`, or its transpose.

    Returns:
        Of shape (size of the data, size of the image); images and data are flattened in C order.

    Raises:
        ValueError: for anything else than a `ForwardOperator`; later, for vectors with NaN.

    >>> from scipy.sparse.linalg import lsqr
    >>> from jaxtat import ImageGrid, Setup, circular_arc, disk, forward_operator, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> bell, A = phantoms.Bells([[0.1, 0.2]], [0.6]), forward_operator(setup)
    >>> g = bell.circular_integrals(setup.curve, setup.radii)
    >>> image = lsqr(scipy_operator(A), np.ravel(g), iter_lim=20)[0].reshape(21, 21)
    >>> bool(abs(image - bell.image(setup.grid)).max() < 0.05)
    True
    """
    into, out = _structures(A)
    back = A.T
    return scipy.sparse.linalg.LinearOperator(
        shape=(out.size, into.size),
        dtype=np.dtype(into.dtype),
        matvec=lambda x: _flat(A, x, into.shape),  # pyright: ignore[reportCallIssue]
        rmatvec=lambda y: _flat(back, y, out.shape),  # pyright: ignore[reportCallIssue]
        matmat=lambda x: _columns(A, x, into.shape),  # pyright: ignore[reportCallIssue]
        rmatmat=lambda y: _columns(back, y, out.shape),  # pyright: ignore[reportCallIssue]
    )


def pylops_operator(A: ForwardOperator) -> Any:
    """A as a `pylops.LinearOperator`, to be stacked with others, and for PyLops' solvers.

    Needs PyLops: ``pip install 'jaxtat[pylops]'``.

    Args:
        A: made by `forward_operator`, or its transpose.

    Returns:
        With ``dims`` the shape of the image and ``dimsd`` that of the data.

    Raises:
        ValueError: for anything else than a `ForwardOperator`, or without PyLops.
    """
    into, out = _structures(A)
    pylops = optional("pylops", "pylops_operator", "pylops")
    back = A.T

    class PylopsOperator(pylops.LinearOperator):
        def _matvec(self, x: np.ndarray) -> np.ndarray:
            return _flat(A, x, into.shape)

        def _rmatvec(self, x: np.ndarray) -> np.ndarray:
            return _flat(back, x, out.shape)

    return PylopsOperator(dtype=np.dtype(into.dtype), dims=into.shape, dimsd=out.shape)


def _structures(A: Any) -> tuple[Any, Any]:
    if not isinstance(A, ForwardOperator):
        raise ValueError(f"got a {type(A).__name__}, expected what forward_operator(setup) makes.")
    return A.in_structure(), A.out_structure()


def _flat(A: ForwardOperator, x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return np.asarray(A(np.reshape(x, shape))).ravel()


def _columns(A: ForwardOperator, x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    stack = np.reshape(x.T, (x.shape[1], *shape))
    return np.asarray(A(stack)).reshape(x.shape[1], -1).T
