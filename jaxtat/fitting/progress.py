"""How far an iteration has come, and how far it is from where it goes.

Every `EVERY` steps the image has moved by d_k from where it was. Once it moves along its slowest
direction, d_k shrink by a factor q each time, and what is left of the way is

    d_k+1 + d_k+2 + ... = d_k q / (1 - q),    q = d_k / d_k-1,

relative to the image's norm. q is taken between 0.5 and 0.95, so that chance does not end it.

Source: Aitken, Proc. R. Soc. Edinburgh 46 (1927) 289-305.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

EVERY = 20
_FASTEST, _SLOWEST = 0.5, 0.95


class Progress(NamedTuple):
    """The way so far.

    Attributes:
        step: k.
        remaining: estimate of ||f_k - f_∞|| / ||f_k||; infinite before two moves are known.
        moved: d_k.
        since: the image from which the next one is measured.
        history: change of each step, ||f_k+1 - f_k|| / ||f_k+1||, NaN where there was none.
    """

    step: Int[Array, ""]
    remaining: Float[Array, ""]
    moved: Float[Array, ""]
    since: Float[Array, "stack *space"]
    history: Float[Array, " steps"]


def before(image: Float[Array, "stack *space"], max_steps: int) -> Progress:
    """That before the first step."""
    never = jnp.full((), jnp.inf, image.dtype)
    history = jnp.full(max_steps, jnp.nan, image.dtype)
    return Progress(jnp.zeros((), int), never, never, image, history)


def after(
    progress: Progress,
    old: Float[Array, "stack *space"],
    new: Float[Array, "stack *space"],
    steps: int = 1,
) -> Progress:
    """That after steps from the old image to the new one."""
    step, size = progress.step + steps, jnp.linalg.norm(new)
    size = jnp.where(size > 0, size, 1.0)
    change = jnp.linalg.norm(new - old) / size
    moved = jnp.linalg.norm(new - progress.since)
    ratio = jnp.clip(moved / jnp.where(progress.moved > 0, progress.moved, 1.0), _FASTEST, _SLOWEST)
    remaining = jnp.where(jnp.isinf(progress.moved), jnp.inf, moved * ratio / (1 - ratio) / size)
    # an iteration that gives NaN does not go on
    look = (step % EVERY == 0) | ~jnp.isfinite(change)
    return Progress(
        step=step,
        remaining=jnp.where(look, remaining, progress.remaining),
        moved=jnp.where(look, moved, progress.moved),
        since=jnp.where(look, new, progress.since),
        history=progress.history.at[progress.step + jnp.arange(steps)].set(change),
    )
