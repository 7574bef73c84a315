"""How far an iteration has come, and how far it is from where it goes.

Every `EVERY` steps the image has moved by d_k from where it was. Once it moves along its slowest
direction, d_k shrink by a factor q each time, and what is left of the way is

    d_k+1 + d_k+2 + ... = d_k s / (1 - s),    s = √q,    q = d_k / d_k-1,

relative to the image's norm. Before that the move is a mix of directions, and q still grows: √q,
between q and 1, stands for what it will be. With q itself fits ended up to three times as far away
as was said; along one direction √q says 2 to 2.4 times too much. q is taken between 0.5 and 0.95,
so that chance does not end it. The last move shows where the image is not settled.

Source: Aitken, Proc. R. Soc. Edinburgh 46 (1927) 289-305.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

EVERY = 20
_FASTEST, _SLOWEST = 0.5, 0.95
_WIDE = 4.0  # periods across the grid: what has no more is wide


class Progress(NamedTuple):
    """The way so far.

    Attributes:
        step: k.
        remaining: estimate of ||f_k - f_∞|| / ||f_k||; infinite before two moves are known.
        move: that of the image since it was looked at, of norm d_k.
        since: the image from which the next one is measured.
        history: change of each step, ||f_k+1 - f_k|| / ||f_k+1||, NaN where there was none.
    """

    step: Int[Array, ""]
    remaining: Float[Array, ""]
    move: Float[Array, "stack *space"]
    since: Float[Array, "stack *space"]
    history: Float[Array, " steps"]


def before(image: Float[Array, "stack *space"], max_steps: int) -> Progress:
    """That before the first step."""
    never = jnp.full((), jnp.inf, image.dtype)
    history = jnp.full(max_steps, jnp.nan, image.dtype)
    return Progress(jnp.zeros((), int), never, jnp.zeros_like(image), image, history)


def after(
    progress: Progress,
    old: Float[Array, "stack *space"],
    new: Float[Array, "stack *space"],
    steps: int = 1,
) -> Progress:
    """That after steps from the old image to the new one."""
    old, new = jax.lax.stop_gradient((old, new))  # norms have no derivative at zero
    step, size = progress.step + steps, jnp.linalg.norm(new)
    size = jnp.where(size > 0, size, 1.0)
    change = jnp.linalg.norm(new - old) / size
    move = new - progress.since
    moved, last = jnp.linalg.norm(move), jnp.linalg.norm(progress.move)
    ratio = jnp.sqrt(jnp.clip(moved / jnp.where(last > 0, last, 1.0), _FASTEST, _SLOWEST))
    left = moved * ratio / (1 - ratio) / size
    remaining = jnp.where(step < 2 * EVERY, jnp.inf, left)
    # an iteration that gives NaN does not go on
    look = (step % EVERY == 0) | ~jnp.isfinite(change)
    return Progress(
        step=step,
        remaining=jnp.where(look, remaining, progress.remaining),
        move=jnp.where(look, move, progress.move),
        since=jnp.where(look, new, progress.since),
        history=progress.history.at[progress.step + jnp.arange(steps)].set(change),
    )


def wide_share(move: Float[Array, "stack *space"]) -> Float[Array, ""]:
    """Share of a move, of its square, in parts with no more than four periods across the grid."""
    shape = move.shape[1:]
    power = jnp.abs(jnp.fft.fftn(move, axes=range(1, move.ndim))) ** 2
    periods = jnp.meshgrid(*(jnp.fft.fftfreq(n, 1 / n) for n in shape), indexing="ij")
    wide = sum(k**2 for k in periods) <= _WIDE**2
    total = jnp.sum(power)
    return jnp.sum(jnp.where(wide, power, 0.0)) / jnp.where(total > 0, total, 1.0)
