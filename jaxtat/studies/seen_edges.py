"""Which edges can be seen at every pixel of a setup's grid."""

from jaxtyping import Array, Float

from ..base.checks import Numbers, require_objects
from ..geometry import VISIBLE, ImageGrid, seen_share
from ..reconstruction import Setup
from ..reconstruction.setup import plane_of


def visibility_map(
    setup: Setup,
    *,
    grid: ImageGrid | None = None,
    n_angles: int = 360,
    least: Numbers = VISIBLE,
    width: Numbers | None = None,
) -> Float[Array, "x1 x2"]:
    """For each pixel the share of edge directions that can be seen: transverse weight >= least.

    An edge sends its wave along its normal, both ways; it is seen if that line meets the curve. 1
    where every line through the pixel does. With ``least=0.5`` lines that cross the curve squarely
    count up to its very ends; 0.75 leaves out those within about one width of an end, whose waves
    are recorded but in part.

    Args:
        setup: in the plane.
        grid: nodes where it is wanted, by default the setup's.
        n_angles: number of directions over half a turn.
        least: transverse weight of a line that counts as seen, above zero.
        width: eps of `transverse_weight` [length].

    Returns:
        (x1, x2), between 0 and 1, in steps of 1 / n_angles.

    Source: E. T. Quinto, SIAM J. Math. Anal. 24 (1993) 1215-1225 (which edges data determine).

    >>> from jaxtat import ImageGrid, circular_arc, disk
    >>> setup = Setup(circular_arc(1.3, 0.0, 200), disk(1.0, 0.0), ImageGrid(5, 0.7))
    >>> seen = visibility_map(setup, least=0.5)
    >>> [round(float(v), 1) for v in seen[:, 2]]  # half the circle, from left to right
    [1.0, 1.0, 1.0, 0.8, 0.7]
    """
    curve = plane_of(setup)[0]
    nodes = setup.grid if grid is None else grid
    require_objects(grid=nodes)
    return seen_share(curve, nodes, n_angles=n_angles, least=least, width=width)
