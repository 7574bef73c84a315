"""Reconstruction plans in HDF5: a text of the plan's structure (`stored_modules`), and its arrays.

The file begins with a user block, which HDF5 leaves to its writer: a line with format, version and
a digest over all bytes behind the block, by which damage is detected.
"""

import hashlib
import json
from dataclasses import replace
from io import BufferedRandom, BufferedReader
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.atomic import replacing
from ..base.checks import require_x64
from ..base.cost import image_cost, require_room
from ..base.messages import name_of, require_file
from ..forward import circle_sizes
from ..geometry import DetectorCurve, ImageGrid, Region
from ..geometry.elements import MOST_NODES, checked_width
from ..reconstruction import ReconstructionPlan
from ..reconstruction.sizes import PlaneSizes
from ..regularization import per_frequency
from .hdf5 import creating_hdf5
from .limits import Allowance, refusing
from .reader import read_file
from .stored_modules import from_plain, require_types, to_plain

FORMAT, VERSION = "jaxtat plan", 8
_BLOCK = 512  # [byte], the least HDF5 allows


def require_plan_or_new(path: str | Path) -> None:
    """Raise ValueError for a file that is there and no plan: a record may be lost."""
    place = Path(path)
    if not place.is_file():
        return
    with place.open("rb") as file:
        if file.read(len(FORMAT)) != FORMAT.encode():
            raise ValueError(
                f"cannot write {name_of(path)}: it is there, and no plan: expected a new name."
            )


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
    arrays: dict[str, np.ndarray] = {}
    text = json.dumps(to_plain(plan, arrays)).encode()
    with replacing(path) as temporary:
        with creating_hdf5(temporary, arrays.values(), userblock_size=_BLOCK) as file:
            file["plan"] = np.bytes_(text)
            for name, array in arrays.items():
                file.create_dataset(f"arrays/{name}", data=array)
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
    with refusing(f"{name} holds a plan that this jaxtat cannot read: ", after=again):
        parts = {"texts": ["plan"], "names": ["arrays/"], "attributes": []}
        content = read_file("arrays", path, Allowance(path.stat().st_size), **parts)
        arrays = {key.removeprefix("arrays/"): array for key, array in content.arrays.items()}
        plan = from_plain(json.loads(content.about["plan"] or ""), arrays)
    with refusing(f"{name} holds ", "what no plan can hold", again):
        _require_consistent(plan)
    return plan


def _with_own_sizes(plan: ReconstructionPlan) -> ReconstructionPlan:
    """The plan with the operator's sizes of its own positions, which may have been replaced."""
    setup = plan.setup
    sizes = replace(setup.sizes, operator=circle_sizes(setup.curve, setup.grid, setup.medium))
    return eqx.tree_at(
        lambda tree: tree.setup.sizes, plan, sizes, is_leaf=lambda part: part is setup.sizes
    )


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
    for member in require_types(plan, *known):
        require_types(member, (plan.angles, directions))
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
    if plan.setup.sizes.operator != circle_sizes(plan.curve, plan.grid, plan.setup.medium):
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
    require_types(sizes)
    counts, shape = (sizes.n_frequencies, sizes.n_directions), np.shape(plan.report.residual)
    if counts != shape:
        raise ValueError(f"{counts} frequencies and directions, but residuals of shape {shape}.")
    if not 1 <= sizes.n_nodes <= MOST_NODES:
        raise ValueError(f"{sizes.n_nodes} nodes on an element, expected 1 to {MOST_NODES}.")
    ends = [0, *(stop for _, stop, _ in sizes.groups)]
    starts = [*(start for start, _, _ in sizes.groups), counts[0]]
    if sizes.groups and (starts != ends or sorted({*ends}) != ends):
        raise ValueError(f"groups {sizes.groups} that are not of its {counts[0]} frequencies.")


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
