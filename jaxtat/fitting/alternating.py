"""Alternating directions: an image, its differences and its nonnegative copy in turn.

Minimises ||H (B f - b)||² / 2 + w P(f), P(f) = Σ h(|D f|), for f in C, with u = D f and v = f:

    f: steps of conjugate gradients, preconditioned by `spectrum`, in
       (B^T H^T H B + a D^T D + c) f = B^T H^T H b + D^T (a u - p) + c v - q,
    u = argmin of w h(|u|) + a |u - D f - p/a|² / 2,    p = p + a (D f - u),
    v = nearest image in C to f + q/c,                  q = q + c (f - v),

with 1.6 f - 0.6 v for f, and likewise for D f, in the last two lines. B f and B^T H^T H B f are
carried along, so that each step of conjugate gradients costs one product with B and one with its
transpose. The image is v. In the plane, with a D, `extrapolation` follows after every five rounds.

What takes longest is the level inside a body, where a record lacks low frequencies: it moves with
the weakest of a, c and what the data say of it. a and c are chosen for that, on measured scans and
simulated ones: fine parts want the larger c. For as many products, two between shrinkages come up
to twice as near to the minimum as one.

Source: Boyd et al., Found. Trends Mach. Learn. 3 (2011) 1-122, sections 3.4.3 and 5.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.precision import in_full
from .data_fit import DataFit
from .level import Level
from .penalties import Penalty, Ridge
from .spectrum import preconditioned

OVER = 1.6  # relaxation


class Split(NamedTuple):
    """The parts of an image, and what binds them.

    Attributes:
        free: f, (stack, *space).
        fitted, normal: B f and B^T H^T H B f.
        parts, parts_dual: u and p; None for a penalty without D.
        dual: q.
    """

    free: Float[Array, "stack *space"]
    fitted: Float[Array, "stack *data"]
    normal: Float[Array, "stack *space"]
    parts: Any
    parts_dual: Any
    dual: Float[Array, "stack *space"]


class Bonds(NamedTuple):
    """a and c."""

    parts: Float[Array, ""]
    images: Float[Array, ""]


class Pace(NamedTuple):
    """How the work is divided.

    Attributes:
        products: steps of conjugate gradients between shrinkages.
        edge: a = w / (edge max f): smaller differences are shrunk to zero at once.
        hold: c over max m.
    """

    products: int
    edge: float
    hold: float = 5e-3


PACE = Pace(2, 0.03, 3.5e-3)
PACE_IN_SPACE = Pace(2, 0.03, 0.03)  # there records tell wide and fine parts equally well


def pace_for(images: Float[Array, "stack *space"]) -> Pace:
    """In the plane or in space."""
    return PACE if images.ndim == 3 else PACE_IN_SPACE


def products_of(penalty: Any, pace: Pace = PACE) -> int:
    """Products of a step; one where f and v are bound and no differences are shrunk."""
    return pace.products if isinstance(penalty, Penalty) else 1


def _bonds(level: Level, weight: Array, image: Array, pace: Pace) -> Bonds:
    """a and c for an image of that size."""
    size = jnp.maximum(jnp.max(jnp.abs(image)), 5 * level.scale.image)
    least = 1e-9 * level.scale.square  # without a weight
    return Bonds(weight / (pace.edge * size) + least, pace.hold * level.scale.square)


def split(
    level: Level,
    penalty: Any,
    weight: Float[Array, ""],
    image: Float[Array, "stack *space"],
    fitted: Float[Array, "stack *data"],
    normal: Float[Array, "stack *space"],
) -> Split:
    """The parts of an image to start from, with the duals that it would have as a minimum.

    p is w D f / |D f| at edges; q the slope where f = 0, and 0 elsewhere and for f = 0 everywhere.
    """
    fit, bond = level.fit, _bonds(level, weight, image, pace_for(image))
    slope, parts, parts_dual = normal - level.back, None, None
    if isinstance(penalty, Penalty):
        parts = penalty.parts(image)
        largest = jnp.maximum(penalty.sizes(parts), weight / bond.parts)
        parts_dual = weight * parts / jnp.where(largest > 0, largest, 1.0)
        slope = slope + _pull(fit, penalty, parts_dual)
    dual = jnp.zeros_like(image)
    if fit.nonnegative:
        held = fit.support & (image <= 0) & jnp.any(image > 0)
        dual = jnp.where(held, jnp.minimum(-slope, 0.0), 0.0)
    return Split(image, fitted, normal, parts, parts_dual, dual)


def step(
    level: Level,
    penalty: Any,
    weight: Float[Array, ""],
    image: Float[Array, "stack *space"],
    state: Split,
    pace: Pace | None = None,
) -> tuple[Float[Array, "stack *space"], Split]:
    """All parts in turn: v and the rest.

    Args:
        image: v of before.
        pace: by default `pace_for` images.
    """
    pace = pace or pace_for(image)
    bond = _bonds(level, weight, image, pace)
    state = _nearer(level, penalty, bond, weight, image, state, products_of(penalty, pace))
    mixed = OVER * state.free + (1 - OVER) * image
    new = level.fit.allowed(mixed + state.dual / bond.images)
    state = state._replace(dual=state.dual + bond.images * (mixed - new))
    if isinstance(penalty, Penalty):
        ahead = OVER * penalty.parts(state.free) + (1 - OVER) * state.parts
        delta = (penalty.smoothing * level.scale.image).astype(image.dtype)
        parts = penalty.shrunk(ahead + state.parts_dual / bond.parts, weight / bond.parts, delta)
        dual = state.parts_dual + bond.parts * (ahead - parts)
        state = state._replace(parts=parts, parts_dual=dual)
    return new, state


def _nearer(
    level: Level,
    penalty: Any,
    bond: Bonds,
    weight: Array,
    image: Array,
    state: Split,
    products: int,
) -> Split:
    """f after steps towards the least of what depends on it."""
    fit, spectrum = level.fit, level.spectrum
    ridge = weight if isinstance(penalty, Ridge) else 0.0
    left = level.back - state.normal - ridge * state.free - state.dual
    left = left + bond.images * (image - state.free)
    symbol = spectrum.data + bond.images + ridge
    if isinstance(penalty, Penalty):
        pull = bond.parts * (state.parts - penalty.parts(state.free)) - state.parts_dual
        left = left + _pull(fit, penalty, pull)
        symbol = symbol + bond.parts * jnp.asarray(spectrum.differences)

    def nearer(_: Any, parts: tuple[Array, ...]) -> tuple[Array, ...]:
        free, fitted, normal, left, along, before = parts
        down = jnp.where(fit.support, preconditioned(left, symbol), 0.0)
        slope = jnp.sum(left * down)
        along = down + slope / jnp.where(before > 0, before, jnp.inf) * along
        data = fit.modelled(along)
        back = fit.transposed(data)
        curved = back + (bond.images + ridge) * along
        if isinstance(penalty, Penalty):
            curved = curved + bond.parts * _pull(fit, penalty, penalty.parts(along))
        curvature = jnp.sum(along * curved)
        length = slope / jnp.where(curvature > 0, curvature, 1.0)
        moved = free + length * along, fitted + length * data, normal + length * back
        return *moved, left - length * curved, along, slope

    left = jnp.where(fit.support, left, 0.0)
    begin = state.free, state.fitted, state.normal, left, jnp.zeros_like(left)
    none = jnp.zeros((), left.dtype)
    free, fitted, normal, *_ = jax.lax.fori_loop(0, products, nearer, (*begin, none))
    return state._replace(free=free, fitted=fitted, normal=normal)


def products_of_moves(
    level: Level,
    weight: Float[Array, ""],
    image: Float[Array, "stack *space"],
    moves: tuple[Float[Array, "m stack *space"], Split],
) -> Float[Array, "m m"]:
    """Inner products of moves of v, u, q and p, in c |v|² + |q|² / c + a |u|² + |p|² / a.

    In that norm steps never become longer, if f is exact and there is no relaxation.

    Args:
        weight, image: for a and c.
        moves: of v and the rest, of a penalty with D.
    """

    def between(moves: Array) -> Array:
        flat = moves.reshape(len(moves), -1)
        return in_full(jnp.matmul)(flat, flat.T)

    bond, (images, split) = _bonds(level, weight, image, pace_for(image)), moves
    of_images = bond.images * between(images) + between(split.dual) / bond.images
    return of_images + bond.parts * between(split.parts) + between(split.parts_dual) / bond.parts


def of_weight(state: Split, old: Float[Array, ""], new: Float[Array, ""]) -> Split:
    """The same state for another weight: p stays as near to its bound."""
    if state.parts_dual is None:
        return state
    return state._replace(parts_dual=state.parts_dual * (new / jnp.where(old > 0, old, 1.0)))


def _pull(fit: DataFit, penalty: Penalty, parts: Array) -> Array:
    """D^T u, on the support."""
    images = jax.ShapeDtypeStruct(parts.shape[1:], parts.dtype)
    return jnp.where(fit.support, jax.linear_transpose(penalty.parts, images)(parts)[0], 0.0)
