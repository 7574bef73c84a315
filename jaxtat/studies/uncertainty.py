"""Standard deviations of the pixels of an image for data with known noise.

A reconstruction is linear, f = L g. If the noise of the data is independent from sample to sample,
with standard deviations sigma_j, then exactly

    Var f_i = Σ_j L_ij² sigma_j²,

and row i of L is the adjoint of the reconstruction applied to an image of one bright pixel. Rows
come for a block of neighbouring pixels at a time, on a small grid of just these, and are summed up
at once: the matrix, 16641 x 64500 numbers at the paper's size, is never there as a whole.
"""

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from tqdm import tqdm

from ..base.checks import Numbers, by_library, is_concrete, real_array, require_objects
from ..geometry import DetectorCurve, ImageGrid, Region
from ..reconstruction import ReconstructionPlan, Setup, build_plan, reconstruct
from ..special import root
from ..steps.inversion import require_inversion
from ..steps.radon import LowPass, low_pass_values

BLOCK = 8  # pixels along each side: rows enough for matrix products, 33 MB at the paper's size


def pixel_standard_deviation(
    problem: Setup | ReconstructionPlan,
    sigma: Numbers,
    rule: Any = None,
    *,
    grid: ImageGrid | None = None,
    where: Any = None,
    low_pass: LowPass | None = None,
    inversion: str = "fourier",
    progress: bool = False,
) -> Float[Array, "x1 x2"]:
    """√Var f_i = √(Σ_j L_ij² sigma_j²) of images of `reconstruct`.

    Exact for independent noise of any distribution, without sampling. Differentiable with respect
    to sigma. Where the geometry is traced by `jax.jit` all pixels are computed, since those inside
    the region are not known yet.

    Args:
        problem: a plan, or a `Setup`, of which the plan is built first.
        sigma: standard deviation of the noise in g, zero or more: a number, one per detector,
            (detectors,), or one per sample, (detectors, radii) [unit of g].
        rule: of a setup, as in `solve` or `build_plan`; a plan has its own.
        grid: nodes where it is wanted, by default the problem's; a coarser one is faster.
        where: which of them, boolean, (x1, x2); by default those in the region.
        low_pass, inversion: as in `reconstruct`.
        progress: show a progress bar.

    Returns:
        (x1, x2), NaN where not wanted, the unit of g per length.

    Raises:
        ValueError: for sigma of the wrong shape, negative or NaN, a ``where`` that is not boolean
            or of the wrong shape, and an unknown inversion.

    Source: propagation of variance; e.g. Tarantola, Inverse Problem Theory (SIAM 2005), section 3.

    >>> from jaxtat import ImageGrid, circular_arc, disk
    >>> setup = Setup(circular_arc(1.3, 1.0, 40), disk(1.0), ImageGrid(11))
    >>> spread = pixel_standard_deviation(setup, 0.1, 1e-6)
    >>> spread.shape, bool(jnp.isnan(spread[0, 0])), bool(spread[5, 5] > 0)
    ((11, 11), True, True)
    """
    plan = _plan(problem, rule, progress)
    grid = plan.grid if grid is None else grid
    require_objects(grid=grid)
    variance = _variance(sigma, plan.curve, plan.radii)
    wanted = _wanted(where, plan.region, grid)
    n = plan.frequencies.shape[0]
    eta = low_pass_values(low_pass, n)
    require_inversion(inversion)
    of_block = partial(_of_block, plan, eta, variance, inversion=inversion)
    return _map(of_block, grid, wanted, progress)


def _plan(problem: Setup | ReconstructionPlan, rule: Any, progress: bool) -> ReconstructionPlan:
    if isinstance(problem, ReconstructionPlan):
        if rule is not None:
            raise ValueError(f"rule is {rule!r}, but the plan has its own: pass the setup instead.")
        return problem
    return build_plan(problem, rule, progress=progress)


def _variance(
    sigma: Numbers, curve: DetectorCurve, radii: Array
) -> Float[Array, "detectors radii"]:
    """sigma² of every sample."""
    shape = curve.n_detectors, radii.shape[0]
    sigma = real_array("sigma", sigma, None)
    if sigma.shape not in ((), shape[:1], shape):
        raise ValueError(
            f"sigma has shape {sigma.shape}, expected a number, ({shape[0]},) or {shape}."
        )
    if is_concrete(sigma) and not bool(np.all(np.asarray(sigma) >= 0)):
        raise ValueError(f"sigma goes down to {float(sigma.min()):.6g}, expected zero or more.")
    return jnp.broadcast_to(sigma[:, None] if sigma.ndim == 1 else sigma, shape) ** 2


def _wanted(where: Any, region: Region, grid: ImageGrid) -> Bool[Array | np.ndarray, "x1 x2"]:
    wanted = region.contains(grid.points) if where is None else where
    wanted = np.asarray(wanted) if is_concrete(wanted) else wanted
    if wanted.dtype != bool or wanted.shape != grid.shape:
        raise ValueError(
            f"where has dtype {wanted.dtype} and shape {wanted.shape}, expected booleans "
            f"{grid.shape}."
        )
    return wanted


def _map(
    of_block: Callable[[ImageGrid], Array],
    grid: ImageGrid,
    wanted: Bool[Array | np.ndarray, "x1 x2"],
    progress: bool,
) -> Float[Array, "x1 x2"]:
    """Standard deviations block by block; blocks without a wanted pixel are skipped."""
    blocks = [-(-n // BLOCK) for n in grid.shape]
    if is_concrete(wanted, grid):
        found = _some_blocks(of_block, grid, np.asarray(wanted), blocks, progress)
    else:
        places = BLOCK * np.argwhere(np.ones(blocks))
        found = jax.lax.map(lambda place: of_block(_block(grid, place)), places)
    return by_library(_joined, (found, wanted), blocks)


def _joined(xp: Any, found: Any, wanted: Any, blocks: list[int]) -> Any:
    """The image of blocks, NaN where it is not wanted."""
    rows, columns = wanted.shape
    image = xp.stack(found).reshape(*blocks, BLOCK, BLOCK).swapaxes(1, 2)
    image = image.reshape(BLOCK * blocks[0], BLOCK * blocks[1])[:rows, :columns]
    return xp.where(wanted, image, np.nan)


def _some_blocks(
    of_block: Callable[[ImageGrid], Array],
    grid: ImageGrid,
    wanted: Bool[np.ndarray, "x1 x2"],
    blocks: list[int],
    progress: bool,
) -> list[Array | np.ndarray]:
    """Row by row, NaN in those left out."""
    beyond = [(0, -n % BLOCK) for n in grid.shape]
    tiles = np.pad(wanted, beyond).reshape(blocks[0], BLOCK, blocks[1], BLOCK).swapaxes(1, 2)
    places = np.argwhere(tiles.any(axis=(2, 3)))
    found: dict[tuple[int, ...], Array] = {}
    bar = tqdm(
        total=int(wanted.sum()), desc="standard deviations", unit="pixel", disable=not progress
    )
    with bar:
        for place in places:
            spread = of_block(_block(grid, BLOCK * place))
            if is_concrete(spread):
                spread.block_until_ready()  # or the bar would run ahead
            found[tuple(place)] = spread
            bar.update(int(tiles[tuple(place)].sum()))
    left_out = np.full((BLOCK, BLOCK), np.nan)
    return [found.get(place, left_out) for place in np.ndindex(*blocks)]


def _block(grid: ImageGrid, first: Any) -> ImageGrid:
    """BLOCK x BLOCK nodes of the grid from ``first`` on, perhaps beyond its end."""
    # of a known grid known inside jax.jit too
    with jax.ensure_compile_time_eval() if is_concrete(grid, first) else nullcontext():
        corner, half = grid.center - grid.half_width, (BLOCK - 1) / 2
        return ImageGrid(BLOCK, half * grid.spacing, corner + (first + half) * grid.spacing)


@eqx.filter_jit
@eqx.filter_checkpoint  # derivatives make the rows anew rather than keep them
def _of_block(
    plan: ReconstructionPlan, eta: Array, variance: Array, block: ImageGrid, inversion: str
) -> Float[Array, "x1 x2"]:
    """Standard deviations at all nodes of a small grid."""
    n = block.shape[0] * block.shape[1]
    here = eqx.tree_at(lambda tree: tree.setup.grid, plan, block)
    data = jax.ShapeDtypeStruct((n, *variance.shape), variance.dtype)
    options = {"low_pass": lambda _: eta, "inversion": inversion}
    adjoint = jax.linear_transpose(lambda g: reconstruct(here, g, **options), data)
    (rows,) = adjoint(jnp.eye(n).reshape(n, *block.shape))
    return root(jnp.einsum("ijk,jk->i", rows**2, variance)).reshape(block.shape)
