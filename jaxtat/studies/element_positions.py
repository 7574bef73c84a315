"""Positions of the elements of an array in space, from its record of an unknown volume.

A record d in units of its noise, and positions z_0 + s q, where s is how well they are known: the
most likely ones minimise

    J(f, q) = ||A(q) f - d||² + ||q||² + alpha ||f||²,   1/alpha the mean square of f.

By Gauss and Newton's method A(q) f becomes A f + D (q - q_k), with the derivatives D of A f_k. A
record depends on the position of its own element alone, so that D has three columns for each. What
an image leaves of y = d + D q_k gives q; put into J, that leaves one system of the image's size:

    q = P D^T (y - A f),   P = (D^T D + 1)^-1,   H f = A^T (1 - D P D^T) y,
    H = A^T (1 - D P D^T) A + alpha.

The inverse of the whole system has the block P + P D^T A H^-1 A^T D P of q: squares of standard
errors. Images and positions in turns would hardly move: an image holds the elements where they
were when it was fitted.

A voxel of the volume h³ at the distance r of an element sends it the pressure d/dr (δ(ct - r)/4πr)
h³. Counted in whole periods of the record, with omega = kappa c and times from t_0 on, it has

    ∫ p cos(omega (t - t_0)) c dt =   h³ kappa sin(kappa (r - c t_0)) / 4πr,
    ∫ p sin(omega (t - t_0)) c dt = - h³ kappa cos(kappa (r - c t_0)) / 4πr.

Start and speed of sound are no unknowns. They go with the size and place of the image, and in
trials came out wrong by several of their standard errors, as images of fewer waves cost less.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, real_array, require_positive
from ..base.linear_algebra import cholesky_solve
from ..base.rows import map_rows
from ..geometry.caps import DetectorPoints
from ..reconstruction import Setup
from ..reconstruction.setup import require_one_speed, require_setup
from ..records import require_equispaced

MAX_STEPS = 12
SETTLED = 0.02  # of the position error: steps that move coordinates by less end it
BAND = 0.8  # of π over a voxel: voxels in the region alone make no sharper cut in wavenumber
LEAST_WAVES = 3  # in a record
MOST = 2**31  # bytes of A
AT_ONCE = 8  # elements
CIRCLES = 3  # of points on an element: waves are long beside it


class ElementPositions(eqx.Module):
    """The elements where they most likely are, and how far that is determined.

    Attributes:
        curve: the detectors, with the positions that were found.
        standard_errors: of the positions, (detectors, 3) [length].
        image: the volume that was found with them, smooth and coarse.
        misfit: √(J / number of data), 1 where noise and position error are as they were given.
        moved: root mean square by which coordinates moved in each step, (steps,) [length].
    """

    curve: DetectorPoints
    standard_errors: Float[Array, "detectors 3"]
    image: Float[Array, "x1 x2 x3"]
    misfit: Float[Array, ""]
    moved: Float[Array, " steps"]


def calibrate_positions(
    setup: Setup,
    pressure: Numbers,
    times: Numbers,
    *,
    noise: Numbers,
    position_error: Numbers,
    sound_speed: Numbers = 1.0,
) -> ElementPositions:
    """min over f, q of ||A(q) f - d||² + ||q||² + alpha ||f||², positions z_0 + s q.

    Elements are displaced at random, independently of each other, in every coordinate by s. Waves
    up to 0.8 π over a voxel count. Choose voxels so large that the elements tell most of these
    waves from each other, of which there are (lambda R)³/14 in a ball of the radius R, and the
    shortest wave is six times as long as displacements, or more. Sources all over the region tell
    most, and none may be nearer to its edge than a voxel. Displacements along the sound are found
    several times better than across it.

    What no record tells is that all elements are moved or turned together, and the volume with
    them: of all displacements that explain it, these are the least. Speed of sound and start must
    be known.

    Args:
        setup: in space, of `DetectorPoints` where elements are believed to be; those of a size are
            displaced without being turned.
        pressure: (detectors, times), in any unit.
        times: equispaced, concrete; from before sound from the region comes until it ends [time].
        noise: standard deviation of white noise in the record [unit of pressure].
        position_error: s, of each coordinate of an element [length].
        sound_speed: c [length/time].

    Returns:
        ElementPositions.

    Raises:
        ValueError: for a setup in the plane, of rings or with a medium, times that are not
            equispaced or do not cover the region, a silent record or one of too few waves, noise or
            position_error not above zero, or more voxels and elements than there is room for.

    Source: variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432.

    >>> from jaxtat import Setup, VolumeGrid
    >>> from jaxtat.spherical import ball
    >>> z = np.random.default_rng(0).standard_normal((40, 3))
    >>> z *= 2 / np.linalg.norm(z, axis=1, keepdims=True)
    >>> setup = Setup(DetectorPoints(z), ball(1.0), VolumeGrid(9), max_frequency=4.0)
    >>> r = 0.8 + 0.08 * np.arange(31)
    >>> def record(z):  # of a ball
    ...     d = np.linalg.norm(z - np.array([0.1, 0.2, 0.0]), axis=1)[:, None]
    ...     return np.maximum(1 - ((d - r) / 0.5) ** 2, 0) ** 3 * (d - r) / (2 * d)
    >>> moved = z + 0.05 * (np.arange(40) == 7)[:, None] * z  # one of them, outward by 0.1
    >>> found = calibrate_positions(setup, record(moved), r, noise=1e-3, position_error=0.03)
    >>> bool(jnp.linalg.norm(found.curve.points - moved, axis=1).max() < 0.05)
    True
    """
    problem = _problem(setup, pressure, times, noise, position_error, sound_speed)
    state, system, step = _step(problem, _first(problem))
    steps = [step]
    while len(steps) < MAX_STEPS and steps[-1].moved >= SETTLED:
        state, system, step = _step(problem, state)
        steps.append(step)
    length = problem.position_error
    return ElementPositions(
        curve=_displaced(problem, state),
        standard_errors=length * _standard_errors(system),
        image=_on_grid(problem, state.values),
        misfit=step.misfit,
        moved=length * jnp.stack([step.moved for step in steps]),
    )


class _PositionsProblem(eqx.Module):
    """What is given, over the noise.

    Attributes:
        data: d, what records have of each wave.
        voxels: nodes of the grid in the region, and `inside` their numbers.
        offsets: of points of an element from its middle, and `weights` of these.
        numbers: kappa.
        origin: c t_0.
        factor: h³/(4π c dt), over the noise, for waves of norm 1.
    """

    setup: Setup
    data: Float[Array, "detectors waves"]
    inside: np.ndarray
    voxels: Float[Array, "voxels 3"]
    offsets: Float[Array, "detectors nodes 3"]
    weights: Float[Array, " nodes"]
    numbers: Float[Array, " half"]
    origin: Float[Array, ""]
    factor: Float[Array, ""]
    position_error: Float[Array, ""]


class _PositionsState(NamedTuple):
    """f and q."""

    values: Float[Array, " voxels"]
    shifts: Float[Array, "detectors 3"]


class _Move(NamedTuple):
    """Root mean square of what a step changed of q, and √(J / number of data)."""

    moved: Float[Array, ""]
    misfit: Float[Array, ""]


class _System(NamedTuple):
    """H, D^T A and P."""

    matrix: Float[Array, "voxels voxels"]
    mixed: Float[Array, "detectors 3 voxels"]
    inverse: Float[Array, "detectors 3 3"]


def _rows(
    problem: _PositionsProblem, point: Array, offsets: Array, shift: Array
) -> Float[Array, "waves voxels"]:
    """A of one element."""

    def of_node(total: Array, node: tuple[Array, Array]) -> tuple[Array, None]:
        offset, weight = node
        away = point + problem.position_error * shift + offset - problem.voxels
        distance = jnp.sqrt(jnp.sum(away**2, axis=1))
        phase = problem.numbers[:, None] * (distance - problem.origin)
        waves = jnp.concatenate([jnp.sin(phase), -jnp.cos(phase)])
        return total + weight * waves / distance, None

    zeros = jnp.zeros((2 * problem.numbers.shape[0], problem.voxels.shape[0]))
    total, _ = jax.lax.scan(of_node, zeros, (offsets, problem.weights))
    return problem.factor * jnp.tile(problem.numbers, 2)[:, None] * total


@eqx.filter_jit
def _first(problem: _PositionsProblem) -> _PositionsState:
    """Elements where they are thought to be, and back-projection by its best factor."""
    shifts = jnp.zeros_like(problem.setup.curve.points)
    rows, _ = _linearised(problem, _PositionsState(jnp.zeros(problem.voxels.shape[0]), shifts))
    back = jnp.einsum("dwn,dw->n", rows, problem.data)
    return _PositionsState(back * jnp.sum(back**2) / jnp.sum((rows @ back) ** 2), shifts)


def _linearised(
    problem: _PositionsProblem, state: _PositionsState
) -> tuple[Float[Array, "detectors waves voxels"], Float[Array, "detectors waves 3"]]:
    """A and D."""

    def of_element(element: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        point, offsets, shift = element

        def rows(shift: Array) -> Array:
            return _rows(problem, point, offsets, shift)

        return rows(shift), jax.jacfwd(lambda shift: rows(shift) @ state.values)(shift)

    return map_rows(
        of_element, (problem.setup.curve.points, problem.offsets, state.shifts), AT_ONCE
    )


@eqx.filter_jit
def _step(
    problem: _PositionsProblem, state: _PositionsState
) -> tuple[_PositionsState, _System, _Move]:
    """The minimum of J with the derivatives as they are."""
    rows, of_shifts = _linearised(problem, state)
    data = problem.data + jnp.einsum("dwi,di->dw", of_shifts, state.shifts)
    alpha = state.values.size / jnp.sum(state.values**2)
    inverse = _inverse(jnp.einsum("dwi,dwj->dij", of_shifts, of_shifts) + jnp.eye(3))
    mixed = jnp.einsum("dwi,dwn->din", of_shifts, rows)
    along = jnp.einsum("dij,djn->din", inverse, mixed)
    square = jnp.einsum("dwm,dwn->mn", rows, rows) - jnp.einsum("dim,din->mn", mixed, along)
    matrix = square + alpha * jnp.eye(len(square))
    own = jnp.einsum("dwi,dw->di", of_shifts, data)
    right = jnp.einsum("dwn,dw->n", rows, data) - jnp.einsum("din,di->n", along, own)
    values = cholesky_solve(matrix[None], right[None, :, None])[0, :, 0]
    shifts = jnp.einsum("dij,dj->di", inverse, own - mixed @ values)
    rest = data - rows @ values - jnp.einsum("dwi,di->dw", of_shifts, shifts)
    least = jnp.sum(rest**2) + jnp.sum(shifts**2) + alpha * jnp.sum(values**2)
    move = _Move(jnp.sqrt(jnp.mean((shifts - state.shifts) ** 2)), jnp.sqrt(least / data.size))
    return _PositionsState(values, shifts), _System(matrix, mixed, inverse), move


def _inverse(matrix: Float[Array, "n 3 3"]) -> Float[Array, "n 3 3"]:
    """Of regular 3 x 3 matrices, by cross products: `cholesky_solve` unrolls its blocks."""
    rows = jnp.moveaxis(matrix, 1, 0)
    pairs = jnp.stack([jnp.cross(rows[i - 2], rows[i - 1]) for i in range(3)], axis=-1)
    return pairs / jnp.sum(rows[0] * pairs[..., 0], axis=-1)[:, None, None]


@eqx.filter_jit
def _standard_errors(system: _System) -> Float[Array, "detectors 3"]:
    """Of q, by the diagonal of the inverse of the whole system."""
    matrix, mixed, inverse = system
    columns = jnp.einsum("dij,djn->ndi", inverse, mixed).reshape(len(matrix), -1)
    solved = cholesky_solve(matrix[None], columns[None])[0]
    of_image = jnp.sum(columns * solved, axis=0).reshape(-1, 3)
    return jnp.sqrt(jnp.einsum("dii->di", inverse) + of_image)


def _displaced(problem: _PositionsProblem, state: _PositionsState) -> DetectorPoints:
    curve = problem.setup.curve
    moved = curve.points + problem.position_error * state.shifts
    return eqx.tree_at(lambda each: each.points, curve, moved)


def _on_grid(
    problem: _PositionsProblem, values: Float[Array, " voxels"]
) -> Float[Array, "x1 x2 x3"]:
    shape = problem.setup.grid.shape
    return jnp.zeros(shape).at[tuple(np.unravel_index(problem.inside, shape))].set(values)


def _problem(
    setup: Setup,
    pressure: Numbers,
    times: Numbers,
    noise: Numbers,
    position_error: Numbers,
    sound_speed: Numbers,
) -> _PositionsProblem:
    """The arguments, checked."""
    require_setup(setup)
    curve, grid = setup.curve, setup.grid
    if not isinstance(curve, DetectorPoints):
        raise ValueError(
            f"the detectors are a {type(curve).__name__}, expected DetectorPoints: in space, "
            "where each has a position of its own."
        )
    require_one_speed(setup, "calibrate_positions")
    times = real_array("times", times, ("times",))
    require_equispaced(times)
    given = {"noise": noise, "position_error": position_error, "sound_speed": sound_speed}
    sizes = {name: real_array(name, value, ()) for name, value in given.items()}
    for name, value in sizes.items():
        require_positive(name, value)
    record = real_array("pressure", pressure, (curve.shape[0], times.shape[0]))
    if not np.asarray(record).any():
        raise ValueError("pressure is zero everywhere: there is nothing to calibrate with.")
    points = np.asarray(grid.points).reshape(-1, 3)
    paths = np.asarray(sizes["sound_speed"] * times)
    inside = np.flatnonzero(np.asarray(setup.region.contains(grid.points)))
    _require_covered(curve, points[inside], paths)
    waves, numbers = _waves_in(paths, BAND * np.pi / float(grid.spacing.max()))
    _require_room(len(waves) * len(record) * len(inside))
    offsets, weights = _nodes(curve)
    step = paths[1] - paths[0]
    size = float(jnp.prod(grid.spacing)) / (4 * np.pi * step) * np.sqrt(2 / len(paths))
    return _PositionsProblem(
        setup=setup,
        data=record @ (waves.T / sizes["noise"]),
        inside=inside,
        voxels=jax.device_put(points[inside]),
        offsets=offsets,
        weights=weights,
        numbers=jax.device_put(numbers),
        origin=jax.device_put(paths[0]),
        factor=size / sizes["noise"],
        position_error=sizes["position_error"],
    )


def _nodes(curve: DetectorPoints) -> tuple[Array, Array]:
    """Points of elements from their middles, (detectors, nodes, 3), and weights."""
    if curve.element_radius is None:
        return jnp.zeros((*curve.shape, 1, 3)), jnp.ones(1)
    nodes, weights = curve.element_nodes(CIRCLES)
    return jnp.swapaxes(nodes - curve.points, 0, 1), jnp.asarray(weights)


def _waves_in(
    paths: Float[np.ndarray, " times"], highest: float
) -> tuple[Float[np.ndarray, "waves times"], Float[np.ndarray, " half"]]:
    """Cosines and sines of whole periods in the record, of norm 1, and their kappa <= highest."""
    n = len(paths)
    step = 2 * np.pi / (n * (paths[1] - paths[0]))
    count = min(int(highest / step), (n - 1) // 2)
    if count < LEAST_WAVES:
        raise ValueError(
            f"the record has {count} waves up to the grid's highest, expected {LEAST_WAVES} or "
            "more: record longer, or take smaller voxels."
        )
    phases = 2 * np.pi / n * np.arange(1, count + 1)[:, None] * np.arange(n)
    waves = np.concatenate([np.cos(phases), np.sin(phases)])
    return np.sqrt(2 / n) * waves, step * np.arange(1, count + 1)


def _require_covered(curve: DetectorPoints, voxels: np.ndarray, paths: np.ndarray) -> None:
    """Raise ValueError unless sound from all voxels comes during the record."""
    middle = voxels.mean(axis=0)
    reach = np.linalg.norm(voxels - middle, axis=1).max()
    distance = np.linalg.norm(np.asarray(curve.points) - middle, axis=1)
    first, last = distance.min() - reach, distance.max() + reach
    if paths[0] > first or paths[-1] < last:
        raise ValueError(
            f"sound of the region comes from paths of {first:.4g} to {last:.4g}, and the record is "
            f"of {paths[0]:.4g} to {paths[-1]:.4g}: record more, or shrink the region."
        )


def _require_room(entries: int) -> None:
    if 8 * entries > MOST:
        raise ValueError(
            f"the record of all voxels takes {8e-9 * entries:.3g} GB, expected {MOST / 1e9:.2g} GB "
            "or less: take larger voxels, of which the elements tell all waves apart."
        )
