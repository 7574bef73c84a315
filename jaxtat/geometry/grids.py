"""Image grids: where the pixels are."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..checks import Numbers, real_array, require_positive, whole_number


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
        n: Any,
        half_width: Numbers = 1.0,
        center: Numbers = (0.0, 0.0),
    ):
        n1, n2 = n if isinstance(n, tuple) else (n, n)
        self.shape = (whole_number("n", n1, 4), whole_number("n", n2, 4))
        width = real_array("half_width", half_width, None)
        if width.shape not in ((), (2,)):
            raise ValueError(f"half_width has shape {width.shape}, expected a number or a pair.")
        self.half_width = jnp.broadcast_to(width, (2,))
        self.center = real_array("center", center, (2,))
        require_positive("half_width", self.half_width)

    @property
    @eqx.filter_jit
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
    @eqx.filter_jit
    def points(self) -> Float[Array, "x1 x2 2"]:
        """All nodes [length]."""
        return jnp.stack(jnp.meshgrid(self.x1, self.x2, indexing="ij"), axis=-1)

    def _axis(self, axis: int) -> Array:
        unit = jnp.linspace(-1.0, 1.0, self.shape[axis])
        return self.center[axis] + self.half_width[axis] * unit
