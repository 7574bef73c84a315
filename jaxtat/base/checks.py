"""Checks at the entry of public functions: what came, what was expected, what to do.

Values can only be looked at when they are concrete; inside ``jax.jit`` or ``jax.grad`` the checks
of shape and dtype still apply and those of values are left to the concrete call outside.
"""

import operator
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike

from .parallel import whole

T = TypeVar("T")
OF_DETECTORS = ("g", "pressure", "data", "integrals")  # arguments that are rows of detectors
# what public functions take for real numbers: arrays, numbers, nested lists and tuples of them
Numbers = ArrayLike | Sequence[Any]


def is_concrete(*values: Any) -> bool:
    """True if no array among ``values`` (pytrees) is being traced."""
    return not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values))


def constants(values: T) -> T:
    """``values`` (a pytree) without derivatives; what is concrete stays so inside jax.jit too."""
    return jax.tree.map(
        lambda leaf: jax.lax.stop_gradient(leaf) if isinstance(leaf, Tracer) else leaf, values
    )


def by_library(compute: Callable[..., T], arrays: Any, *sizes: Any) -> T:
    """``compute(library, *arrays, *sizes)`` by numpy where the arrays are known, else by jax.numpy.

    For small arrays that follow from a few numbers: known ones need no compiled program, of which a
    new size would take one each, and stay concrete inside jax.jit too.
    """
    if not is_concrete(arrays):
        return compute(jnp, *arrays, *sizes)
    computed = compute(np, *jax.tree.map(np.asarray, tuple(arrays)), *sizes)
    with jax.ensure_compile_time_eval():
        return jax.device_put(computed)


def require_x64() -> None:
    """Raise ValueError unless JAX computes in 64 bits."""
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise ValueError(
            "jaxtat needs 64-bit arithmetic, but JAX is running in 32 bits. Call "
            "jax.config.update('jax_enable_x64', True) before the first array is made, or set the "
            "environment variable JAX_ENABLE_X64=1."
        )


# argument: what its class has, what it is, and how it is made
_OBJECTS = {
    "curve": ("n_detectors", "a DetectorCurve", "detector_curve(positions), positions in order"),
    "region": ("contains", "a Region", "disk(radius), polygon or rectangle"),
    "grid": ("spacing", "an ImageGrid", "ImageGrid(n) for n x n nodes"),
    "volume_grid": ("spacing", "a VolumeGrid", "VolumeGrid(n) for n x n x n nodes"),
    "phantom": ("circular_integrals", "an object with exact data", "phantoms.Disks or Bells"),
}
_LARGEST = {np.dtype(np.float64): 1e120, np.dtype(np.float32): 1e18}  # whose square is a number


def require_objects(**objects: Any) -> None:
    """Raise ValueError for positions in place of a curve, a number in place of a grid, ..."""
    for name, value in objects.items():
        mark, kind, how = _OBJECTS[name]
        if not hasattr(type(value), mark):
            raise ValueError(f"{name} is {named(value)}, expected {kind}: {how}.")


def named(value: Any) -> str:
    """A description of an unexpected argument, for messages."""
    if isinstance(value, int | float | str | None):
        return repr(value)
    if isinstance(value, list | tuple) and len(repr(value)) < 40:
        return repr(value)
    if isinstance(value, np.ndarray | jax.Array):
        return f"an array of shape {value.shape}"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    kind = type(value).__name__
    return f"{'an' if kind[0] in 'AEIOUaeiou' else 'a'} {kind}"


def is_number(value: Any) -> bool:
    """Whether a value is a real number, or an array, list or tuple, which may hold them."""
    return isinstance(value, list | tuple | np.ndarray | jax.Array | np.number | int | float)


def real_array(
    name: str,
    value: Numbers,
    shape: tuple[int | str | None, ...] | None,
    wanted: Any = np.float64,
) -> Array:
    """``value`` as a float64 array, refused if it is not real, finite and of the given shape.

    In ``shape`` an int is a required size, a str or None any size, and a leading ``"..."`` any
    number of leading axes. ``None`` for the whole shape accepts all. ``wanted`` may be float32,
    which needs no 64-bit arithmetic.
    """
    if wanted == np.float64:
        require_x64()
    dtype = dtype_of(name, value)
    if not (jnp.issubdtype(dtype, jnp.floating) or jnp.issubdtype(dtype, jnp.integer)):
        raise ValueError(f"{name} has dtype {dtype}, expected real numbers: pass float64 values.")
    # a constant stays concrete inside jax.jit too, so that it can be looked at
    with jax.ensure_compile_time_eval() if is_concrete(value) else nullcontext():
        array = whole(_array(value, wanted))
    if shape is not None and not _matches(array.shape, shape):
        sizes = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} has shape {array.shape}, expected ({sizes}).")
    require_finite(name, array)
    return array


def data_array(g: Numbers, *shape: int, kind: str = "circular") -> Array:
    """Integrals (..., *shape) as float64, refused if they are raw counts or of another shape."""
    dtype = dtype_of("g", g)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise ValueError(
            f"g has dtype {dtype}, expected float64 or float32 {kind} integrals; raw "
            f"counts go through condition_record and pressure_to_{kind}_integrals first."
        )
    array = real_array("g", g, ("...", *shape))
    if not array.size:
        raise ValueError(f"g has shape {array.shape}: a stack of no images at all.")
    require_magnitude("g", array)
    return array


def dtype_of(name: str, value: Any) -> np.dtype:
    """The dtype that ``value`` has as an array, or ValueError if it cannot be one."""
    require_unmasked(name, value)
    try:
        return _array(value).dtype
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} is {named(value)}, no array of real numbers.") from None


def require_unmasked(name: str, value: Any) -> None:
    """Raise ValueError for masked arrays, whose mask JAX and NumPy would ignore."""
    parts = value if isinstance(value, list | tuple) else [value]
    n = sum(np.ma.count_masked(part) for part in parts if isinstance(part, np.ma.MaskedArray))
    if n:
        others = ", or leave out the detectors that they come from" * (name in OF_DETECTORS)
        raise ValueError(
            f"{name} is a masked array with {n} values masked: fill them in by "
            f"{name}.filled(value){others}."
        )


def _array(value: Any, dtype: Any = None) -> Any:
    """An array of JAX, or without a dtype one of numpy; numbers are converted by numpy.

    `jnp.asarray` would take a compiled program for each new size.
    """
    if isinstance(value, np.ma.MaskedArray):
        value = np.asarray(value)
    plain = isinstance(value, bool | int | float | np.number | list | tuple)
    if (plain or type(value) is np.ndarray) and is_concrete(value):
        array = np.array(value, dtype)
        if array.dtype.kind in "biufc":
            return array if dtype is None else jax.device_put(array)
    return jnp.asarray(value, dtype)


def require_finite(name: str, array: Array) -> None:
    """Raise ValueError, with the first place, if a concrete array holds NaN or inf."""
    if not is_concrete(array):
        return
    bad = ~np.isfinite(np.asarray(array))
    if array.ndim == 0 and bad:
        raise ValueError(f"{name} is {float(array)} (NaN or infinite), expected a finite number.")
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        wanted = "expected finite numbers."
        if name in OF_DETECTORS:
            wanted = "leave out the detectors they come from, or mend them beforehand."
        raise ValueError(
            f"{name} holds {int(bad.sum())} NaN or infinite values of {bad.size}, the first at "
            f"index {first}: {wanted}"
        )


def require_magnitude(name: str, array: Array) -> None:
    """Raise ValueError for a concrete array whose squares overflow or underflow."""
    if not is_concrete(array) or not array.size:
        return
    size, most = float(np.max(np.abs(array))), _LARGEST[array.dtype]
    if size > most or 0 < size < 1 / most:
        raise ValueError(
            f"{name} has values of up to {size:.1e}, whose squares are too "
            f"{'large' if size > 1 else 'small'} for {array.dtype}: multiply it by a constant."
        )


def require_positive(name: str, value: Array) -> None:
    """Raise ValueError if a concrete value is not above zero."""
    if not is_concrete(value) or bool(np.all(np.asarray(value) > 0)):
        return
    values = np.asarray(value)
    if values.ndim == 0:
        raise ValueError(f"{name} is {values}, expected a value above zero.")
    at = tuple(int(i) for i in np.argwhere(~(values > 0))[0])
    raise ValueError(f"{name} is {values[at]} at index {at}, expected values above zero.")


def whole_number(name: str, value: Any, least: int) -> int:
    """``value`` as an int, refused if it is no whole number or below ``least``."""
    try:
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} is {value!r}, expected a whole number.") from None
    if number < least:
        raise ValueError(f"{name} is {number}, expected at least {least}.")
    return number


def _matches(shape: tuple[int, ...], wanted: tuple[int | str | None, ...]) -> bool:
    if wanted[:1] == ("...",):
        wanted = wanted[1:]
        shape = shape[len(shape) - len(wanted) :] if len(shape) >= len(wanted) else ()
    return len(shape) == len(wanted) and all(
        not isinstance(size, int) or size == actual
        for actual, size in zip(shape, wanted, strict=True)
    )
