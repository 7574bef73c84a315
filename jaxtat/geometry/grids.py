"""Grids of images and volumes."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, by_library, real_array, require_positive, whole_number


class Grid(eqx.Module):
    """Nodes x_i = c + b (2 i/(n-1) - 1), i = 0..n-1, along each axis; see `ImageGrid`."""

    half_width: Float[Array, " dimension"]
    center: Float[Array, " dimension"]
    shape: tuple[int, ...] = eqx.field(static=True)

    dimension: ClassVar[int]

    def __init__(self, n: Any, half_width: Numbers, center: Numbers):
        d = self.dimension
        shape = n if isinstance(n, tuple) else (n,) * d
        if len(shape) != d:
            raise ValueError(f"n is {n!r}, expected a number or {d} of them.")
        self.shape = tuple(whole_number("n", size, 4) for size in shape)
        width = real_array("half_width", half_width, None)
        if width.shape not in ((), (d,)):
            raise ValueError(f"half_width has shape {width.shape}, expected a number or {d}.")
        self.half_width = by_library(lambda xp, width: xp.broadcast_to(width, (d,)), (width,))
        self.center = real_array("center", center, (d,))
        require_positive("half_width", self.half_width)

    @property
    def spacing(self) -> Float[Array, " dimension"]:
        """Distance h between neighbouring nodes along each axis [length]."""
        return by_library(_spacing, (self.half_width,), self.shape)

    @property
    def points(self) -> Float[Array, "*nodes dimension"]:
        """All nodes [length]."""
        return by_library(_points, (self.half_width, self.center), self.shape)

    def finer(self, times: int) -> "Grid":
        """The grid in which every pixel is divided into ``times`` parts along each axis.

        >>> grid = ImageGrid(5)
        >>> fine = grid.finer(2)
        >>> fine.shape, fine.x1[:2].tolist()  # the pixel about -1 goes from -1.25 to -0.75
        ((10, 10), [-1.125, -0.875])
        """
        times = whole_number("times", times, 1)
        n = np.array(self.shape)
        half_width = self.half_width * (times * n - 1) / (times * (n - 1))
        return type(self)(tuple((times * n).tolist()), half_width, self.center)

    def means(self, images: Numbers) -> Float[Array, "*batch_and_nodes"]:
        """Means of images on a finer grid over the pixels of this one.

        Args:
            images: on ``self.finer(times)``, (..., times x1, times x2[, times x3]).

        Raises:
            ValueError: for images of another shape.

        >>> np.diagonal(ImageGrid(4).means(np.eye(8))).tolist()
        [0.5, 0.5, 0.5, 0.5]
        """
        images, d = jnp.asarray(images), self.dimension
        times = images.shape[-1] // self.shape[-1] if images.ndim >= d else 0
        if times < 1 or images.shape[-d:] != tuple(times * n for n in self.shape):
            raise ValueError(
                f"images have shape {images.shape}, expected those of a finer grid, multiples of "
                f"{self.shape}."
            )
        batch = images.shape[: images.ndim - d]
        split = sum(((n, times) for n in self.shape), ())
        axes = tuple(range(len(batch) + 1, len(batch) + 2 * d, 2))
        return images.reshape(*batch, *split).mean(axis=axes)

    @property
    def x1(self) -> Float[Array, " x1"]:
        """First coordinates of the nodes [length]."""
        return self.axis(0)

    @property
    def x2(self) -> Float[Array, " x2"]:
        """Second coordinates of the nodes [length]."""
        return self.axis(1)

    def axis(self, number: int) -> Array:
        """Coordinates of the nodes along one axis [length]."""
        return by_library(_axis, (self.half_width, self.center), self.shape, number)


def _spacing(xp: Any, half_width: Any, shape: tuple[int, ...]) -> Any:
    return 2 * half_width / (np.array(shape) - 1.0)


def _axis(xp: Any, half_width: Any, center: Any, shape: tuple[int, ...], number: int) -> Any:
    return center[number] + half_width[number] * np.linspace(-1.0, 1.0, shape[number])


def _points(xp: Any, half_width: Any, center: Any, shape: tuple[int, ...]) -> Any:
    axes = [_axis(xp, half_width, center, shape, number) for number in range(len(shape))]
    return xp.stack(xp.meshgrid(*axes, indexing="ij"), axis=-1)


class ImageGrid(Grid):
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

    shape: tuple[int, int] = eqx.field(static=True)

    dimension = 2

    def __init__(self, n: Any, half_width: Numbers = 1.0, center: Numbers = (0.0, 0.0)):
        super().__init__(n, half_width, center)


class VolumeGrid(Grid):
    """Nodes of a volume f[i, j, k] = f(x_ijk), as those of an `ImageGrid`, with three axes.

    Args:
        n: number of nodes per axis, an int or three, at least 4.
        half_width: b, from the centre to the last node, a number or three [length].
        center: c, (3,) [length].

    >>> grid = VolumeGrid((9, 9, 5), half_width=(1.0, 1.0, 0.5))
    >>> grid.points.shape, grid.spacing.tolist()
    ((9, 9, 5, 3), [0.25, 0.25, 0.25])
    """

    shape: tuple[int, int, int] = eqx.field(static=True)

    dimension = 3

    def __init__(self, n: Any, half_width: Numbers = 1.0, center: Numbers = (0.0, 0.0, 0.0)):
        super().__init__(n, half_width, center)

    @property
    def x3(self) -> Float[Array, " x3"]:
        """Third coordinates of the nodes [length]."""
        return self.axis(2)

    def across(self, number: int) -> ImageGrid:
        """The nodes of a slice perpendicular to axis 0, 1 or 2, by the others in their order."""
        if number not in (0, 1, 2):
            raise ValueError(f"number is {number}, expected an axis of the volume: 0, 1 or 2.")
        pair = np.array([k for k in range(3) if k != number])
        shape = self.shape[pair[0]], self.shape[pair[1]]
        return ImageGrid(shape, self.half_width[pair], self.center[pair])
