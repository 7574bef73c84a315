"""Geometry of a scan with line detectors: the axis of rotation and the angles.

Coordinates (x1, x2, x3) turn with the object, and x3 runs along the axis of rotation, with the
origin on it. All line detectors are parallel and perpendicular to the axis. In the plane
perpendicular to them, which holds the axis, lies the 2-D problem with coordinates (u, v), v = x3:
a line detector is a point of a `DetectorCurve` there, and the axis is the line u = ``axis``.

At angle φ the lines run along (-sin φ, cos φ, 0), and u grows along (cos φ, sin φ, 0):

    x1 = s cos φ - t sin φ,  x2 = s sin φ + t cos φ,  x3 = v,  s = u - axis,

t being counted along the lines. So φ grows when the detectors turn from x1 to x2, or the object
the other way round.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array


class LineDetectorScan(eqx.Module):
    """Angles φ and axis of a scan, see `jaxtat.line_detectors.scan` for the coordinates.

    Half a turn is enough if the 2-D region of interest holds the projections of the object from
    all sides. A whole turn shows every line twice, from either side of the axis, so that the region
    of interest may lie on one side of it.

    Args:
        angles: increasing, equispaced over half a turn (step π/n) or a whole one (2π/n, n even), up
            to 1 % of a step, (rotations,) [rad]; concrete.
        axis: the axis of rotation is the line u = axis of the 2-D problem [length].

    Attributes:
        whole_turn: whether the angles cover a whole turn.

    Raises:
        ValueError: for other angles.

    Angles and axis are differentiable: replace them in a scan by ``equinox.tree_at``.

    >>> import jax.numpy as jnp
    >>> LineDetectorScan(jnp.arange(200) * jnp.pi / 200).whole_turn
    False
    """

    angles: Float[Array, " rotations"]
    axis: Float[Array, ""]
    whole_turn: bool = eqx.field(static=True)

    def __init__(self, angles: Numbers, axis: Numbers = 0.0):
        self.angles = real_array("angles", angles, ("rotations",))
        self.axis = real_array("axis", axis, ())
        if not is_concrete(self.angles):
            raise ValueError(
                "angles are traced: make the scan outside jax.jit, pass it as an argument, and "
                "replace its angles by equinox.tree_at where they vary."
            )
        self.whole_turn = _covers_whole_turn(np.asarray(self.angles))

    @property
    def n_rotations(self) -> int:
        return self.angles.shape[0]


def _covers_whole_turn(angles: np.ndarray) -> bool:
    """Whether equispaced angles cover a whole turn rather than half a one; else ValueError."""
    n = len(angles)
    if n < 2:
        raise ValueError(f"got {n} angles, expected at least 2.")
    step = (angles[-1] - angles[0]) / (n - 1)
    line = angles[0] + step * np.arange(n)
    off = np.abs(angles - line).max()
    for turn in (np.pi, 2 * np.pi):
        if abs(step - turn / n) * n < 0.01 * turn / n and off < 0.01 * turn / n:
            if turn > 4 and n % 2:
                raise ValueError(
                    f"got {n} angles over a whole turn, expected an even number, so that every "
                    "line is seen from both sides."
                )
            return turn > 4
    raise ValueError(
        f"{n} angles run from {angles[0]:.6g} to {angles[-1]:.6g} rad in steps from "
        f"{np.diff(angles).min():.6g} to {np.diff(angles).max():.6g}, expected equal steps of "
        f"π/n = {np.pi / n:.6g} (half a turn) or 2π/n = {2 * np.pi / n:.6g} (a whole one), "
        "increasing: give radians, leave out repeated angles, reverse a scan that turns the other "
        "way, or interpolate the data to equal steps."
    )
