"""Proximal gradients with momentum: FISTA with restart.

Minimises ||B f - b||² / 2 + w P(f) for f in C, L >= ||B||²:

    x_{k+1} = prox(y_k - B^T (B y_k - b) / L),
    y_{k+1} = x_{k+1} + (t_k - 1) / t_{k+1} (x_{k+1} - x_k).

Where momentum leads uphill, t starts anew. x is a minimum where a step leaves it in its place, so
||x_{k+1} - y_k|| / ||x_{k+1}|| says how far it is from one.

Source: Beck and Teboulle, SIAM J. Imaging Sci. 2 (2009) 183-202; restart: O'Donoghue and Candès,
Found. Comput. Math. 15 (2015) 715-732.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .data_fit import DataFit
from .penalties import NoPenalty, Penalty, Ridge
from .proximal import prox
from .weight import balanced_weight

DUAL_STEPS = 10  # of a proximal map, which goes on where the last one ended
_POWER_STEPS = 12
_MARGIN = 1.05  # of L over what so many steps found


class State(NamedTuple):
    """Where the iteration is.

    Attributes:
        image, ahead: x and y, (stack, *space).
        momentum: t.
        dual: of the proximal map.
        weight: w.
        step: k.
        change: ||x - y|| / ||x|| of the last step.
        history: of all steps, NaN where there was none, (max_steps,).
    """

    image: Float[Array, "stack *space"]
    ahead: Float[Array, "stack *space"]
    momentum: Float[Array, ""]
    dual: Any
    weight: Float[Array, ""]
    step: Int[Array, ""]
    change: Float[Array, ""]
    history: Float[Array, " steps"]


class Scale(NamedTuple):
    """Sizes of a problem.

    Attributes:
        square: L >= ||B||².
        image: max |B^T b| / L, the size of the image.
    """

    square: Float[Array, ""]
    image: Float[Array, ""]


def scale_of(fit: DataFit, data: Float[Array, "stack *data"]) -> Scale:
    """L by the power method, from an image of ones, which no circular integral cancels."""
    ones = fit.allowed(jnp.ones((1, *fit.support.shape), data.dtype))

    def normal(images: Array) -> Array:
        return fit.transposed(fit.modelled(images / jnp.linalg.norm(images)))

    grown = jax.lax.fori_loop(0, _POWER_STEPS, lambda _, images: normal(images), ones)
    square = _MARGIN * jnp.linalg.norm(normal(grown))
    size = jnp.max(jnp.abs(fit.transposed(data))) / square
    return Scale(square, jnp.where(size > 0, size, 1.0))


def first(
    penalty: Any, initial: Float[Array, "stack *space"], weight: Array, max_steps: int
) -> State:
    """Before the first step."""
    dual = jnp.zeros(())
    if isinstance(penalty, Penalty):
        dual = jnp.zeros(jax.eval_shape(penalty.parts, initial).shape, initial.dtype)
    return State(
        image=initial,
        ahead=initial,
        momentum=jnp.ones((), initial.dtype),
        dual=dual,
        weight=weight,
        step=jnp.zeros((), int),
        change=jnp.full((), jnp.inf, initial.dtype),
        history=jnp.full(max_steps, jnp.nan, initial.dtype),
    )


def step(
    fit: DataFit,
    data: Float[Array, "stack *data"],
    penalty: Any,
    scale: Scale,
    find_weight: bool,
    state: State,
) -> State:
    """One step; with ``find_weight`` the weight follows the image."""
    misfit = fit.modelled(state.ahead) - data
    weight = state.weight
    if find_weight:
        weight = balanced_weight(fit, penalty, state.image, misfit, scale)
    down = state.ahead - fit.transposed(misfit) / scale.square
    image, dual = nearest(fit, penalty, down, weight / scale.square, scale, state.dual)
    ahead = state.ahead
    uphill = jnp.sum((ahead - image) * (image - state.image)) > 0
    grown = (1 + jnp.sqrt(1 + 4 * state.momentum**2)) / 2
    carried = jnp.where(uphill, 0.0, (state.momentum - 1) / grown)
    change = _ratio(jnp.sum((image - ahead) ** 2), jnp.sum(image**2))
    return State(
        image=image,
        ahead=image + carried * (image - state.image),
        momentum=jnp.where(uphill, 1.0, grown),
        dual=dual,
        weight=weight,
        step=state.step + 1,
        change=change,
        history=state.history.at[state.step].set(change),
    )


def nearest(
    fit: DataFit,
    penalty: Any,
    images: Float[Array, "stack *space"],
    weight: Float[Array, ""],
    scale: Scale,
    dual: Any,
) -> tuple[Float[Array, "stack *space"], Any]:
    """The proximal map of any penalty, and where its dual is."""
    if isinstance(penalty, Penalty):
        delta = penalty.smoothing * scale.image
        return prox(penalty, images, weight, delta, fit.allowed, dual, DUAL_STEPS)
    if isinstance(penalty, Ridge):
        images = images / (1 + weight)
    elif not isinstance(penalty, NoPenalty):
        images = penalty(images, weight)
    return fit.allowed(images), dual


def _ratio(square: Array, of: Array) -> Array:
    """Root of the ratio, with 0 of 0 being 0."""
    return jnp.sqrt(square / jnp.where(of > 0, of, 1.0))
