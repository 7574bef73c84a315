"""Proximal gradients with momentum: FISTA with restart.

Minimises ||H (B f - b)||² / 2 + w P(f) for f in C, L >= ||H B||², with H of `DataFit`:

    x_{k+1} = prox(y_k - B^T H^T H (B y_k - b) / L),
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
_POWER_STEPS = 9
_MARGIN = 1.05  # of L over what so many steps found; it grows where a step shows that it must


class State(NamedTuple):
    """The state of the iteration.

    Attributes:
        image, ahead: x and y, (stack, *space).
        fitted, fitted_ahead: B x and B y, (stack, *data).
        momentum: t.
        dual: of the proximal map.
        square: L.
        weight: w.
        step: k.
        change: ||x - y|| / ||x|| of the last step.
        history: of all steps, NaN where there was none, (max_steps,).
    """

    image: Float[Array, "stack *space"]
    ahead: Float[Array, "stack *space"]
    fitted: Float[Array, "stack *data"]
    fitted_ahead: Float[Array, "stack *data"]
    momentum: Float[Array, ""]
    dual: Any
    square: Float[Array, ""]
    weight: Float[Array, ""]
    step: Int[Array, ""]
    change: Float[Array, ""]
    history: Float[Array, " steps"]


class Scale(NamedTuple):
    """Sizes of a problem.

    Attributes:
        square: L, about ||H B||².
        image: max |B^T H^T H b| / L, the size of the image.
    """

    square: Float[Array, ""]
    image: Float[Array, ""]


def scale_of(fit: DataFit, data: Float[Array, "stack *data"]) -> Scale:
    """L by the power method, started from the back-projected data."""
    back = fit.transposed(data)
    norm = jnp.linalg.norm(back)
    start = jnp.where(norm > 0, back, fit.allowed(jnp.ones_like(back)))

    def normal(images: Array) -> Array:
        return fit.transposed(fit.modelled(images / jnp.linalg.norm(images)))

    grown = jax.lax.fori_loop(0, _POWER_STEPS, lambda _, images: normal(images), start)
    square = _MARGIN * jnp.linalg.norm(grown)
    size = jnp.max(jnp.abs(back)) / square
    return Scale(square, jnp.where(size > 0, size, 1.0))


def first(
    fit: DataFit,
    penalty: Any,
    initial: Float[Array, "stack *space"],
    scale: Scale,
    weight: Array,
    max_steps: int,
) -> State:
    """The state before the first step."""
    image, dual = fit.allowed(initial), jnp.zeros(())
    if isinstance(penalty, Penalty):
        dual = jnp.zeros(jax.eval_shape(penalty.parts, initial).shape, initial.dtype)
    fitted = fit.modelled(image)
    return State(
        image=image,
        ahead=image,
        fitted=fitted,
        fitted_ahead=fitted,
        momentum=jnp.ones((), initial.dtype),
        dual=dual,
        square=scale.square,
        weight=jnp.asarray(weight, initial.dtype),
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
    weight, ahead, square = state.weight, state.ahead, state.square
    if find_weight:
        found = balanced_weight(fit, penalty, state.image, state.fitted - data, scale)
        weight = found.astype(weight.dtype)
    down = ahead - fit.transposed(state.fitted_ahead - data) / square
    image, dual = nearest(fit, penalty, down, weight / square, scale, state.dual)
    fitted = fit.modelled(image)
    moved = jnp.sum((image - ahead) ** 2)
    stretched = fit.misfit(fitted - state.fitted_ahead) / jnp.where(moved > 0, moved, 1.0)
    uphill = jnp.sum((ahead - image) * (image - state.image)) > 0
    grown = (1 + jnp.sqrt(1 + 4 * state.momentum**2)) / 2
    carried = jnp.where(uphill, 0.0, (state.momentum - 1) / grown)
    change = _ratio(moved, jnp.sum(image**2))
    return State(
        image=image,
        ahead=image + carried * (image - state.image),
        fitted=fitted,
        fitted_ahead=fitted + carried * (fitted - state.fitted),
        momentum=jnp.where(uphill, 1.0, grown),
        dual=dual,
        square=jnp.where(stretched > square, _MARGIN * stretched, square),
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
    """The proximal map of any penalty, and its dual variable."""
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
