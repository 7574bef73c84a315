"""Images with constraints: the image that fits the data and costs least."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from tqdm import tqdm

from ..base.checks import (
    Numbers,
    by_library,
    constants,
    is_concrete,
    real_array,
    require_positive,
    whole_number,
)
from ..reconstruction import Setup
from ..reconstruction.setup import require_setup
from ..special import root
from . import alternating, fista
from .alternating import Split, products_of
from .arguments import (
    checked_data,
    checked_frequency,
    checked_penalty,
    checked_weight,
    data_fits,
    in_units_of,
    require_numbers,
    require_pressure,
    require_prox,
    weight_unit,
)
from .cancelling import can_be_cancelled, require_wanted, tell
from .coarse_grids import between_nodes, ladder, weight_on
from .data_fit import DataFit
from .extrapolation import Trail, empty_trail, extrapolated, is_kept
from .fista import Momentum
from .fit_memory import require_room_to_fit
from .implicit import Problem, with_derivatives
from .level import Level, scale_of
from .penalties import NoPenalty, Penalty, Ridge, is_known
from .progress import EVERY, Progress, after, before, wide_share
from .relative_cg import RelativeCG
from .spectrum import middle_pixel, spectrum_of
from .weight import balanced_weight

_BAR = "{desc} {percentage:3.0f}% |{bar}| {elapsed}<{remaining}{postfix}"


class ModelBased(eqx.Module):
    """An image and a report; all but ``image`` with one value for each image of a stack.

    Attributes:
        image: f, (..., *setup.grid.shape) [unit of g per length].
        weight: of the penalty.
        steps: taken on the last grid, each one product with A and one with its transpose.
        residual: ||W (A f - g)|| / ||W g||.
        remaining: how far the image is from where the iteration goes, relative, see
            `jaxtat.fitting.progress`.
        wide: share of its last move, of the square, in parts with no more than four periods across
            the grid: whether levels or edges and details are not settled.
        converged: whether that is below the tolerance.
        history: change of each step, ||f_k+1 - f_k|| / ||f_k+1||, or of two steps where the image
            is taken after two, extrapolation with it; NaN where there was none, (..., max_steps).
    """

    image: Float[Array, "*batch_and_space"]
    weight: Float[Array, "*batch"]
    steps: Int[Array, "*batch"]
    residual: Float[Array, "*batch"]
    remaining: Float[Array, "*batch"]
    wide: Float[Array, "*batch"]
    converged: Bool[Array, "*batch"]
    history: Float[Array, "*batch steps"]

    def unsettled(self) -> str:
        """In words, how and where more steps would change the image; of a stack the worst one."""
        left, wide = np.ravel(self.remaining), np.ravel(self.wide)
        worst = int(np.argmax(left))
        if not np.isfinite(left[worst]):
            return "too few steps to tell by how much more of them would change it"
        where = "wide parts, such as the level inside a body"
        if wide[worst] < 0.5:
            where = "edges and details, while levels of wide parts are settled"
        share = 100 * left[worst]
        if share < 0.5:
            return "more steps would change it by less than 0.5 %"
        return f"more steps would change it by some {share:.0f} %, most of that in {where}"


def model_based(
    setup: Setup,
    data: Numbers,
    *,
    penalty: Any = None,
    nonnegative: bool = False,
    weight: Numbers | None = None,
    noise: Numbers | None = None,
    mask: Any = None,
    times: Numbers | None = None,
    sound_speed: Numbers = 1.0,
    model: str = "2d",
    conditioning: Callable[[Array], Array] | None = None,
    element_responses: Numbers | None = None,
    max_frequency: Numbers | None = None,
    initial: Numbers | None = None,
    tolerance: float = 2e-3,
    max_steps: int = 500,
    steps: int | None = None,
    unrolled: bool = False,
    dtype: Any = None,
    progress: bool = False,
) -> ModelBased:
    """The image that minimises ||W (A f - g)||² / 2 + weight P(f), with f >= 0 if that is asked.

    A is `forward_operator`, P the penalty: total variation for objects with sharp edges. For few
    detectors, noise, and records that end early or have gaps, where the data do not determine the
    image. In the plane and in space, for detectors anywhere.

    With ``noise``, W divides by it, and of integrals in space a high-pass in the radius follows, so
    that fine details are found as fast as coarse ones: see `jaxtat.fitting.radial_filter`. Without,
    integrals are weighted by 1/√r, by which A nearly keeps norms. Records of pressure in space
    need neither: they tell all details equally well. By default the weight follows from image and
    misfit, see `jaxtat.fitting.weight`.

    Differentiable in both modes with respect to data, a given weight, noise, detectors, radii,
    speed of sound, responses, and what a penalty holds: implicitly, as if converged, a weight that
    was found being held. ``unrolled=True`` differentiates a fixed number of steps instead.

    Args:
        setup: detectors, region, grid and radii, which need not cover the region. Images are zero
            outside `Setup.may_sound`: the region, but for what is beyond the rim of a fast medium.
        data: g, (..., *setup.data_shape), or with ``times`` pressure, (..., detectors, samples).
            Images of a stack are found one by one, or with a joint penalty together.
        penalty: `TotalVariation()` (the default), `SecondOrderVariation`, `Ridge`, `NoPenalty`,
            or any proximal map: a function (images, step) -> images, such as a denoiser of that
            strength, with (stack, *grid.shape).
        nonnegative: whether f >= 0.
        weight: zero or more [with ``noise``, 1 over the unit of P].
        noise: standard deviation, one or of the shape of one image's data [unit of data].
        mask: where data count, of that shape, or (detectors, 1).
        times: of pressure, equispaced from t >= 0 [time].
        sound_speed: c [length/time]; of a setup with a medium it is the water's.
        model: in the plane "2d" or "in-plane", as in `circular_integrals_to_pressure`.
        conditioning: what each record went through: a linear function from (detectors, times) to
            (detectors, samples), the same for all detectors, such as
            ``functools.partial(condition_record, times=times, band=band, baseline=False)``.
        element_responses: one impulse response of each element at the steps of ``times``, time 0
            in the middle, (*detectors, taps); before the conditioning. In the plane steps take
            a quarter longer by them; one of all elements is better a part of the conditioning.
        max_frequency: above which images are taken to have no spectrum [rad/length]; by default
            π over the pixel's side. Finer pixels than the data resolve then cost little more.
        initial: image to start from, like the result, on the last grid at once; zeros instead if
            they explain the data better. By default fits on coarser grids come first, each of a
            quarter of the nodes along an axis.
        tolerance: how far the image may be from the minimum, relative, as the iteration estimates.
        max_steps: the most steps on a grid; an odd number is one more, but for maps of the user's.
        steps, unrolled: this many steps, none less and none extrapolated, through which derivatives
            go back.
        dtype: float32 for speed, with errors of 1e-5.
        progress: show a progress bar.

    Returns:
        ModelBased.

    Raises:
        ValueError: for data that do not fit, NaN, a negative weight, an unknown penalty, a proximal
            map that changes the shape or gives NaN, a mask that leaves nothing, what pressure needs
            without ``times``, a highest frequency that is traced or not above zero, or a volume
            whose fit exceeds the memory.

    Source: `jaxtat.fitting.alternating` with `extrapolation`, after `coarse_grids`; `fista` for
    maps of the user's; conjugate gradients for `Ridge` and `NoPenalty`.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 30), disk(1.0), ImageGrid(21), max_frequency=20.0)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> g = bell.circular_integrals(setup.curve, setup.radii)
    >>> found = model_based(setup, g, nonnegative=True, noise=1e-3)
    >>> error = abs(found.image - bell.image(setup.grid)).max()
    >>> bool(found.converged), bool(error < 0.1)
    (True, True)
    """
    require_setup(setup)
    penalty = checked_penalty(penalty)
    if times is None:
        require_pressure(sound_speed, model, conditioning, element_responses)
    recorded = times, sound_speed, model, conditioning, element_responses
    pressure = None if times is None else recorded
    highest = checked_frequency(max_frequency)
    if setup.grid.dimension == 3 and is_concrete(setup):
        n_samples = len(setup.radii) if times is None else np.shape(data)[-1]
        require_room_to_fit(setup, highest, n_samples)
    whole = initial is None and not unrolled and is_known(penalty)
    grids = ladder(setup.grid) if whole else [setup.grid]
    fits = data_fits(setup, pressure, nonnegative, noise, mask, highest, dtype, grids)
    data, batch, size = checked_data(data, fits[-1])
    if not is_known(penalty):
        size = jnp.ones_like(size)  # a map of the user's may do as it likes with large images
    fits, data = in_units_of(size, fits, data)
    space = setup.grid.shape
    start = None
    if initial is not None:
        start = real_array("initial", initial, ("...", *space))
        start = (jnp.broadcast_to(start, (*batch, *space)) / size).astype(data.dtype)
        start = start.reshape(-1, *space)
    unit = weight_unit(size, fits[-1], penalty)
    weight = checked_weight(weight, penalty, data.dtype)
    weight = None if weight is None else weight * unit
    if not is_known(penalty):
        first = jnp.zeros((1, *space), data.dtype) if start is None else start[:1]
        require_prox(penalty, first, jnp.ones((), data.dtype))
    stop = real_array("tolerance", tolerance, ())
    require_positive("tolerance", stop)
    joint = isinstance(penalty, Penalty) and penalty.joint
    stacks = [(data, start)]
    if not joint:
        starts = [None] * len(data) if start is None else _each(start)
        stacks = list(zip(_each(data), starts, strict=True))
    if unrolled != (steps is not None):
        raise ValueError("steps= and unrolled=True go together; max_steps bounds the others.")
    if unrolled:
        count = whole_number("steps", steps, 1)
        found = [_unrolled(fits[-1], d, penalty, weight, s, count) for d, s in stacks]
    else:
        count = whole_number("max_steps", max_steps, 1)
        found = [_fitted(fits, d, penalty, weight, s, stop, count, progress) for d, s in stacks]
    return by_library(_answer_of, (found, size, unit), (*batch, *space), None if joint else batch)


def _each(images: Array) -> list[Array]:
    """Stacks of one image."""
    return by_library(lambda xp, all: [all[k : k + 1] for k in range(len(all))], (images,))


def _answer_of(
    xp: Any,
    found: list[ModelBased],
    size: Any,
    unit: Any,
    shape: tuple[int, ...],
    batch: tuple[int, ...] | None,
) -> ModelBased:
    """What was found for each stack, in the units of the data; one for all without a batch."""

    def together(*each: Any) -> Any:
        return each[0] if batch is None else xp.stack(each).reshape((*batch, *each[0].shape))

    answer = jax.tree.map(together, *found)
    scaled = answer.image.reshape(shape) * size, answer.weight / unit
    return eqx.tree_at(lambda answer: (answer.image, answer.weight), answer, scaled)


class State(NamedTuple):
    """The state of an iteration; a trail where it is extrapolated."""

    image: Float[Array, "stack *space"]
    inner: Split | Momentum
    weight: Float[Array, ""]
    progress: Progress
    trail: Trail | None


def _fitted(
    fits: list[DataFit],
    data: Float[Array, "stack *data"],
    penalty: Any,
    weight: Float[Array, ""] | None,
    start: Float[Array, "stack *space"] | None,
    tolerance: Float[Array, ""],
    max_steps: int,
    progress: bool,
) -> ModelBased:
    """From grid to grid, with derivatives on the last one if any are asked for."""
    space, known = fits[-1].support.shape, is_concrete(fits, data, penalty, weight, start)
    if isinstance(penalty, Ridge | NoPenalty) and not fits[-1].nonnegative and weight is not None:
        most = jnp.asarray(max_steps)  # another number needs no other program
        level, state = _conjugate_gradients(
            fits[-1], data, penalty, weight, start, tolerance, most, max_steps
        )
        return _report(level, penalty, weight, state, tolerance, known)

    def solved_on(fit: DataFit, start: Array | None) -> tuple[Level, State]:
        shape = fit.support.shape
        here = weight_on(shape, space, penalty, weight)
        start = None if start is None else between_nodes(start, shape)
        level, state = begun(fit, data, penalty, here, start, max_steps)
        advance = partial(_advance, level, penalty, here is None)
        state = _until(advance, state, tolerance, max_steps, progress)
        if state.trail is None:
            return level, state
        # a mean of images is no nearest one in C: one iteration more, if any is left
        until = jnp.minimum(state.progress.step + 1, max_steps)
        return level, advance(state, -jnp.ones_like(tolerance), until)

    for fit in fits[:-1]:
        start = solved_on(fit, start)[1].image
    level, state = solved_on(fits[-1], start)
    require_numbers(penalty, state.image, state.progress.step)
    return _report(level, penalty, weight, state, tolerance, known)


def _until(
    advance: Callable[[State, Array, Array], State],
    state: State,
    tolerance: Array,
    max_steps: int,
    progress: bool,
) -> State:
    """Steps on one grid; the bar counts how much of the way, in orders of magnitude, is gone."""
    if not ((progress or can_be_cancelled()) and is_concrete(state.image)):
        return advance(state, tolerance, jax.device_put(np.asarray(max_steps)))
    grid, goal = " x ".join(map(str, state.image.shape[1:])), float(tolerance)
    with tqdm(total=100, desc=grid, bar_format=_BAR, disable=not progress) as bar:
        begun = None
        for until in (*range(2 * EVERY, max_steps, EVERY), max_steps):
            require_wanted()
            state = advance(state, tolerance, jax.device_put(np.asarray(until)))
            left = float(state.progress.remaining)
            begun = max(left, 2 * goal) if begun is None else begun
            gone = 100 if left <= goal else np.log(begun / left) / np.log(begun / goal) * 100
            step, off = int(state.progress.step), f"{left:.1e}"
            bar.set_postfix(step=step, off=off)
            tell(f"{grid}: step {step}, off by {off}")
            bar.update(max(0, int(gone) - bar.n) if np.isfinite(gone) else 0)
            if not left > goal:
                break
    return state


@eqx.filter_jit
def begun(
    fit: DataFit,
    data: Array,
    penalty: Any,
    weight: Array | None,
    start: Array | None,
    max_steps: int,
) -> tuple[Level, State]:
    """The problem on a grid and the state before the first step; from zeros without a start.

    With one product of B and one of its transpose, of all images: each is compiled by itself.
    """
    if start is None:
        image = jnp.zeros((len(data), *fit.support.shape), data.dtype)
        fitted, normal = jnp.zeros_like(data), jnp.zeros_like(image)
        pixel = fit.modelled(middle_pixel(fit))
        kernel, back = jnp.split(fit.transposed(jnp.concatenate([pixel, data])), [1])
    else:
        image = fit.allowed(start)
        fitted, pixel = jnp.split(
            fit.modelled(jnp.concatenate([image, middle_pixel(fit)])), [len(image)]
        )
        # of a start so large that squares overflow, or digits of the data are lost, nothing comes
        better = fit.misfit(fitted - data) <= fit.misfit(data)
        image, fitted = jnp.where(better, image, 0.0), jnp.where(better, fitted, 0.0)
        normal, kernel, back = jnp.split(
            fit.transposed(jnp.concatenate([fitted, pixel, data])), [len(image), len(image) + 1]
        )
    spectrum = spectrum_of(fit, penalty, kernel)
    level = Level(fit, data, back, spectrum, scale_of(spectrum, back))
    if weight is None:
        weight = balanced_weight(fit, penalty, image, fitted - data, level.scale)
    weight = weight.astype(image.dtype)
    if is_known(penalty):
        inner: Split | Momentum = alternating.split(level, penalty, weight, image, fitted, normal)
    else:
        inner = fista.momentum(level.scale, image, fitted)
    # In space fits end before it would help, and states take memory. One fit with a ridge, whose
    # weight followed the image, took half as many steps again.
    helps = isinstance(penalty, Penalty) and image.ndim == 3
    trail = empty_trail((image, inner)) if helps else None
    return level, State(image, inner, weight, before(image, max_steps), trail)


def _step(level: Level, penalty: Any, find_weight: bool, state: State) -> State:
    """One iteration, and at the end of a round where the last ones lead.

    With ``find_weight`` the weight follows the image. It is held while moves are kept, which then
    lead to the minimum of that weight.
    """
    fit, data, (image, inner, weight, progress, trail) = level.fit, level.data, state
    if isinstance(inner, Momentum):
        new, inner = fista.step(fit, data, penalty, weight, image, inner)
        return State(new, inner, weight, after(progress, image, new), trail)
    each = products_of(penalty)
    count = progress.step // each + 1
    if find_weight:
        misfit = inner.fitted - data
        found = balanced_weight(fit, penalty, image, misfit, level.scale).astype(weight.dtype)
        found = found if trail is None else jnp.where(is_kept(count), weight, found)
        inner, weight = alternating.of_weight(inner, weight, found), found
    new, inner = alternating.step(level, penalty, weight, image, inner)
    if trail is not None:
        between = partial(alternating.products_of_moves, level, weight, image)
        last = progress.step + each >= len(progress.history)
        (new, inner), trail = extrapolated(trail, (new, inner), count, between, last)
    moved = after(progress, image, new, each, extrapolated=trail is not None)
    return State(new, inner, weight, moved, trail)


@eqx.filter_jit
def _advance(
    level: Level, penalty: Any, find_weight: bool, state: State, tolerance: Array, until: Array
) -> State:
    """Steps until little remains or their number is reached.

    Without derivatives: loops with an unknown number of steps have none in reverse mode.
    """
    level, penalty, state = constants((level, penalty, state))

    def unfinished(state: State) -> Array:
        return (state.progress.remaining > tolerance) & (state.progress.step < until)

    return jax.lax.while_loop(unfinished, partial(_step, level, penalty, find_weight), state)


@eqx.filter_jit
def _conjugate_gradients(
    fit: DataFit,
    data: Array,
    penalty: Any,
    weight: Array,
    start: Array | None,
    tolerance: Array,
    most: Array,
    max_steps: int,
) -> tuple[Level, State]:
    """The minimum of a quadratic function, in units in which ||B|| is about 1."""
    level, state = begun(fit, data, penalty, weight, start, max_steps)
    held, weight, start = constants((level, weight, state.image))
    fit, square = held.fit, held.scale.square
    alpha = weight if isinstance(penalty, Ridge) else 0.0

    def normal(images: Array) -> Array:
        return (fit.transposed(fit.modelled(images)) + alpha * images) / square

    operator = lx.FunctionLinearOperator(
        normal, jax.ShapeDtypeStruct(start.shape, start.dtype), lx.positive_semidefinite_tag
    )
    wanted = held.back / square - normal(start)
    found = lx.linear_solve(operator, wanted, RelativeCG(tolerance, most), throw=False)
    left = jnp.where(found.result == lx.RESULTS.successful, 0.0, jnp.inf).astype(start.dtype)
    steps = jnp.asarray(found.stats["num_steps"])
    progress = state.progress._replace(step=steps, remaining=left)
    return level, state._replace(image=start + found.value, progress=progress, trail=None)


@eqx.filter_jit
def _unrolled(
    fit: DataFit, data: Array, penalty: Any, weight: Array | None, start: Array | None, steps: int
) -> ModelBased:
    """A fixed number of steps, each of them done again on the way back."""
    level, state = begun(fit, data, penalty, weight, start, steps)
    state = state._replace(trail=None)

    def advance(state: State, _: None) -> tuple[State, None]:
        return _step(level, penalty, weight is None, state), None

    each = products_of(penalty)
    state = jax.lax.scan(jax.checkpoint(advance), state, None, -(-steps // each))[0]
    return _answer(level, state.image, state, jnp.asarray(False))


@eqx.filter_jit
def _report(
    level: Level, penalty: Any, weight: Array | None, state: State, tolerance: Array, known: bool
) -> ModelBased:
    """The image at a fixed weight, with derivatives unless all that it depends on is known."""
    used = jax.lax.stop_gradient(state.weight) if weight is None else weight
    scale = level.scale
    if isinstance(state.inner, Momentum):  # the strength at which the map was applied
        scale = scale._replace(square=jax.lax.stop_gradient(state.inner.square))
    problem = Problem(level.fit, level.data, penalty, used, scale)
    image = state.image if known else with_derivatives(problem, state.image)
    done = state.progress.remaining <= tolerance
    return _answer(level, image, state._replace(weight=used), done)


def _answer(level: Level, image: Array, state: State, converged: Array) -> ModelBased:
    size = jnp.sum(level.data**2)
    left = jnp.sum((level.fit.modelled(image) - level.data) ** 2)
    residual = root(left / jnp.where(size > 0, size, 1.0))
    way, wide = state.progress, wide_share(state.progress.move)
    return ModelBased(
        image, state.weight, way.step, residual, way.remaining, wide, converged, way.history
    )
