"""Reconstruction plans in HDF5.

A plan is a tree of modules. Each becomes a group with the name of its class; arrays become
datasets, sizes and flags attributes, tuples of sizes as JSON. A new curve, region or
regularisation only has to be named in `_KINDS`.

The file begins with a user block, which HDF5 leaves to its writer: a line with format, version and
a digest over all bytes behind the block. Damage is detected by it before HDF5 sees the rest,
since HDF5 trusts what it reads, and may fill the whole memory for one wrong bit.
"""

import hashlib
import json
from dataclasses import fields, replace
from io import BufferedRandom, BufferedReader
from pathlib import Path
from typing import Any, cast, get_args, get_origin

import equinox as eqx
import h5py
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, jaxtyped

from ..base.atomic import replacing
from ..base.checks import require_x64
from ..base.cost import image_cost, require_room
from ..base.messages import name_of, require_file
from ..densities import DensityReport, SampledDensities
from ..densities.cylindrical_waves import DensityGroup, HarmonicDensities
from ..forward import CircleSizes, circle_sizes
from ..geometry import (
    CircularArc,
    DetectorCurve,
    Disk,
    ImageGrid,
    Polygon,
    Region,
    RegionUnion,
    SampledCurve,
)
from ..geometry.elements import MOST_NODES, checked_width
from ..reconstruction import ReconstructionPlan, Setup
from ..reconstruction.sizes import PlaneSizes
from ..regularization import (
    FixedRank,
    NormBound,
    RelativeCutoff,
    RelativeTikhonov,
    ResidualTarget,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
    per_frequency,
)
from .hdf5 import LONGEST_TEXT, Hdf5File, creating_hdf5, open_hdf5
from .limits import Allowance, refusing
from .scan import REAL

FORMAT, VERSION = "jaxtat plan", 7
_BLOCK = 512  # [byte], the least HDF5 allows
_KINDS: dict[str, type[eqx.Module]] = {
    kind.__name__: kind
    for kind in (
        ReconstructionPlan,
        Setup,
        PlaneSizes,
        CircleSizes,
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
    plan = _with_own_sizes(plan)
    with replacing(path) as temporary:
        arrays = jax.tree.leaves(eqx.filter(plan, eqx.is_array))
        with creating_hdf5(temporary, arrays, userblock_size=_BLOCK) as file:
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
    path = Path(path)
    require_file(path)
    name, again = name_of(path), ": build the plan again."
    with refusing(f"{name} ", "cannot be read"):
        _require_whole(path)
    with (
        refusing(f"{name} holds a plan that this jaxtat cannot read: ", after=again),
        open_hdf5(path, Allowance(path.stat().st_size)) as file,
    ):
        plan = _read(file, "plan", set())
    with refusing(f"{name} holds ", "what no plan can hold", again):
        _require_consistent(plan)
    return plan


def _with_own_sizes(plan: ReconstructionPlan) -> ReconstructionPlan:
    """The plan with the operator's sizes of its own positions, which may have been replaced."""
    setup = plan.setup
    sizes = replace(setup.sizes, operator=circle_sizes(setup.curve, setup.grid))
    return eqx.tree_at(
        lambda tree: tree.setup.sizes, plan, sizes, is_leaf=lambda part: part is setup.sizes
    )


def _write(group: h5py.Group, module: eqx.Module) -> None:
    kind = type(module).__name__
    if kind not in _KINDS:
        raise ValueError(
            f"plans with a {kind} cannot be saved: add it to the kinds in io/plans.py."
        )
    group.attrs["kind"] = np.bytes_(kind)  # of fixed length: it cannot lead anywhere
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
        elif isinstance(value, tuple):
            text = json.dumps(value)
            if len(text) > LONGEST_TEXT:
                raise ValueError(
                    f"plans with {len(value)} {field.name} in a {kind} cannot be saved."
                )
            group.attrs[field.name] = np.bytes_(text)
        else:
            group.attrs[field.name] = h5py.Empty("f8") if value is None else value


def _is_list_of_modules(value: Any) -> bool:
    return isinstance(value, tuple) and any(isinstance(member, eqx.Module) for member in value)


def _read(file: Hdf5File, where: str, seen: set[int]) -> Any:
    """The module in a group.

    Args:
        file: the file.
        where: path of the group.
        seen: which groups and arrays were read: each is read once, so that links neither lead
            round in a circle nor make much of little.
    """
    kind = _KINDS.get(file.attribute(where, "kind"))
    if kind is None:
        raise ValueError(f"no plan has a {file.attribute(where, 'kind')!r:.60}.")
    # the fields are those of a finished module: __init__, which computes them, is not for files
    module = object.__new__(kind)
    for field in fields(kind):  # pyright: ignore[reportArgumentType]
        object.__setattr__(module, field.name, _read_field(file, where, field.name, seen))
    return module


def _read_field(file: Hdf5File, where: str, name: str, seen: set[int]) -> Any:
    place = f"{where}/{name}"
    if not file.has(place):
        value = file.attribute(where, name)
        return _as_tuples(json.loads(value)) if isinstance(value, str) else value
    if file.identity(place) in seen:
        raise ValueError(f"{place} is there under two names.")
    seen.add(file.identity(place))
    if not file.is_group(place):
        return jax.device_put(file.read(place, REAL + "c"))
    if file.mark(place, "kind"):
        return _read(file, place, seen)
    return tuple(_read(file, f"{place}/{k}", seen) for k in range(len(file.names(place))))


def _as_tuples(value: Any) -> Any:
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value


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


def _require_whole(path: Path) -> None:
    with path.open("rb") as file:
        line = file.read(_BLOCK).split(b"\n")[0].decode(errors="replace")
        if not line.startswith(f"{FORMAT} "):
            raise ValueError("is not a jaxtat plan, or its beginning is damaged.")
        version, _, digest = line.removeprefix(f"{FORMAT} ").partition(" ")
        if version != str(VERSION):
            raise ValueError(
                f"is a jaxtat plan of version {version!r:.20}, this jaxtat reads version "
                f"{VERSION}: build the plan again."
            )
        if digest != _digest(file):
            raise ValueError("is damaged (its digest does not match): build the plan again.")


def _require_consistent(plan: Any) -> None:
    """Every field against its annotation, and the densities against those who use them."""
    if not isinstance(plan, ReconstructionPlan):
        raise ValueError(f"a {type(plan).__name__}, expected a plan.")
    _require_plane(plan.setup)
    _require_sizes(plan)
    # reports may be of one frequency or many, and so name their number in a way of their own
    each, directions = Float[Array, " frequencies"], Float[Array, " directions"]
    reported = Float[Array, "*frequencies"]
    known = (plan.frequencies, each), (plan.frequencies, reported), (plan.angles, directions)
    for member in _require_fields(plan, *known):
        _require_fields(member, (plan.angles, directions))
    ImageGrid(plan.grid.shape, plan.grid.half_width, plan.grid.center)  # refuses what is no grid
    if sum(jax.tree.leaves(plan.region.counts)) != plan.region.n_boundary:
        raise ValueError(f"a region whose counts {plan.region.counts} are not of its points.")
    _require_one_precision(plan)
    n, m, detectors = len(plan.frequencies), len(plan.angles), plan.curve.n_detectors
    if min(n, m, len(plan.radii)) == 0:
        raise ValueError("no frequencies, directions or radii.")
    largest = max(plan.grid.shape)  # a size, which no array of the file bears out
    with refusing("a grid whose "):
        require_room(
            lambda side: image_cost(tuple(k * side / largest for k in plan.grid.shape), n, m),
            largest,
        )
    try:
        per_frequency(plan.regularization, n)
    except ValueError as error:
        raise ValueError(f"a rule whose {error}.") from error
    try:
        data = jax.ShapeDtypeStruct((n, 2, detectors), float)
        weights = jax.ShapeDtypeStruct((detectors,), float)
        fhat = jax.eval_shape(plan.densities.polar_fourier, data, weights)
        last = jax.eval_shape(lambda w: plan.densities.of_frequency(n - 1, w), weights)
        if (fhat.shape, last.shape) != ((n, m), (m, 2, detectors)):
            raise ValueError(f"they give {fhat} and {last}")
    except (TypeError, ValueError, IndexError, ArithmeticError, AttributeError) as error:
        raise ValueError(
            f"densities whose shape does not fit its {n} frequencies, {m} directions "
            f"and {detectors} detectors ({error})."
        ) from error
    # of detectors whose number the densities bear out
    if plan.setup.sizes.operator != circle_sizes(plan.curve, plan.grid):
        raise ValueError("sizes of a forward operator that are not of its detectors and pixels.")
    try:
        checked_width(plan.curve.element_width, plan.curve.weights)
    except ValueError as error:
        raise ValueError(f"a curve whose {error}") from error


def _require_plane(setup: Any) -> None:
    """The parts of a setup, whose annotations leave open whether it is in the plane."""
    kinds = {"curve": DetectorCurve, "region": Region, "grid": ImageGrid, "sizes": PlaneSizes}
    for name, kind in kinds.items():
        part = getattr(setup, name, None)
        if not isinstance(part, kind):
            raise ValueError(f"a {type(part).__name__} as {name}, expected a {kind.__name__}.")
    if not setup.complete:
        raise ValueError("a setup with radii that do not cover its region.")


def _require_sizes(plan: ReconstructionPlan) -> None:
    """Check that numbers of frequencies and directions agree with the arrays."""
    sizes = plan.setup.sizes
    assert isinstance(sizes, PlaneSizes)
    _require_fields(sizes)
    found, shape = (sizes.n_frequencies, sizes.n_directions), np.shape(plan.report.residual)
    if found != shape:
        raise ValueError(f"{found} frequencies and directions, but residuals of shape {shape}.")
    if not 1 <= sizes.n_nodes <= MOST_NODES:
        raise ValueError(f"{sizes.n_nodes} nodes on an element, expected 1 to {MOST_NODES}.")
    ends = [0, *(stop for _, stop, _ in sizes.groups)]
    starts = [*(start for start, _, _ in sizes.groups), found[0]]
    if sizes.groups and (starts != ends or sorted({*ends}) != ends):
        raise ValueError(f"groups {sizes.groups} that are not of its {found[0]} frequencies.")


def _require_one_precision(plan: ReconstructionPlan) -> None:
    """Arrays of 64 bits, or densities of 32 bits among them, as `save_plan` has it."""

    def double(leaf: Array) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(leaf.shape, complex if jnp.iscomplexobj(leaf) else float)

    def types(tree: Any) -> list[Any]:
        return [leaf.dtype for leaf in jax.tree.leaves(tree)]

    whole = jax.tree.map(double, plan)
    half = jax.eval_shape(lambda densities: densities.in_single_precision(), whole.densities)
    if types(plan) not in (types(whole), types(eqx.tree_at(lambda p: p.densities, whole, half))):
        raise ValueError("arrays of different precision.")


def _require_fields(module: eqx.Module, *known: tuple[Array, Any]) -> list[eqx.Module]:
    """Every field of a tree of modules, where one name stands for one size throughout.

    Members of tuples have sizes of their own: they are returned, not looked into.

    Args:
        module: the root of the tree.
        known: arrays, each with the names of its sizes, which hold for the tree.
    """
    modules, members = [module], []
    with jaxtyped("context"):
        for array, sizes in known:
            isinstance(array, sizes)
        for part in modules:  # grows
            for field in fields(part):  # pyright: ignore[reportArgumentType]
                value, wanted = getattr(part, field.name), cast(Any, field.type)
                if get_origin(wanted) is tuple:
                    fits = _is_tuple_of(value, wanted)
                else:  # here and in no function, which would have sizes of its own
                    fits = wanted is Any or isinstance(value, wanted)
                if not fits:
                    array = isinstance(value, Array)
                    found = f"of shape {value.shape} ({value.dtype})" if array else f"{value!r:.60}"
                    raise ValueError(
                        f"{field.name} {found}, which does not fit its other arrays, "
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
