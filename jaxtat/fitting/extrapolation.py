"""Where the last steps of an iteration lead: the combination of states that moves least.

Of states s_0, ..., s_m, each made of the one before by the same step, with d_i = s_i - s_(i-1),

    s = Σ a_i s_i,   with the a_i, Σ a_i = 1, of least ||Σ a_i d_i||,   i = 1, ..., m.

A step that is linear near its end multiplies each direction of what is left by a factor; the
combination takes out the m - 1 slowest. Every `ROUND` steps it replaces the state, unless the last
step is twice as long as the shortest at such a place: plain steps never become longer, so that they
mend what a combination that led astray has done.

Three steps of five were as good as more. Near the minimum fits took a third to half fewer steps
(270, 180 and 125 degrees), on a full ring a tenth.

Source: reduced rank extrapolation, Smith, Ford and Sidi, SIAM Review 29 (1987) 199-233; for
alternating directions Zhang, O'Donoghue and Boyd, SIAM J. Optim. 30 (2020) 3170-3197.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..base.precision import in_full

ROUND = 5
M = 3
_FLOOR = 1e-6  # of all moves, squared: what bounds the a_i


class Trail(NamedTuple):
    """The last states of a round.

    Attributes:
        states: M + 1 of them, along a new first axis of every array.
        shortest: square of the shortest last step of a round; infinite before the first.
    """

    states: Any
    shortest: Float[Array, ""]


def trail(state: Any) -> Trail:
    """That of an iteration at its beginning."""
    states = jax.tree.map(lambda x: jnp.zeros((M + 1, *x.shape), x.dtype), state)
    return Trail(states, jnp.asarray(jnp.inf))


def is_kept(count: Int[Array, ""]) -> Bool[Array, ""]:
    """Whether the step with that number, from 1, is one of those that are combined."""
    return (count - 1) % ROUND >= ROUND - M


def extrapolated(
    trail: Trail,
    state: Any,
    count: Int[Array, ""],
    products: Callable[[Any], Float[Array, "m m"]],
) -> tuple[Any, Trail]:
    """A state, or at the end of a round what the last ones lead to.

    Args:
        trail: of the states before.
        state: after ``count`` steps, any arrays.
        products: inner products of moves, which have a new first axis like `Trail.states`.
    """
    place = jnp.maximum((count - 1) % ROUND - (ROUND - 1 - M), 0)
    states = jax.tree.map(lambda all, x: all.at[place].set(x), trail.states, state)

    @in_full
    def together(shares: Array, states: Array) -> Array:
        return jnp.tensordot(shares, states, 1)

    def at_the_end() -> tuple[Any, Array]:
        moves = jax.tree.map(lambda x: x[1:] - x[:-1], states)
        gram = products(moves).astype(trail.shortest.dtype)
        size = jnp.trace(gram)
        scaled = gram / jnp.where(size > 0, size, 1.0) + _FLOOR * jnp.eye(M)
        shares = jnp.linalg.solve(scaled, jnp.ones(M))
        shares = shares / jnp.sum(shares)
        good = (gram[-1, -1] < 4 * trail.shortest) & jnp.all(jnp.isfinite(shares))
        shares = jnp.where(good, shares, jnp.eye(M)[-1])
        found = jax.tree.map(lambda x: together(shares.astype(x.dtype), x[1:]), states)
        return found, jnp.minimum(gram[-1, -1], trail.shortest)

    found, shortest = jax.lax.cond(count % ROUND == 0, at_the_end, lambda: (state, trail.shortest))
    return found, Trail(states, shortest)
