"""N(lambda): how large densities must be, the norm in which bounds on them are expressed.

On a circle it is that of the full circle's least densities, in closed form. For other curves it
follows from which lines are crossed how often: along a line of transverse weight W densities are
|rho_J|² + |rho_Y|² = lambda² / (2 W²), and a line that is crossed less than once is not reached.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, real_array
from ..geometry import CircularArc, DetectorCurve, Region, fit_circle, near_circle
from ..geometry.line_weights import kernel_width, line_normals, weight_of_line
from ..special import full_circle_norm

_LINES = 512  # across the region
_DIRECTIONS = 64  # over half a turn, where a mean is wanted


def microlocal_norm(
    curve: DetectorCurve, region: Region, angles: Numbers, *, width: Numbers | None = None
) -> Float[Array, " directions"]:
    """N_m / lambda, N_m² = (lambda² / 2) ∫ ds / max(W, 1) over the lines that meet the region.

    The norm of the least densities of exp(-i xi·x), xi = lambda (cos theta, sin theta), in the
    limit of short waves: W(s) is the transverse weight of the line of that direction and offset s.
    Where a line is crossed less than once, W counts as 1, what a visible line needs.

    Args:
        curve: the detectors, of any shape.
        region: the region of interest.
        angles: theta, (directions,) [rad].
        width: eps of `transverse_weight`.

    Returns:
        (directions,) [length^(1/2)], differentiable.

    >>> import numpy as np
    >>> from jaxtat import circular_arc, disk
    >>> full, whole = circular_arc(1.3, 1.3, 500), disk(1.0, n_boundary=1000)
    >>> norm = microlocal_norm(full, whole, [0.0])  # every line is crossed twice, W = 2 / cos
    >>> exact = np.sqrt((np.sqrt(0.69) + 1.69 * np.arcsin(1 / 1.3)) / 1.3 / 4)
    >>> bool(abs(norm[0] / exact - 1) < 2e-3)
    True
    """
    angles = real_array("angles", angles, ("directions",))
    return _microlocal(curve, region, angles, kernel_width(curve, width))


def unit_norms(
    curve: DetectorCurve,
    region: Region,
    frequencies: Float[Array, " frequencies"],
    norm_orders: int | None = None,
    angles: Float[Array, " directions"] | None = None,
) -> Float[Array, "frequencies *one_or_directions"]:
    """N(lambda) of the full circle for detectors on a circle, else N_m.

    Args:
        curve, region: the geometry.
        frequencies: lambda [rad/length].
        norm_orders: of `full_circle_norm`; 0 asks for N_m. None of a concrete geometry: decided
            here.
        angles: theta of N_m; the root mean square over all directions if there are none.
    """
    on_circle = near_circle(curve) if norm_orders is None else norm_orders > 0
    if on_circle:
        arc = isinstance(curve, CircularArc)
        radius = curve.radius if arc else fit_circle(curve.points).radius
        return full_circle_norm(frequencies, radius, norm_orders)
    if angles is None:
        every = np.arange(_DIRECTIONS) * (np.pi / _DIRECTIONS)
        return frequencies * jnp.sqrt(jnp.mean(microlocal_norm(curve, region, every) ** 2))
    return frequencies[:, None] * microlocal_norm(curve, region, angles)


@eqx.filter_jit
def _microlocal(
    curve: DetectorCurve, region: Region, angles: Array, width: Array
) -> Float[Array, " directions"]:
    inner = (jnp.arange(_LINES) + 0.5) / _LINES

    @jax.checkpoint
    def of_direction(angle: Array) -> Array:
        across = line_normals(angle)
        shadows = [part.points @ across for part in region.components]
        low = jnp.stack([shadow.min() for shadow in shadows])
        high = jnp.stack([shadow.max() for shadow in shadows])
        # of each shadow what lies beyond those before it, so that all ends have derivatives
        order = jnp.argsort(low)
        low, high = low[order], high[order]
        before = jnp.concatenate([low[:1], jax.lax.cummax(high)[:-1]])
        first = jnp.maximum(low, before)
        span = jnp.maximum(high - first, 0.0)
        offsets = first[:, None] + span[:, None] * inner
        weight = weight_of_line(curve, angle + jnp.pi / 2, offsets, width)
        return jnp.sqrt(span @ jnp.mean(1 / jnp.maximum(weight, 1.0), axis=1) / 2)

    return jax.lax.map(of_direction, angles)
