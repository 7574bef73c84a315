"""Reconstruction plans in HDF5.

A plan is a tree of modules. Each becomes a group with the name of its class; arrays become
datasets, sizes and flags attributes. A new curve, region or regularisation only has to be named in
`_KINDS`.

The file begins with a user block, which HDF5 leaves to its writer: a line with format, version and
a digest over all bytes behind the block. A damaged file is told by it before HDF5 sees the rest,
since HDF5 trusts what it reads, and may fill the whole memory for one wrong bit.
"""

import hashlib
from dataclasses import fields
from io import BufferedRandom, BufferedReader
from pathlib import Path
from typing import Any, cast

import equinox as eqx
import h5py
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, jaxtyped

from ..checks import require_x64
from ..densities import DensityReport, SampledDensities
from ..geometry import (
    CircularArc,
    Disk,
    ImageGrid,
    Polygon,
    RegionUnion,
    SampledCurve,
)
from ..harmonic import (
    DensityGroup,
    HarmonicDensities,
    RelativeTikhonov,
    Tikhonov,
    TikhonovNormBound,
)
from ..reconstruction import ReconstructionPlan, Setup
from ..reconstruction.plane_sizes import PlaneSizes
from ..regularization import (
    FixedRank,
    NormBound,
    RelativeCutoff,
    ResidualTarget,
    SingularValueCutoff,
    per_frequency,
)
from .atomic import replacing

FORMAT, VERSION = "jaxtat plan", 3
_BLOCK = 512  # [byte], the least HDF5 allows
_KINDS: dict[str, type[eqx.Module]] = {
    kind.__name__: kind
    for kind in (
        ReconstructionPlan,
        Setup,
        PlaneSizes,
        CircularArc,
        SampledCurve,
        Disk,
        Polygon,
        RegionUnion,
        ImageGrid,
        DensityReport,
        NormBound,
        FixedRank,
        SingularValueCutoff,
        RelativeCutoff,
        RelativeTikhonov,
        ResidualTarget,
        Tikhonov,
        TikhonovNormBound,
        SampledDensities,
        HarmonicDensities,
        DensityGroup,
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
        single = plan.densities.in_single_precision()
        plan = eqx.tree_at(lambda tree: tree.densities, plan, single)
    with replacing(path) as temporary:
        with h5py.File(temporary, "w", userblock_size=_BLOCK) as file:
            _write(file.create_group("plan"), plan)
        _seal(temporary)


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
    _require_whole(path)
    try:
        with h5py.File(path, "r") as file:
            plan = _read(file["plan"])
    except (OSError, LookupError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path} holds a plan that this jaxtat cannot read ({error}): build the plan again."
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
        elif _is_list_of_modules(value):
            members = group.create_group(field.name)
            for number, member in enumerate(value):
                _write(members.create_group(str(number)), member)
        elif isinstance(value, jax.Array | np.ndarray):
            group.create_dataset(field.name, data=np.asarray(value))
        else:
            group.attrs[field.name] = h5py.Empty("f8") if value is None else value


def _is_list_of_modules(value: Any) -> bool:
    return isinstance(value, tuple) and any(isinstance(member, eqx.Module) for member in value)


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
        if not isinstance(item, h5py.Group):
            return jnp.asarray(item[()])
        if "kind" in item.attrs:
            return _read(item)
        return tuple(_read(item[str(number)]) for number in range(len(item)))
    value = group.attrs[name]
    if isinstance(value, h5py.Empty):
        return None
    return tuple(value.tolist()) if isinstance(value, np.ndarray) else value.item()


def _seal(path: Path) -> None:
    """Write the user block of a finished file."""
    with path.open("r+b") as file:
        digest = _digest(file)
        file.seek(0)
        file.write(f"{FORMAT} {VERSION} {digest}\n".encode())


def _digest(file: BufferedReader | BufferedRandom) -> str:
    """BLAKE2b over all bytes behind the user block."""
    file.seek(_BLOCK)
    return hashlib.file_digest(file, hashlib.blake2b).hexdigest()


def _require_whole(path: str | Path) -> None:
    with Path(path).open("rb") as file:
        line = file.read(_BLOCK).split(b"\n")[0].decode(errors="replace")
        if not line.startswith(f"{FORMAT} "):
            raise ValueError(f"{path} is not a jaxtat plan, or its beginning is damaged.")
        version, _, digest = line.removeprefix(f"{FORMAT} ").partition(" ")
        if version != str(VERSION):
            raise ValueError(
                f"{path} is a jaxtat plan of version {version!r}, this jaxtat reads version "
                f"{VERSION}: build the plan again."
            )
        if digest != _digest(file):
            raise ValueError(
                f"{path} is damaged (its digest does not match): build the plan again."
            )


def _require_consistent(path: str | Path, plan: Any) -> None:
    """Every field against its annotation, and the densities against those who use them."""
    if not isinstance(plan, ReconstructionPlan):
        raise ValueError(f"{path} holds a {type(plan).__name__}, expected a plan.")
    # reports may be of one frequency or many, and so name their number in a way of their own
    for member in _require_fields(path, plan, plan.frequencies, Float[Array, "*frequencies"]):
        _require_fields(path, member, plan.angles, Float[Array, " directions"])
    n, m, detectors = len(plan.frequencies), len(plan.angles), plan.curve.n_detectors
    try:
        per_frequency(plan.regularization, n)
    except ValueError as error:
        raise ValueError(f"{path} holds a rule whose {error}: build the plan again.") from error
    try:
        data, weights = jax.ShapeDtypeStruct((n, 2, detectors), float), plan.curve.weights
        fhat = jax.eval_shape(plan.densities.polar_fourier, data, weights)
        last = jax.eval_shape(lambda w: plan.densities.of_frequency(n - 1, w), weights)
        if (fhat.shape, last.shape) != ((n, m), (m, 2, detectors)):
            raise ValueError(f"they give {fhat} and {last}")
    except (TypeError, ValueError, IndexError, ArithmeticError, AttributeError) as error:
        raise ValueError(
            f"{path} holds densities whose shape does not fit its {n} frequencies, {m} directions "
            f"and {detectors} detectors ({error}): build the plan again."
        ) from error


def _require_fields(
    path: str | Path, module: eqx.Module, known: Array, sizes: Any
) -> list[eqx.Module]:
    """Every field of a tree of modules, where one name stands for one size throughout.

    Members of tuples have sizes of their own: they are returned, not looked into.

    Args:
        path: of the file, for messages.
        module: the root of the tree.
        known, sizes: an array and the names of its sizes, which hold for the tree.
    """
    modules, members = [module], []
    with jaxtyped("context"):
        isinstance(known, sizes)
        for part in modules:  # grows
            for field in fields(part):  # pyright: ignore[reportArgumentType]
                value, wanted = getattr(part, field.name), cast(Any, field.type)
                if isinstance(value, tuple):
                    members.extend(member for member in value if isinstance(member, eqx.Module))
                    continue
                if not isinstance(value, wanted):
                    array = isinstance(value, Array)
                    found = f"of shape {value.shape} ({value.dtype})" if array else repr(value)
                    raise ValueError(
                        f"{path} holds {field.name} {found}, which does not fit its other arrays, "
                        f"expected ({getattr(wanted, 'dim_str', wanted)}): build the plan again."
                    )
                if isinstance(value, eqx.Module):
                    modules.append(value)
    return members
