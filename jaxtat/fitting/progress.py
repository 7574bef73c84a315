"""How far an iteration has come, and how far it is from where it goes.

Every `EVERY` steps the image has moved by d_k from where it was. Once it moves along its slowest
direction, d_k shrink by a factor q each time, and what is left of the way is

    d_k+1 + d_k+2 + ... = d_k s / (1 - s),    s = √q,    q³ = d_k / d_k-3,

relative to the image's norm. Before that the move is a mix of directions, and q still grows: √q,
between q and 1, stands for what it will be. With q itself fits ended up to three times as far away
as was said; along one direction √q says 2 to 2.4 times too much. Moves three looks apart are
compared, since an extrapolation makes single ones uneven, and q is taken between 0.5 and 0.95, so
that chance does not end it; where states are extrapolated between 0.7 and 0.95: what is left then
is the slow part. The last move shows where the image is not settled.

Source: Aitken, Proc. R. Soc. Edinburgh 46 (1927) 289-305.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

EVERY = 20
_FASTEST, _FASTEST_EXTRAPOLATED, _SLOWEST = 0.5, 0.7, 0.95
_BACK = 3  # looks, over which moves are compared
_WIDE = 4.0  # periods across the grid: what has no more is wide


class Progress(NamedTuple):
    """The way so far.

    Attributes:
        step: k.
        remaining: estimate of ||f_k - f_∞|| / ||f_k||; infinite before two moves are known.
        move: that of the image since it was looked at.
        moved: all d_k, 0 where there was none.
        since: the image from which the next one is measured.
        history: change of each step, ||f_k+1 - f_k|| / ||f_k+1||, NaN where there was none.
    """

    step: Int[Array, ""]
    remaining: Float[Array, ""]
    move: Float[Array, "stack *space"]
    moved: Float[Array, " looks"]
    since: Float[Array, "stack *space"]
    history: Float[Array, " steps"]


def before(image: Float[Array, "stack *space"], max_steps: int) -> Progress:
    """That before the first step."""
    never = jnp.full((), jnp.inf, image.dtype)
    moved = jnp.zeros(max_steps // EVERY + 1, image.dtype)
    history = jnp.full(max_steps, jnp.nan, image.dtype)
    return Progress(jnp.zeros((), int), never, jnp.zeros_like(image), moved, image, history)


def after(
    progress: Progress,
    old: Float[Array, "stack *space"],
    new: Float[Array, "stack *space"],
    steps: int = 1,
    *,
    extrapolated: bool = False,
) -> Progress:
    """That after steps from the old image to the new one, which may have been extrapolated."""
    old, new = jax.lax.stop_gradient((old, new))  # norms have no derivative at zero
    step, size = progress.step + steps, jnp.linalg.norm(new)
    size = jnp.where(size > 0, size, 1.0)
    change = jnp.linalg.norm(new - old) / size
    move = new - progress.since
    # an iteration that gives NaN does not go on
    look = (step % EVERY == 0) | ~jnp.isfinite(change)
    k = step // EVERY - 1
    moved = progress.moved.at[k].set(jnp.linalg.norm(move))
    fastest = _FASTEST_EXTRAPOLATED if extrapolated else _FASTEST
    left = jnp.where(k == 0, jnp.inf, _left(moved, k, fastest) / size)
    return Progress(
        step=step,
        remaining=jnp.where(look, left, progress.remaining),
        move=jnp.where(look, move, progress.move),
        moved=jnp.where(look, moved, progress.moved),
        since=jnp.where(look, new, progress.since),
        history=progress.history.at[progress.step + jnp.arange(steps)].set(change),
    )


def _left(moved: Float[Array, " looks"], k: Int[Array, ""], fastest: float) -> Float[Array, ""]:
    """What is left, from moves up to the k-th, counted from 0."""
    before = jnp.maximum(k - _BACK, 0)
    shrunk = jnp.where(moved[before] > 0, moved[k] / moved[before], 1.0)
    factor = shrunk ** (1 / jnp.maximum(k - before, 1).astype(moved.dtype))
    ratio = jnp.sqrt(jnp.clip(factor, fastest, _SLOWEST))
    return moved[k] * ratio / (1 - ratio)


def wide_share(move: Float[Array, "stack *space"]) -> Float[Array, ""]:
    """Share of a move, of its square, in parts with no more than four periods across the grid."""
    shape = move.shape[1:]
    power = jnp.abs(jnp.fft.fftn(move, axes=range(1, move.ndim))) ** 2
    periods = jnp.meshgrid(*(jnp.fft.fftfreq(n, 1 / n) for n in shape), indexing="ij")
    wide = sum(k**2 for k in periods) <= _WIDE**2
    total = jnp.sum(power)
    return jnp.sum(jnp.where(wide, power, 0.0)) / jnp.where(total > 0, total, 1.0)
