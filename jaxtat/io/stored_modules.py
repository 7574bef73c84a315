"""Trees of frozen modules as plain text and named arrays, and back; nothing is pickled.

A module becomes the name of its class and its fields; an array a name, under which it is stored
beside the text; sizes, flags and tuples are as JSON has them. So a new field or class needs no line
here: only classes of jaxtat are read, and each field has to be what its annotation says.
"""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any, cast, get_args, get_origin

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, jaxtyped

Plain = dict[str, Any] | list[Any] | str | float | bool | None


def to_plain(tree: Any, arrays: dict[str, np.ndarray], name: str = "") -> Plain:
    """A tree as plain text.

    Args:
        tree: a module; fields are modules, arrays, numbers, text, None, or tuples of these.
        arrays: where its arrays go, by names that are made of those of the fields.
        name: of what the tree is in a larger one.

    Raises:
        ValueError: for a part that files cannot hold.

    >>> from jaxtat import NormBound
    >>> to_plain(NormBound(4.0), arrays := {}), arrays
    ({'kind': 'NormBound', 'fields': {'K': {'array': 'K'}, 'fractional': True, 'softness': None}}, \
{'K': array(4.)})
    """
    if isinstance(tree, eqx.Module):
        kind = type(tree).__name__
        if _classes().get(kind) is not type(tree):
            raise ValueError(f"a {kind} cannot be saved: it is no class of jaxtat.")
        parts = {key: getattr(tree, key) for key in _names(type(tree))}
        under = f"{name}." if name else ""
        return {
            "kind": kind,
            "fields": {key: to_plain(part, arrays, under + key) for key, part in parts.items()},
        }
    if isinstance(tree, jax.Array | np.ndarray):
        arrays[name] = np.asarray(tree)
        return {"array": name}
    if isinstance(tree, tuple):
        return [to_plain(part, arrays, f"{name}.{k}") for k, part in enumerate(tree)]
    if isinstance(tree, np.generic):
        tree = tree.item()
    if tree is None or isinstance(tree, bool | int | float | str):
        return tree
    raise ValueError(f"{name or 'this'} is a {type(tree).__name__}, which cannot be saved.")


def from_plain(plain: Any, arrays: dict[str, np.ndarray]) -> Any:
    """The tree of a text that `to_plain` made; its fields are checked by `require_types`.

    Args:
        plain: the text.
        arrays: by name. Those that are used are taken out of it: each is there once.

    Raises:
        ValueError: for a class or array that there is not, and fields that are not the class's.
    """
    if isinstance(plain, list):
        return tuple(from_plain(part, arrays) for part in plain)
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        if plain["array"] not in arrays:
            raise ValueError(f"an array {plain['array']!r:.60} is missing, or there twice.")
        return jax.device_put(arrays.pop(plain["array"]))
    kind, parts = _classes().get(str(plain.get("kind"))), plain.get("fields")
    if kind is None or not isinstance(parts, dict):
        raise ValueError(f"there is no class {plain.get('kind')!r:.60}.")
    if set(parts) != {*_names(kind)}:
        odd = sorted(set(parts) ^ {*_names(kind)})
        raise ValueError(f"{kind.__name__} has other fields than a file's, namely {odd!s:.100}.")
    # the fields are those of a finished module: __init__, which computes them, is not for files
    module = object.__new__(kind)
    for name, part in parts.items():
        object.__setattr__(module, name, from_plain(part, arrays))
    return module


def require_types(module: eqx.Module, *known: tuple[Array, Any]) -> list[eqx.Module]:
    """Every field of a tree against its annotation; one name stands for one size throughout.

    Members of tuples have sizes of their own: they are returned, not looked into.

    Args:
        module: the root of the tree.
        known: arrays, each with the names of its sizes, which hold for the tree.

    Raises:
        ValueError: for a field that is something else.
    """
    modules, members = [module], []
    with jaxtyped("context"):
        for array, sizes in known:
            isinstance(array, sizes)
        for part in modules:  # grows
            for field in fields(cast(Any, part)):
                value, wanted = getattr(part, field.name), cast(Any, field.type)
                if get_origin(wanted) is tuple:
                    fits = _is_tuple_of(value, wanted)
                else:  # here and in no function, which would have sizes of its own
                    fits = wanted is Any or isinstance(value, wanted)
                if not fits:
                    array = isinstance(value, Array)
                    what = f"of shape {value.shape} ({value.dtype})" if array else f"{value!r:.60}"
                    raise ValueError(
                        f"{field.name} {what}, which does not fit its other arrays, "
                        f"expected ({getattr(wanted, 'dim_str', wanted)})."
                    )
                if isinstance(value, tuple):
                    members.extend(member for member in value if isinstance(member, eqx.Module))
                elif isinstance(value, eqx.Module):
                    modules.append(value)
    return members


def _is_tuple_of(value: Any, wanted: Any) -> bool:
    """Whether a value is of an annotated type that may be a tuple of types, or of tuples."""
    if get_origin(wanted) is not tuple:
        return wanted is Any or isinstance(value, wanted)
    if not isinstance(value, tuple):
        return False
    members = get_args(wanted)
    if members[-1] is Ellipsis:
        members = members[:1] * len(value)
    return len(value) == len(members) and all(map(_is_tuple_of, value, members))


def _names(kind: type[eqx.Module]) -> list[str]:
    return [field.name for field in fields(cast(Any, kind))]


def _classes() -> dict[str, type[eqx.Module]]:
    """jaxtat's own modules by name."""
    return {
        kind.__name__: kind
        for kind in _subclasses(eqx.Module)
        if kind.__module__.startswith("jaxtat.")
    }


def _subclasses(kind: type) -> Iterator[type]:
    for below in kind.__subclasses__():
        yield below
        yield from _subclasses(below)
