"""Routines of BLAS and LAPACK for numpy's rows, which let other threads go on.

scipy's own wrappers hold the lock of the interpreter while they compute, so that threads wait for
each other. It publishes the routines' addresses for other compilers, and calls by `ctypes` give the
lock up. Columns are in order there: an upper triangle here is a lower one to them.
"""

import ctypes
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float

_LOWER, _NOT, _LEFT, _RIGHT = b"L", b"N", b"L", b"R"


def square(wide: Float[np.ndarray, "n k"], found: Float[np.ndarray, "n n"]) -> None:
    """Write the upper triangle of W W^T; of W rows or columns are contiguous."""
    by_rows = wide.strides[1] == wide.itemsize
    kept, turned = (wide, b"T") if by_rows else (wide.T, _NOT)
    n, k = wide.shape
    _call("syrk", found, _LOWER, turned, n, k, 1.0, *_matrix(kept), 0.0, *_matrix(found))


def cholesky(matrix: Float[np.ndarray, "n n"]) -> bool:
    """Write U of M = U^T U over the upper triangle; False for one that is not positive."""
    failed = ctypes.c_int()
    _call("potrf", matrix, _LOWER, len(matrix), *_matrix(matrix), failed)
    return failed.value == 0


def invert(upper: Float[np.ndarray, "n n"]) -> None:
    """Write U^-1 over an upper triangle."""
    _call("trtri", upper, _LOWER, _NOT, len(upper), *_matrix(upper), ctypes.c_int())


def multiply(
    factor: float,
    left: Float[np.ndarray, "n n"],
    matrix: Float[np.ndarray, "n m"],
    right: Float[np.ndarray, "m m"],
) -> None:
    """Write the product of a number and three matrices over the one between upper triangles."""
    n, m = matrix.shape
    for side, scale, triangle in ((_RIGHT, 1.0, left), (_LEFT, factor, right)):
        sizes = _LOWER, _NOT, _NOT, m, n, scale
        _call("trmm", matrix, side, *sizes, *_matrix(triangle), *_matrix(matrix))


def _matrix(rows: np.ndarray) -> tuple[ctypes.c_void_p, int]:
    """Address and distance of the rows."""
    return ctypes.c_void_p(rows.ctypes.data), rows.strides[0] // rows.itemsize


def _call(name: str, like: np.ndarray, *arguments: Any) -> None:
    """Call a routine of the precision of an array; numbers are passed by their addresses."""
    single = like.dtype == np.float32
    real = ctypes.c_float if single else ctypes.c_double
    kinds = {bytes: ctypes.c_char, int: ctypes.c_int, float: real}
    passed = [kinds[type(a)](a) if type(a) in kinds else a for a in arguments]
    _routine(("s" if single else "d") + name)(
        *(a if isinstance(a, ctypes.c_void_p) else ctypes.byref(a) for a in passed)
    )


@cache
def _routine(name: str) -> Any:
    of_blas, of_lapack = (import_module(f"scipy.linalg.cython_{x}") for x in ("blas", "lapack"))
    capsule = ctypes.py_object((of_blas.__pyx_capi__ | of_lapack.__pyx_capi__)[name])
    ctypes.pythonapi.PyCapsule_GetName.restype = ctypes.c_char_p
    ctypes.pythonapi.PyCapsule_GetPointer.restype = ctypes.c_void_p
    signature = ctypes.c_char_p(ctypes.pythonapi.PyCapsule_GetName(capsule))
    return ctypes.CFUNCTYPE(None)(ctypes.pythonapi.PyCapsule_GetPointer(capsule, signature))
