"""The forward operator, and the direct inverse, in lineax, SciPy, PyLops and SCICO."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import scipy.sparse.linalg
from jaxtyping import Array

from ..base.checks import real_array
from ..base.optional_packages import optional
from ..reconstruction import ForwardOperator, Setup, reconstruct


def direct_operator(
    setup: Setup, rule: Any = None, *, low_pass: Any = None
) -> lx.FunctionLinearOperator:
    """The direct reconstruction g -> f as an operator of lineax: A_dagger, in closed form.

    It inverts A for images that vanish outside the region, up to the regularisation; it is not the
    Moore-Penrose inverse. The image is zero outside the region. `scipy_operator` and
    `pylops_operator` take it too, for an initial value or a preconditioner.

    Args:
        setup: detectors, region, grid and radii.
        rule, low_pass: as in `reconstruct`.

    Returns:
        From data (detectors, radii) to images; its transpose is exact.

    >>> from jaxtat import ImageGrid, circular_arc, disk, forward_operator, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> bell, A = phantoms.Bells([[0.1, 0.2]], [0.6]), forward_operator(setup)
    >>> f = bell.image(setup.grid)
    >>> bool(abs(direct_operator(setup, 1e-6).mv(A.mv(f)) - f).max() < 0.02)
    True
    """
    inside = np.asarray(setup.region.contains(setup.grid.points))

    def image(g: Array) -> Array:
        return jnp.where(inside, reconstruct(setup, g, rule, low_pass=low_pass), 0.0)

    return lx.FunctionLinearOperator(image, jax.ShapeDtypeStruct(setup.data_shape, jnp.float64))


def scipy_operator(
    A: ForwardOperator | lx.FunctionLinearOperator,
) -> scipy.sparse.linalg.LinearOperator:
    """A as a `scipy.sparse.linalg.LinearOperator`, for `lsqr`, `lsmr`, `svds`, ...

    Args:
        A: made by `forward_operator` or `direct_operator`, or its transpose.

    Returns:
        Of shape (size of the data, size of the image); images and data are flattened in C order.

    Raises:
        ValueError: for anything else; later, for vectors with NaN.

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


def pylops_operator(A: ForwardOperator | lx.FunctionLinearOperator) -> Any:
    """A as a `pylops.LinearOperator`, to be stacked with others, and for PyLops' solvers.

    Needs PyLops: ``pip install 'jaxtat[pylops]'``.

    Args:
        A: made by `forward_operator` or `direct_operator`, or its transpose.

    Returns:
        With ``dims`` the shape of the image and ``dimsd`` that of the data.

    Raises:
        ValueError: for anything else, or without PyLops.
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


def scico_operator(A: ForwardOperator | lx.FunctionLinearOperator) -> Any:
    """A as a `scico.linop.LinearOperator`, for SCICO's solvers and functionals.

    Needs SCICO, whose own bound on JAX (0.8.1 for version 0.0.7) is older than what jaxtat needs,
    although it runs with 0.10: ``pip install --no-deps scico``.

    Args:
        A: made by `forward_operator` or `direct_operator`, or its transpose; in double precision
            where SCICO's arrays are.

    Returns:
        From arrays of the image's shape to those of the data's.

    Raises:
        ValueError: for anything else, or without SCICO.
    """
    into, out = _structures(A)
    linop = optional("scico.linop", "scico_operator", "pip install --no-deps scico")
    return linop.LinearOperator(
        input_shape=into.shape,
        output_shape=out.shape,
        eval_fn=A.mv,
        adj_fn=A.T.mv,
        input_dtype=into.dtype,
        output_dtype=out.dtype,
    )


def _structures(A: Any) -> tuple[Any, Any]:
    if not isinstance(A, ForwardOperator | lx.FunctionLinearOperator):
        raise ValueError(
            f"got a {type(A).__name__}, expected what forward_operator(setup) or "
            "direct_operator(setup) makes."
        )
    return A.in_structure(), A.out_structure()


def _flat(A: Any, x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    values = real_array("x", np.reshape(x, shape), shape)
    return np.asarray(A(values) if isinstance(A, ForwardOperator) else _applied(A, values)).ravel()


def _columns(A: Any, x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    if not isinstance(A, ForwardOperator):
        return np.stack([_flat(A, column, shape) for column in x.T], axis=1)
    stack = np.reshape(x.T, (x.shape[1], *shape))
    return np.asarray(A(stack)).reshape(x.shape[1], -1).T


@eqx.filter_jit
def _applied(A: lx.AbstractLinearOperator, x: Array) -> Array:
    return A.mv(x)
