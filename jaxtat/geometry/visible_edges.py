"""Which edges can be seen, pixel by pixel.

An edge sends its wave along its normal, both ways. So a pixel's edges with normal d are recorded if
the line {x + t d} through it meets the curve. Lines are judged by their transverse weight, which
holds for any curve.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..checks import Numbers, is_concrete, real_array, require_positive, whole_number
from .curves import DetectorCurve
from .grids import ImageGrid
from .transverse_weight import kernel_width, transverse_weight, weight_of_line

VISIBLE = 0.75  # least transverse weight of a line whose wave is reconstructed stably
_STEPS = 8.0  # of the table of offsets within the Gaussian's width


def edge_weight(
    curve: DetectorCurve, points: Numbers, angles: Numbers, *, width: Numbers | None = None
) -> Float[Array, "*n angles"]:
    """W of the lines along which edges at some points send their waves.

    The edges that can be seen are those with ``edge_weight(...) >= VISIBLE`` (0.75).

    Args:
        curve: the detectors, of any shape.
        points: (..., 2) [length].
        angles: of the edges' normals, (angles,) [rad]; half a turn is all.
        width: eps of `transverse_weight`.

    Returns:
        (..., angles): 1 for an edge whose wave crosses the curve once and squarely, 2 for one that
        is recorded on both sides, 0 for one that no detector records. Differentiable.

    >>> import numpy as np
    >>> from jaxtat import circular_arc
    >>> half = circular_arc(1.3, 0.0, 200)  # z_1 < 0: a point on its open side
    >>> np.round(edge_weight(half, [0.5, 0.0], [0.0, np.pi / 2]), 2).tolist()
    [1.0, 0.0]
    """
    points = real_array("points", points, ("...", 2))
    angles = real_array("angles", angles, ("angles",))
    offsets = points @ _across(angles)
    return transverse_weight(curve, angles + jnp.pi / 2, offsets, width=width)


def visibility_map(
    curve: DetectorCurve,
    grid: ImageGrid,
    *,
    n_angles: int = 360,
    least: Numbers = VISIBLE,
    width: Numbers | None = None,
) -> Float[Array, "x1 x2"]:
    """For each pixel the share of edge directions that can be seen: W >= least.

    1 where every line through the pixel meets the curve. With ``least=0.5`` lines that cross the
    curve squarely count up to its very ends; 0.75 leaves out those within about one width of an
    end, whose waves are recorded but in part.

    Args:
        curve: the detectors, of any shape, concrete.
        grid: nodes where it is wanted, concrete.
        n_angles: number of directions over half a turn.
        least: W of a line that counts as seen, above zero.
        width: eps of `transverse_weight`.

    Returns:
        (x1, x2), between 0 and 1, in steps of 1 / n_angles.

    Raises:
        ValueError: for a geometry traced by `jax.jit`, or as `transverse_weight`.

    Source: E. T. Quinto, SIAM J. Math. Anal. 24 (1993) 1215-1225 (which edges data determine).

    >>> from jaxtat import ImageGrid, circular_arc
    >>> seen = visibility_map(circular_arc(1.3, 0.0, 200), ImageGrid(5, 0.7), least=0.5)
    >>> [round(float(v), 1) for v in seen[:, 2]]  # half the circle, from left to right
    [1.0, 1.0, 1.0, 0.8, 0.7]
    """
    least = real_array("least", least, ())
    require_positive("least", least)
    width = kernel_width(curve, width)
    if not is_concrete(curve, grid, width):
        raise ValueError(
            "curve, grid or width are traced by jax.jit, and the number of lines depends on them: "
            "use edge_weight, which takes traced arrays."
        )
    n_angles = whole_number("n_angles", n_angles, 1)
    angles = np.arange(n_angles) * (np.pi / n_angles)
    diagonal = 2 * np.hypot(*np.asarray(grid.half_width))
    n_offsets = 256 * (int(_STEPS * diagonal / float(width)) // 256 + 1)  # few programs
    return _share(curve, grid, jax.device_put(angles), width, least, n_offsets)


@partial(jax.jit, static_argnames="n_offsets")
def _share(
    curve: DetectorCurve, grid: ImageGrid, angles: Array, width: Array, least: Array, n_offsets: int
) -> Float[Array, "x1 x2"]:
    reach = jnp.linalg.norm(grid.half_width)
    table = jnp.linspace(-reach, reach, n_offsets)
    local = grid.points - grid.center

    def count(total: Array, angle: Array) -> tuple[Array, None]:
        across = _across(angle)
        weights = weight_of_line(curve, angle + jnp.pi / 2, grid.center @ across + table, width)
        position = (local @ across + reach) / (table[1] - table[0])
        first = jnp.clip(position.astype(int), 0, n_offsets - 2)
        t = position - first
        weight = (1 - t) * weights[first] + t * weights[first + 1]
        return total + (weight >= least), None

    total, _ = jax.lax.scan(count, jnp.zeros(grid.shape, int), angles)
    return total / angles.shape[0]


def _across(angles: Float[Array, "*n"]) -> Float[Array, "2 *n"]:
    """Unit normals of lines in the given directions."""
    return jnp.stack([-jnp.sin(angles), jnp.cos(angles)])
