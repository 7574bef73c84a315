"""Reconstruction plans in HDF5.

A plan is a tree of modules. Each becomes a group with the name of its class; arrays become
datasets, sizes and flags attributes. A digest over all of it tells damaged files from whole ones.
A new curve, region or regularisation only has to be named in `_KINDS`.
"""

import hashlib
from dataclasses import fields
from pathlib import Path
from typing import Any

import equinox as eqx
import h5py
import jax
import jax.numpy as jnp
import numpy as np

from ..checks import require_x64
from ..densities import DensityReport
from ..geometry import DetectorCurve, ImageGrid, TruncatedDisk
from ..plan import ReconstructionPlan
from ..regularization import FixedRank, NormBound, SingularValueCutoff
from .atomic import replacing

FORMAT, VERSION = "jaxtat plan", 1
_KINDS: dict[str, type[eqx.Module]] = {
    kind.__name__: kind
    for kind in (
        ReconstructionPlan,
        DetectorCurve,
        TruncatedDisk,
        ImageGrid,
        DensityReport,
        NormBound,
        FixedRank,
        SingularValueCutoff,
    )
}


def save_plan(plan: ReconstructionPlan, path: str | Path, *, precision: str = "as is") -> None:
    """Write a plan, with everything it was built from, to an HDF5 file.

    The file is written under a temporary name and renamed, so ``path`` is whole or untouched.

    Args:
        plan: from `build_plan`.
        path: the file.
        precision: "as is", or "single" to store the densities in half the space.

    Raises:
        ValueError: for an unknown precision, a folder that does not exist, or a plan with a part
            of a kind that files do not know.
    """
    if precision not in ("as is", "single"):
        raise ValueError(f"precision is {precision!r}, expected 'as is' or 'single'.")
    if precision == "single":
        single = plan.densities.astype(jnp.complex64)
        plan = eqx.tree_at(lambda tree: tree.densities, plan, single)
    with replacing(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["version"] = VERSION
        _write(file.create_group("plan"), plan)
        file.attrs["digest"] = _digest(file["plan"])


def load_plan(path: str | Path) -> ReconstructionPlan:
    """Read a plan that `save_plan` wrote.

    Args:
        path: the file.

    Returns:
        ReconstructionPlan, equal to the last bit.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file that is damaged, of another kind or version, or whose arrays do not
            fit each other; nothing of it is used.
    """
    require_x64()
    if not Path(path).is_file():
        raise FileNotFoundError(f"there is no plan file {path}.")
    try:
        with h5py.File(path, "r") as file:
            _require_format(path, file)
            plan = _read(file["plan"])
    except (OSError, KeyError, RuntimeError, TypeError, UnicodeDecodeError) as error:
        raise ValueError(
            f"{path} is damaged or is no HDF5 file ({error}): build the plan again."
        ) from error
    _require_consistent(path, plan)
    return plan


def _write(group: h5py.Group, module: eqx.Module) -> None:
    kind = type(module).__name__
    if kind not in _KINDS:
        raise ValueError(
            f"plans with a {kind} cannot be saved: add it to the kinds in io/plans.py."
        )
    group.attrs["kind"] = kind
    for field in fields(module):  # pyright: ignore[reportArgumentType]
        value = getattr(module, field.name)
        if isinstance(value, eqx.Module):
            _write(group.create_group(field.name), value)
        elif isinstance(value, jax.Array):
            group.create_dataset(field.name, data=np.asarray(value))
        elif value is not None:
            group.attrs[field.name] = value


def _read(group: Any) -> Any:
    kind = _KINDS[group.attrs["kind"]]
    # the fields are those of a finished module: __init__, which computes them, is not for files
    module = object.__new__(kind)
    for field in fields(kind):  # pyright: ignore[reportArgumentType]
        object.__setattr__(module, field.name, _read_field(group, field.name))
    return module


def _read_field(group: Any, name: str) -> Any:
    if name in group:
        item = group[name]
        return _read(item) if isinstance(item, h5py.Group) else jnp.asarray(item[()])
    if name not in group.attrs:
        return None
    value = group.attrs[name]
    return tuple(value.tolist()) if isinstance(value, np.ndarray) else value.item()


def _digest(group: Any) -> str:
    """BLAKE2b over names, types, shapes and bytes of everything in a group."""
    total = hashlib.blake2b(digest_size=32)

    def add(path: str, value: np.ndarray) -> None:
        total.update(f"{path} {value.dtype} {value.shape}".encode())
        total.update(np.ascontiguousarray(value).data)

    def visit(path: str, item: Any) -> None:
        for name, value in sorted(item.attrs.items()):
            total.update(f"{path}@{name}={np.asarray(value).tolist()}".encode())
        if isinstance(item, h5py.Dataset):
            add(path, np.asarray(item[()]))

    visit("", group)
    names: list[str] = []
    group.visit(names.append)
    for name in sorted(names):
        visit(name, group[name])
    return total.hexdigest()


def _require_format(path: str | Path, file: h5py.File) -> None:
    if file.attrs.get("format") != FORMAT:
        raise ValueError(f"{path} is an HDF5 file, but not a jaxtat plan.")
    if file.attrs["version"] != VERSION:
        raise ValueError(
            f"{path} is a jaxtat plan of version {file.attrs['version']}, this jaxtat reads "
            f"version {VERSION}: build the plan again."
        )
    if _digest(file["plan"]) != file.attrs["digest"]:
        raise ValueError(f"{path} is damaged (its digest does not match): build the plan again.")


def _require_consistent(path: str | Path, plan: ReconstructionPlan) -> None:
    frequencies, directions = plan.frequencies.shape[0], plan.angles.shape[0]
    wanted = (frequencies, directions, 2, plan.curve.n_detectors)
    if plan.densities.shape != wanted:
        raise ValueError(
            f"{path} holds densities of shape {plan.densities.shape}, but its geometry needs "
            f"{wanted}: build the plan again."
        )
