"""From the data of all rotations to a volume: 2-D problems first, 2-D Radon inversions then.

The 2-D problem of angle φ gives the projection P_φ(u, v) of the volume along the lines. For every
v = x3 the projections of all angles are the Radon transform of the slice f(·, ·, x3), and steps 4
and 5 invert it, as they do for projections measured as such.
"""

import warnings
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from tqdm import tqdm

from ..base.checks import Numbers, data_array, is_concrete, real_array
from ..base.rows import in_groups
from ..geometry import ImageGrid, Region, VisibilityWarning
from ..reconstruction import ReconstructionPlan
from ..reconstruction import reconstruct as reconstruct_plane
from ..reconstruction import reconstruct_stack as reconstruct_plane_stack
from ..reconstruction.plan import require_plan
from ..steps.inversion import IMAGES, invert, require_inversion
from ..steps.radon import LowPass, polar_fourier_of_projections
from .scan import LineDetectorScan


def reconstruct(
    plan: ReconstructionPlan,
    g: Numbers,
    scan: LineDetectorScan,
    *,
    slices: ImageGrid | None = None,
    low_pass: LowPass | None = None,
    inversion: str = "fourier",
) -> Float[Array, "x1 x2 x3"]:
    """The initial pressure f(x1, x2, x3) from what rotating line detectors measure.

    Linear in g and differentiable; memory besides data, projections and volume is bounded. For
    more than fits into memory see `line_detectors.reconstruct_stack`.

    Exact where the projections of the object from all sides lie within ``plan.region`` and its
    mirror image about the axis (for half a turn: within both).

    Args:
        plan: of the 2-D problem in the plane (u, v), v along the axis; from `build_plan`. Its
            directions, over half a turn, are as many rotations as the volume needs
            (λ_max R and a quarter to spare).
        g: integrals over circles in that plane of f's integrals along the lines, float32 or
            float64, (rotations, detectors, radii): `pressure_to_circular_integrals` of the
            detectors' signals for waves in two dimensions.
        scan: angles and axis, see `jaxtat.line_detectors.scan`.
        slices: grid of (x1, x2); by default the nodes and spacing of u in both, centred on the
            axis.
        low_pass: as in `reconstruct`. It acts on the projections, in u and v alike, and so on all
            directions of the volume alike.
        inversion: of the 2-D problems and of the slices: "fourier" or "fbp", as in `reconstruct`.

    Returns:
        (x1, x2, x3), x3 at the nodes v of the plan's grid; the unit of g per length².

    Raises:
        ValueError: for data of the wrong shape or dtype, or with NaN, or an axis beside the grid.

    Warns:
        VisibilityWarning: for half a turn and a region on one side of the axis.

    Source: Burgholzer, Hofer, Paltauf, Haltmeier, Scherzer, IEEE Trans. Ultrason. Ferroelectr.
    Freq. Control 52 (2005) 1577 (line detectors); Kunyansky 2008, sections 1 and 3.
    """
    require_plan(plan)
    data = data_array(g, *plan.setup.data_shape)
    _require_rotations("g", data, scan)
    projections = reconstruct_plane(plan, data, low_pass=low_pass, inversion=inversion)
    return invert_projections(
        projections, scan, plan.grid, plan.region, slices=slices, inversion=inversion
    )


def invert_projections(
    projections: Numbers,
    scan: LineDetectorScan,
    grid: ImageGrid,
    region: Region,
    *,
    slices: ImageGrid | None = None,
    inversion: str = "fourier",
) -> Float[Array, "x1 x2 x3"]:
    """The slices of a volume from its projections P_φ(u, v), for instance those of `reconstruct`.

    Args:
        projections: (rotations, u, v).
        scan: angles and axis.
        grid: the nodes (u, v).
        region: where projections are known; elsewhere they are not used.
        slices, inversion: as in `line_detectors.reconstruct`.

    Returns:
        (x1, x2, x3).

    Raises, warns: as `line_detectors.reconstruct`.

    >>> from jaxtat import disk
    >>> grid, region = ImageGrid(33), disk(1.0)
    >>> scan = LineDetectorScan(np.arange(64) * np.pi / 64)
    >>> ball = 2 * np.sqrt(np.maximum(0.25 - np.sum(np.asarray(grid.points) ** 2, -1), 0))
    >>> volume = invert_projections(np.tile(ball, (64, 1, 1)), scan, grid, region)
    >>> bool(0.99 < volume[16, 16, 16] < 1.01)  # the middle of a ball of ones
    True
    """
    projections = real_array("projections", projections, ("rotations", *grid.shape))
    _require_rotations("projections", projections, scan)
    slices = _checked_slices(grid, region, scan, slices, inversion)
    weights = _weights(grid, region, scan)
    return _invert(projections, weights, scan, grid, slices, inversion)


def reconstruct_stack(
    plan: ReconstructionPlan,
    frames: Any,
    scan: LineDetectorScan,
    *,
    slices: ImageGrid | None = None,
    out: Any = None,
    projections: Any = None,
    batch_size: int = 32,
    low_pass: LowPass | None = None,
    inversion: str = "fourier",
    progress: bool = False,
) -> Any:
    """`line_detectors.reconstruct` that reads and writes a few rotations or slices at a time.

    Args:
        plan, scan, slices, low_pass, inversion: as in `line_detectors.reconstruct`.
        frames: g, (rotations, detectors, radii): an array, a memory map, an HDF5 dataset, or
            anything else with a shape that gives arrays for slices.
        out: where the volume goes, (x1, x2, x3): likewise anything that slices can be assigned to;
            by default a new array.
        projections: where the projections are kept, (rotations, u, v); by default a new array.
        batch_size: rotations or slices at a time, which bounds the memory.
        progress: show progress bars.

    Returns:
        ``out``.

    Raises:
        ValueError: for storage of the wrong shape, and as `line_detectors.reconstruct`.
    """
    _require_rotations("frames", frames, scan)
    slices = _checked_slices(plan.grid, plan.region, scan, slices, inversion)
    n_slices = plan.grid.shape[1]
    volume = (*slices.shape, n_slices)
    out = np.empty(volume) if out is None else out
    if tuple(out.shape) != volume:
        raise ValueError(f"out has shape {tuple(out.shape)}, expected {volume}.")
    projections = reconstruct_plane_stack(
        plan,
        frames,
        out=projections,
        batch_size=batch_size,
        low_pass=low_pass,
        inversion=inversion,
        progress=progress,
    )
    weights = np.asarray(_weights(plan.grid, plan.region, scan))
    size = min(batch_size, n_slices)
    with tqdm(total=n_slices, desc="slices", unit="slice", disable=not progress) as bar:
        for start in range(0, n_slices, size):
            here = slice(start, min(start + size, n_slices))
            n = here.stop - here.start
            # one compiled size: the last batch is filled up
            part = np.pad(np.asarray(projections[:, :, here]), ((0, 0), (0, 0), (0, size - n)))
            weight = np.pad(weights[:, here], ((0, 0), (0, size - n)))
            inverted = _invert(
                jnp.asarray(part), jnp.asarray(weight), scan, plan.grid, slices, inversion
            )
            out[:, :, here] = np.asarray(inverted)[:, :, :n]
            bar.update(n)
    return out


@eqx.filter_jit
def _invert(
    projections: Float[Array, "rotations u v"],
    weights: Float[Array, "u v"],
    scan: LineDetectorScan,
    grid: ImageGrid,
    slices: ImageGrid,
    inversion: str,
) -> Float[Array, "x1 x2 v"]:
    """Steps 4 and 5 for every v.

    The nodes u_i = axis + s_i lie anywhere between the offsets j h, j = -n..n-1 of step 4. They are
    moved to the nearest nodes about the middle, i - i_0, and the transform is turned by
    exp(-i lambda (s_i - (i - i_0) h)), the same for all i. Seen from the other side, s is -s and
    the transform its conjugate.
    """
    n_nodes, step = grid.shape[0], grid.spacing[0]
    middle = n_nodes // 2
    n = 2 * middle  # as far again as the grid reaches, as step 5 needs it
    shift = grid.x1[0] - scan.axis + middle * step
    frequency_step = jnp.pi / (n * step)
    turn = jnp.exp(-1j * (shift * frequency_step) * jnp.arange(n + 1))
    pad = (n - middle, 2 * n - (n - middle) - n_nodes)
    angles = scan.angles[: scan.n_rotations // (2 if scan.whole_turn else 1)]

    def of_slices(rows: Float[Array, "v rotations u"]) -> Float[Array, "v x1 x2"]:
        placed = jnp.pad(rows, ((0, 0), (0, 0), pad))
        fhat = polar_fourier_of_projections(placed, step) * turn[:, None]
        if scan.whole_turn:
            there, back = jnp.split(fhat, 2, axis=-1)
            fhat = there + back.conj()
        eta, center = jnp.ones(n + 1), jnp.zeros(2)
        return invert(fhat, frequency_step, angles, slices, center, eta, inversion)

    rows = jnp.moveaxis(projections * weights, -1, 0)
    return jnp.moveaxis(in_groups(of_slices, rows, IMAGES[inversion]), 0, -1)


@eqx.filter_jit
def _weights(grid: ImageGrid, region: Region, scan: LineDetectorScan) -> Float[Array, "u v"]:
    """1 in the region, 0 outside; over a whole turn, shared with the view from the other side.

    The shares go with the depth in the region, so that they join without a jump, which the ramp
    would amplify. On the boundary the depth is tiny, not 0, lest a line on the edge of both halves
    be lost.
    """
    here, behind = _depths(grid, region, scan)
    if not scan.whole_turn:
        return jnp.where(here > 0, 1.0, 0.0)
    return jnp.where(here > 0, here / jnp.where(here > 0, here + behind, 1.0), 0.0)


def _depths(grid: ImageGrid, region: Region, scan: LineDetectorScan) -> tuple[Array, Array]:
    """Depths in the region of each node (u, v), and of its mirror image about the axis."""
    points, edge = grid.points, 1e-9 * region.reach
    mirrored = jnp.stack([2 * scan.axis - points[..., 0], points[..., 1]], axis=-1)
    depths = 2 * edge - region.level(points), 2 * edge - region.level(mirrored)
    return jnp.maximum(depths[0], 0.0), jnp.maximum(depths[1], 0.0)


def _checked_slices(
    grid: ImageGrid,
    region: Region,
    scan: LineDetectorScan,
    slices: ImageGrid | None,
    inversion: str,
) -> ImageGrid:
    """The grid of slices, after the arguments are checked."""
    require_inversion(inversion)
    if is_concrete(grid, scan.axis):
        with jax.ensure_compile_time_eval():  # known inside jax.jit too
            first, last = float(grid.x1[0]), float(grid.x1[-1])
        if not first <= float(scan.axis) <= last:
            raise ValueError(
                f"the axis of rotation is u = {float(scan.axis):.6g}, but the grid runs from "
                f"u = {first:.6g} to {last:.6g}: the axis must lie within it. Check the unit of "
                "length."
            )
    if not scan.whole_turn and is_concrete(grid, region, scan):
        with jax.ensure_compile_time_eval():
            here, behind = (np.asarray(depth) > 0 for depth in _depths(grid, region, scan))
        alone = (here & ~behind).sum() / max(1, here.sum())
        if alone > 0.2:
            warnings.warn(
                f"{100 * alone:.0f} % of the region lie on one side of the axis u = "
                f"{float(scan.axis):.6g} only, and half a turn does not show them from the other: "
                "use a whole turn, or a region about the axis.",
                VisibilityWarning,
                stacklevel=3,
            )
    return ImageGrid(grid.shape[0], grid.half_width[0]) if slices is None else slices


def _require_rotations(name: str, data: Any, scan: LineDetectorScan) -> None:
    shape = tuple(getattr(data, "shape", ()))
    if len(shape) != 3 or shape[0] != scan.n_rotations:
        raise ValueError(
            f"{name} has shape {shape}, expected three axes, the first of them for the "
            f"{scan.n_rotations} rotations of the scan."
        )
