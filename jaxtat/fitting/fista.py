"""Proximal gradients with momentum, for maps of the user's: FISTA with restart.

For f in C, L >= ||H B||², with H of `DataFit` and a map such as a denoiser,

    x_{k+1} = map(y_k - B^T H^T H (B y_k - b) / L, w / L),
    y_{k+1} = x_{k+1} + (t_k - 1) / t_{k+1} (x_{k+1} - x_k).

Where momentum leads uphill, t starts anew. The map is applied at the strength w / L, on which its
fixed point depends where it is no proximal map.

Source: Beck and Teboulle, SIAM J. Imaging Sci. 2 (2009) 183-202; restart: O'Donoghue and Candès,
Found. Comput. Math. 15 (2015) 715-732.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .data_fit import DataFit
from .level import Scale

_MARGIN = 1.05  # of L over the symbol's largest value; it grows where a step shows that it must


class Momentum(NamedTuple):
    """What the next step goes on from.

    Attributes:
        ahead: y, (stack, *space).
        fitted, fitted_ahead: B x and B y, (stack, *data).
        time: t.
        square: L.
    """

    ahead: Float[Array, "stack *space"]
    fitted: Float[Array, "stack *data"]
    fitted_ahead: Float[Array, "stack *data"]
    time: Float[Array, ""]
    square: Float[Array, ""]


def momentum(
    scale: Scale, image: Float[Array, "stack *space"], fitted: Float[Array, "stack *data"]
) -> Momentum:
    """That before the first step."""
    return Momentum(image, fitted, fitted, jnp.ones((), image.dtype), _MARGIN * scale.square)


def step(
    fit: DataFit,
    data: Float[Array, "stack *data"],
    denoiser: Any,
    weight: Float[Array, ""],
    image: Float[Array, "stack *space"],
    state: Momentum,
) -> tuple[Float[Array, "stack *space"], Momentum]:
    """One step: x and the rest."""
    down = state.ahead - fit.transposed(state.fitted_ahead - data) / state.square
    new = fit.allowed(denoiser(down, weight / state.square))
    fitted = fit.modelled(new)
    moved = jnp.sum((new - state.ahead) ** 2)
    stretched = fit.misfit(fitted - state.fitted_ahead) / jnp.where(moved > 0, moved, 1.0)
    uphill = jnp.sum((state.ahead - new) * (new - image)) > 0
    grown = (1 + jnp.sqrt(1 + 4 * state.time**2)) / 2
    carried = jnp.where(uphill, 0.0, (state.time - 1) / grown)
    return new, Momentum(
        ahead=new + carried * (new - image),
        fitted=fitted,
        fitted_ahead=fitted + carried * (fitted - state.fitted),
        time=jnp.where(uphill, 1.0, grown),
        square=jnp.where(stretched > state.square, _MARGIN * stretched, state.square),
    )
