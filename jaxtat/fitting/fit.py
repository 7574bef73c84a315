"""Images with constraints: the image that fits the data and costs least."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float, Int
from tqdm import tqdm

from ..base.checks import (
    Numbers,
    constants,
    is_concrete,
    real_array,
    require_positive,
    whole_number,
)
from ..reconstruction import Setup
from ..special import root
from .arguments import (
    checked_data,
    checked_penalty,
    checked_weight,
    data_fit,
    in_units_of,
    require_numbers,
    require_pressure,
    require_prox,
    weight_unit,
)
from .data_fit import DataFit
from .fista import Scale, State, first, scale_of, step
from .implicit import Problem, with_derivatives
from .penalties import NoPenalty, Penalty, Ridge
from .relative_cg import RelativeCG

_AT_A_TIME = 10  # steps between two looks at the progress


class ModelBased(eqx.Module):
    """An image and a report; all but ``image`` with one value for each image of a stack.

    Attributes:
        image: f, (..., *setup.grid.shape) [unit of g per length].
        weight: of the penalty.
        steps: taken, each one product with A and one with its transpose.
        residual: ||W (A f - g)|| / ||W g||.
        converged: whether the tolerance was met before ``max_steps``.
        history: change of each step, ||f_k+1 - y_k|| / ||f_k+1||, NaN where there was none,
            (..., max_steps).
    """

    image: Float[Array, "*batch_and_space"]
    weight: Float[Array, "*batch"]
    steps: Int[Array, "*batch"]
    residual: Float[Array, "*batch"]
    converged: Bool[Array, "*batch"]
    history: Float[Array, "*batch steps"]


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
    everywhere: bool = False,
    initial: Numbers | None = None,
    tolerance: float | None = None,
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

    With ``noise``, W divides by it, and in space a high-pass in the radius follows, so that fine
    details are found as fast as coarse ones: see `jaxtat.fitting.radial_filter`. Without,
    integrals are weighted by 1/√r, by which A nearly keeps norms. By default the weight follows
    from image and misfit, see `jaxtat.fitting.weight`.

    Differentiable in both modes with respect to data, a given weight, noise, detectors, radii,
    speed of sound, and what a penalty holds: implicitly, as if converged, a weight that was found
    being held. ``unrolled=True`` differentiates a fixed number of steps instead.

    Args:
        setup: detectors, region, grid and radii, which need not cover the region.
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
        model: "2d" or "in-plane", as in `circular_integrals_to_pressure`.
        conditioning: what each record went through: a linear function from (detectors, times) to
            (detectors, samples), the same for all detectors, such as
            ``functools.partial(condition_record, times=times, band=band, baseline=False)``.
        everywhere: f may differ from zero on all of the grid, not only in the region.
        initial: image to start from, like the result; zero by default. From the formula's image it
            takes fewer steps where there is little noise, and more where there is much.
        tolerance: of the change of the image in a step, relative, at which to stop; 1e-4 by
            default, and 1e-5 for an incomplete setup, where the last steps count.
        max_steps: the most steps.
        steps, unrolled: this many steps, none less, through which derivatives go back.
        dtype: float32 for speed, with errors of 1e-5.
        progress: show a progress bar.

    Returns:
        ModelBased.

    Raises:
        ValueError: for data that do not fit, NaN, a negative weight, an unknown penalty, a proximal
            map that changes the shape or gives NaN, a mask that leaves nothing, or what pressure
            needs without ``times``.

    Source: `jaxtat.fitting.fista`; conjugate gradients for `Ridge` and `NoPenalty`.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 30), disk(1.0), ImageGrid(21), max_frequency=20.0)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> g = bell.circular_integrals(setup.curve, setup.radii)
    >>> found = model_based(setup, g, nonnegative=True)
    >>> error = abs(found.image - bell.image(setup.grid)).max()
    >>> bool(found.converged), bool(error < 0.1)
    (True, True)
    """
    penalty = checked_penalty(penalty)
    if times is None:
        require_pressure(sound_speed, model, conditioning)
    pressure = None if times is None else (times, sound_speed, model, conditioning)
    fit = data_fit(setup, pressure, nonnegative, noise, mask, everywhere, dtype)
    data, batch, size = checked_data(data, fit)
    if not isinstance(penalty, Penalty | Ridge | NoPenalty):
        size = jnp.ones_like(size)  # a map of the user's may do as it likes with large images
    fit, data = in_units_of(size, fit, data)
    space = setup.grid.shape
    start = jnp.zeros(space) if initial is None else real_array("initial", initial, ("...", *space))
    start = (jnp.broadcast_to(start, (*batch, *space)) / size).astype(data.dtype)
    start, unit = start.reshape(-1, *space), weight_unit(size, fit, penalty)
    weight = checked_weight(weight, penalty, data.dtype)
    weight = None if weight is None else weight * unit
    require_prox(penalty, start[:1], jnp.ones((), data.dtype))
    if tolerance is None:
        tolerance = 1e-4 if setup.complete else 1e-5
    stop = real_array("tolerance", tolerance, ())
    require_positive("tolerance", stop)
    joint = isinstance(penalty, Penalty) and penalty.joint
    parts = (
        [(data, start)] if joint else [(d[None], s[None]) for d, s in zip(data, start, strict=True)]
    )
    if unrolled != (steps is not None):
        raise ValueError("steps= and unrolled=True go together; max_steps bounds the others.")
    if unrolled:
        count = whole_number("steps", steps, 1)
        found = [_unrolled(fit, d, penalty, weight, s, count) for d, s in parts]
    else:
        count = whole_number("max_steps", max_steps, 1)
        found = [_found(fit, d, penalty, weight, s, stop, count, progress) for d, s in parts]
    answer = jax.tree.map(lambda *each: jnp.stack(each), *found)
    if joint:
        answer = jax.tree.map(lambda leaf: leaf[0], answer)
    else:
        answer = jax.tree.map(lambda leaf: leaf.reshape(*batch, *leaf.shape[1:]), answer)
    image = answer.image.reshape(*batch, *space) * size
    return eqx.tree_at(
        lambda answer: (answer.image, answer.weight), answer, (image, answer.weight / unit)
    )


def _found(
    fit: DataFit,
    data: Float[Array, "stack *data"],
    penalty: Any,
    weight: Float[Array, ""] | None,
    start: Float[Array, "stack *space"],
    tolerance: Float[Array, ""],
    max_steps: int,
    progress: bool,
) -> ModelBased:
    """One image, or the images of one joint stack, with derivatives."""
    scale = _scale(fit, data)
    if isinstance(penalty, Ridge | NoPenalty) and not fit.nonnegative and weight is not None:
        most = jnp.asarray(max_steps)  # another number needs no other program
        state = _conjugate_gradients(fit, data, penalty, weight, start, scale, tolerance, most)
        answer = _report(fit, data, penalty, scale, weight, state, tolerance)
        none = jnp.full(max_steps, jnp.nan, data.dtype)
        return eqx.tree_at(lambda answer: answer.history, answer, none)
    state = _started(fit, penalty, start, scale, weight, max_steps)
    follows = fit, data, penalty, scale, weight is None
    with tqdm(total=max_steps, unit="step", disable=not progress) as bar:
        if progress and is_concrete(data, start):
            for until in range(_AT_A_TIME, max_steps, _AT_A_TIME):
                state = _advance(*follows, state, tolerance, jnp.asarray(until))
                bar.set_postfix(change=f"{float(state.change):.1e}")
                bar.update(int(state.step) - bar.n)
                if float(state.change) <= tolerance:
                    break
        state = _advance(*follows, state, tolerance, jnp.asarray(max_steps))
    require_numbers(penalty, state.change, state.step)
    return _report(fit, data, penalty, scale, weight, state, tolerance)


@eqx.filter_jit
def _scale(fit: DataFit, data: Array) -> Scale:
    return scale_of(fit, data)


@eqx.filter_jit
def _started(
    fit: DataFit, penalty: Any, start: Array, scale: Scale, weight: Array | None, max_steps: int
) -> State:
    fit, penalty, start, scale = constants((fit, penalty, start, scale))
    given = jnp.zeros(()) if weight is None else jax.lax.stop_gradient(weight)
    return first(fit, penalty, start, scale, given, max_steps)


@eqx.filter_jit
def _advance(
    fit: DataFit,
    data: Array,
    penalty: Any,
    scale: Scale,
    find_weight: bool,
    state: State,
    tolerance: Array,
    until: Array,
) -> State:
    """Steps until the change is small or their number is reached.

    Without derivatives: loops with an unknown number of steps have none in reverse mode.
    """
    fit, data, penalty, scale, state = constants((fit, data, penalty, scale, state))

    def unfinished(state: State) -> Array:
        return (state.change > tolerance) & (state.step < until)

    def advance(state: State) -> State:
        return step(fit, data, penalty, scale, find_weight, state)

    return jax.lax.while_loop(unfinished, advance, state)


@eqx.filter_jit
def _conjugate_gradients(
    fit: DataFit,
    data: Array,
    penalty: Any,
    weight: Array,
    start: Array,
    scale: Scale,
    tolerance: Array,
    max_steps: Array,
) -> State:
    """The minimum of a quadratic function, in units in which ||B|| is 1."""
    fit, data, weight, scale, start = constants((fit, data, weight, scale, start))
    alpha = weight if isinstance(penalty, Ridge) else 0.0

    def normal(images: Array) -> Array:
        return (fit.transposed(fit.modelled(images)) + alpha * images) / scale.square

    operator = lx.FunctionLinearOperator(
        normal, jax.ShapeDtypeStruct(start.shape, start.dtype), lx.positive_semidefinite_tag
    )
    start = fit.allowed(start)
    wanted = fit.transposed(data) / scale.square - normal(start)
    found = lx.linear_solve(operator, wanted, RelativeCG(tolerance, max_steps), throw=False)
    change = jnp.where(found.result == lx.RESULTS.successful, 0.0, jnp.inf).astype(data.dtype)
    state = first(fit, penalty, start + found.value, scale, weight, 0)
    return state._replace(step=jnp.asarray(found.stats["num_steps"]), change=change)


@eqx.filter_jit
def _unrolled(
    fit: DataFit, data: Array, penalty: Any, weight: Array | None, start: Array, steps: int
) -> ModelBased:
    """A fixed number of steps, each of them done again on the way back."""
    scale = scale_of(fit, data)

    def advance(state: State, _: None) -> tuple[State, None]:
        return step(fit, data, penalty, scale, weight is None, state), None

    given = jnp.zeros(()) if weight is None else weight
    state = first(fit, penalty, start, scale, given, steps)
    state = jax.lax.scan(jax.checkpoint(advance), state, None, steps)[0]
    return _answer(fit, data, state.image, state, jnp.asarray(False))


@eqx.filter_jit
def _report(
    fit: DataFit,
    data: Array,
    penalty: Any,
    scale: Scale,
    weight: Array | None,
    state: State,
    tolerance: Array,
) -> ModelBased:
    """The image with derivatives, at a fixed weight."""
    used = jax.lax.stop_gradient(state.weight) if weight is None else weight
    image = with_derivatives(Problem(fit, data, penalty, used, scale), state.image)
    return _answer(fit, data, image, state._replace(weight=used), state.change <= tolerance)


def _answer(fit: DataFit, data: Array, image: Array, state: State, converged: Array) -> ModelBased:
    size = jnp.sum(data**2)
    left = jnp.sum((fit.modelled(image) - data) ** 2)
    residual = root(left / jnp.where(size > 0, size, 1.0))
    return ModelBased(image, state.weight, state.step, residual, converged, state.history)
