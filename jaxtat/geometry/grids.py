"""Image grids: where the pixels are."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..checks import Numbers, real_array, require_positive


class ImageGrid(eqx.Module):
    """Nodes x_i = c + b (2 i/(n-1) - 1), i = 0..n-1, along each axis; images are f[i, j] = f(x_ij).

    Args:
        n: number of nodes per axis, an int or a pair, at least 4.
        half_width: b, from the centre to the last node, a number or a pair [length].
        center: c, (2,) [length].

    Raises:
        ValueError: for fewer than 4 nodes or a half width that is not positive.

    >>> grid = ImageGrid(129)  # the paper's: 129 x 129 on [-1, 1]^2
    >>> grid.points.shape, float(grid.spacing[0])
    ((129, 129, 2), 0.015625)
    """

    half_width: Float[Array, "2"]
    center: Float[Array, "2"]
    shape: tuple[int, int] = eqx.field(static=True)

    def __init__(
        self,
        n: int | tuple[int, int],
        half_width: Numbers = 1.0,
        center: Numbers = (0.0, 0.0),
    ):
        self.shape = (n, n) if isinstance(n, int) else (int(n[0]), int(n[1]))
        if min(self.shape) < 4:
            raise ValueError(f"the grid has {self.shape} nodes, expected at least 4 per axis.")
        self.half_width = jnp.broadcast_to(real_array("half_width", half_width, None), (2,))
        self.center = real_array("center", center, (2,))
        require_positive("half_width", self.half_width)

    @property
    def spacing(self) -> Float[Array, "2"]:
        """Distance h between neighbouring nodes along each axis [length]."""
        return 2 * self.half_width / (jnp.asarray(self.shape) - 1)

    @property
    def x1(self) -> Float[Array, " x1"]:
        """First coordinates of the nodes [length]."""
        return self._axis(0)

    @property
    def x2(self) -> Float[Array, " x2"]:
        """Second coordinates of the nodes [length]."""
        return self._axis(1)

    @property
    def points(self) -> Float[Array, "x1 x2 2"]:
        """All nodes [length]."""
        return jnp.stack(jnp.meshgrid(self.x1, self.x2, indexing="ij"), axis=-1)

    def _axis(self, axis: int) -> Array:
        unit = jnp.linspace(-1.0, 1.0, self.shape[axis])
        return self.center[axis] + self.half_width[axis] * unit
