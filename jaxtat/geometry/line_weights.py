"""Transverse weight: how often, and how nearly at right angles, a line crosses the curve.

Along a piece of the curve that a line crosses under the angle of incidence alpha, the offset s of
the line changes by ds = cos alpha dl. So the arc length per offset is the sum of 1/cos alpha over
all crossings. It asks for no normals, no order and no connection between the detectors, only for
the arc length that each stands for.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, real_array, require_positive
from ..base.rows import map_rows
from .curves import DetectorCurve

WIDTH = 3.0  # of the Gaussian, in detector spacings: wide enough to see no single detectors
_BESIDE = 8  # detectors to either side, over which arc length is averaged
_LINES_AT_ONCE = 1024


def transverse_weight(
    curve: DetectorCurve, angles: Numbers, offsets: Numbers, *, width: Numbers | None = None
) -> Float[Array, "*lines"]:
    """W(ω, s) = Σ_k w_k delta_eps(s - z_k·ω) of lines {x: x·ω = s}, ω = (cos theta, sin theta).

    delta_eps is a Gaussian of standard deviation eps. A crossing at normal incidence gives 1, a
    grazing one more, two crossings add; a line that misses the curve has 0, one through its very
    end half of what it has farther in. ∫ W ds is the length of the curve. Differentiable with
    respect to the curve, angles, offsets and width.

    Args:
        curve: the detectors, in any order, of any shape.
        angles: theta of the lines' normals [rad].
        offsets: s [length], of the same shape as angles or one that fits by broadcasting.
        width: eps [length], by default three times the geometric mean of the detectors' arc
            lengths, which follows the curve smoothly; wider for those among sparser ones, 1.5 times
            the mean arc length about them.

    Returns:
        W, of the common shape of angles and offsets.

    Raises:
        ValueError: for NaN, shapes that do not fit, or a width that is not above zero.

    >>> import numpy as np
    >>> from jaxtat import circular_arc
    >>> half = circular_arc(1.3, 0.0, 200)  # z_1 < 0
    >>> vertical = transverse_weight(half, 0.0, np.array([0.0, -0.65, 0.65]))
    >>> np.round(vertical, 2).tolist()  # half of each end; two crossings at 30 degrees; none
    [1.0, 2.32, 0.0]
    """
    angles, offsets = real_array("angles", angles, None), real_array("offsets", offsets, None)
    try:
        angles, offsets = jnp.broadcast_arrays(angles, offsets)
    except ValueError:
        raise ValueError(
            f"angles has shape {angles.shape} and offsets {offsets.shape}, expected shapes that "
            "fit each other."
        ) from None
    return _weights(curve, angles, offsets, kernel_width(curve, width))


def kernel_width(curve: DetectorCurve, width: Numbers | None) -> Float[Array, "*detectors"]:
    """The width eps [length], checked; by default one for each detector, by their spacing."""
    if width is None:
        return _widths(curve)
    width = real_array("width", width, ())
    require_positive("width", width)
    return width


@jax.jit
def _widths(curve: DetectorCurve) -> Float[Array, " detectors"]:
    """One width for all detectors, or larger ones where detectors are sparse.

    Local spacings are means over neighbours, since widths that vary from one detector to the next
    give weights that do. The common width is a geometric mean, which a few sparse detectors hardly
    change; a median would have no derivative in a regular array, where all arc lengths are equal.
    """
    n = curve.n_detectors
    beside = np.arange(n)[:, None] + np.arange(-_BESIDE, _BESIDE + 1)
    beside = beside % n if curve.closed else np.clip(beside, 0, n - 1)
    local = jnp.mean(curve.weights[beside], axis=1)
    used = curve.weights > 0
    logarithms = jnp.where(used, jnp.log(jnp.where(used, curve.weights, 1.0)), 0.0)
    typical = jnp.exp(jnp.sum(logarithms) / jnp.sum(used))
    return WIDTH * jnp.maximum(typical, local / 2)


@jax.jit
def _weights(curve: DetectorCurve, angles: Array, offsets: Array, width: Array) -> Array:
    @jax.checkpoint
    def of_line(line: tuple[Array, Array]) -> Array:
        return weight_of_line(curve, *line, width)

    flat = angles.ravel(), offsets.ravel()
    return map_rows(of_line, flat, _LINES_AT_ONCE).reshape(angles.shape)


def weight_of_line(
    curve: DetectorCurve, angle: Float[Array, ""], offset: Float[Array, "*n"], width: Array
) -> Float[Array, "*n"]:
    """W of parallel lines."""
    along = curve.points[:, 0] * jnp.cos(angle) + curve.points[:, 1] * jnp.sin(angle)
    return weight_at(curve, offset[..., None] - along, width)


def weight_at(
    curve: DetectorCurve, distances: Float[Array, "*n detectors"], width: Array
) -> Float[Array, "*n"]:
    """Σ_k w_k delta_eps(d_k) of lines at distances d_k from the detectors."""
    t = distances / width
    return jnp.exp(-(t**2) / 2) @ (curve.weights / (width * jnp.sqrt(2 * jnp.pi)))


def line_normals(angles: Float[Array, "*n"]) -> Float[Array, "2 *n"]:
    """Unit normals of lines in the given directions."""
    return jnp.stack([-jnp.sin(angles), jnp.cos(angles)])
