"""How far an image may be from the minimum: the duality gap.

With r = b - B y, q in the subdifferential of P at any image, and images between 0 (or -m) and m in
C, where m is twice the largest value that the image has,

    min over f in C of ||H (B f - b)||² / 2 + w P(f)
        >= <H r, H b> - ||H r||² / 2 - max over f in C of <B^T H^T H r - w q, f> - w P*(q),

for any y and q: those of the iteration make it an equality at the minimum. The gap is the value of
what is minimised minus this bound.

Source: Boyd and Vandenberghe, Convex Optimization (2004), chapter 5; for total variation Chambolle
and Pock, J. Math. Imaging Vis. 40 (2011) 120-145.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .data_fit import DataFit
from .penalties import Penalty, Ridge


def duality_gap(
    fit: DataFit,
    data: Float[Array, "stack *data"],
    penalty: Any,
    weight: Float[Array, ""],
    delta: Float[Array, ""],
    image: Float[Array, "stack *space"],
    misfits: tuple[Float[Array, "stack *data"], Float[Array, "stack *data"]],
    back: Float[Array, "stack *space"],
    dual: Any,
) -> Float[Array, ""]:
    """The gap over ||H b||² / 2, zero or more but for rounding.

    Args:
        misfits: B f - b of the image, and B y - b.
        back: B^T H^T H (B y - b).
        dual: p of the proximal map, q = D^T p; of `Penalty` alone.
    """
    primal, other = misfits
    value, slope = fit.misfit(primal) / 2, -back
    bound = -jnp.sum(fit.weighed(other) * fit.weighed(data)) - fit.misfit(other) / 2
    if isinstance(penalty, Penalty):
        value = value + weight * penalty.value(image, delta)
        slope = slope - weight * jax.linear_transpose(penalty.parts, image)(dual)[0]
        bound = bound - weight * penalty.conjugate(dual, delta)
    slope = fit.allowed(slope)
    most = 2 * jnp.max(jnp.abs(image)) * jnp.sum(jnp.abs(slope))
    if isinstance(penalty, Ridge):
        value = value + weight * jnp.sum(image**2) / 2
        square = jnp.sum(slope**2) / (2 * jnp.where(weight > 0, weight, 1.0))
        most = jnp.where(weight > 0, jnp.minimum(most, square), most)
    size = fit.misfit(data) / 2
    return (value - bound + most) / jnp.where(size > 0, size, 1.0)
