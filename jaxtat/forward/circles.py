"""Forward operator: circular integrals of a pixel image, and its adjoint.

The image is continued between its pixels by Keys' bicubic interpolation (third order in the pixel
size for smooth images) and by zero outside the grid; circles are cut into short equal pieces.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_objects, require_positive
from ..base.interpolation import KEYS, cell_polynomials, polynomial
from ..geometry import DetectorCurve, ImageGrid
from ..geometry.elements import NODES


def integrate_over_circles(
    image: Numbers,
    grid: ImageGrid,
    curve: DetectorCurve,
    radii: Numbers,
    *,
    n_points: int | None = None,
    n_nodes: int = NODES,
) -> Float[Array, "*batch detectors radii"]:
    """g(z, r) = ∫_{|x - z| = r} f dl = r ∫ f(z + r (cos φ, sin φ)) dφ of a pixel image.

    The midpoint rule runs over the part of the circle that lies in the disk around the grid.
    Linear in the image; differentiable in the image, the detector positions and the radii. The
    work is split over detectors and recomputed in reverse mode, so that memory stays at a few
    detectors' worth. Of elements of finite width it is the mean over their nodes.

    Args:
        image: f at the nodes of the grid, (..., x1, x2).
        grid: where the nodes are.
        curve: the detectors z.
        radii: r > 0, (radii,) [length].
        n_points: points per circle; by default two per pixel along the longest arc in the grid.
        n_nodes: on elements of finite width; by default enough for some three pixels.

    Returns:
        (..., detectors, radii) [length times the unit of f].

    Raises:
        ValueError: for an image that does not fit the grid, or NaN in it.

    Source: Keys, IEEE Trans. ASSP 29 (1981) 1153-1160 (interpolation).

    >>> from jaxtat import ImageGrid, circular_arc, phantoms
    >>> grid, curve, radii = ImageGrid(65), circular_arc(1.3, 1.0, 8), jnp.linspace(0.3, 2.3, 9)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.6])
    >>> g = integrate_over_circles(bell.image(grid), grid, curve, radii)
    >>> bool(jnp.abs(g - bell.circular_integrals(curve, radii)).max() < 1e-3)
    True
    """
    require_objects(grid=grid, curve=curve)
    image = real_array("image", image, ("...", *grid.shape))
    radii = _radii(radii)
    n_points = n_points or default_points(grid)
    g = _integrals(image.reshape(-1, *grid.shape), grid, curve, radii, n_points, n_nodes)
    return g.reshape(*image.shape[:-2], *g.shape[1:])


def integrate_over_circles_adjoint(
    data: Numbers,
    grid: ImageGrid,
    curve: DetectorCurve,
    radii: Numbers,
    *,
    n_points: int | None = None,
    n_nodes: int = NODES,
) -> Float[Array, "*batch x1 x2"]:
    """The exact transpose of `integrate_over_circles`: Σ g·data = Σ image·adjoint(data).

    Args:
        data: (..., detectors, radii).
        grid, curve, radii, n_points, n_nodes: as in `integrate_over_circles`.

    Returns:
        (..., x1, x2).
    """
    require_objects(grid=grid, curve=curve)
    radii = _radii(radii)
    data = real_array("data", data, ("...", curve.n_detectors, radii.shape[0]))
    n_points = n_points or default_points(grid)
    images = _adjoint(data.reshape(-1, *data.shape[-2:]), grid, curve, radii, n_points, n_nodes)
    return images.reshape(*data.shape[:-2], *grid.shape)


def default_points(grid: ImageGrid) -> int:
    """Two points per pixel along π/2 diagonals, the longest arc seen from outside the image."""
    if not is_concrete(grid):
        raise ValueError("n_points must be given when the grid is traced.")
    width = 2 * np.asarray(grid.half_width)
    pixels = np.hypot(*width) / (width / (np.asarray(grid.shape) - 1)).min()
    return int(np.ceil(np.pi * (pixels + 1)))


def _radii(radii: Numbers) -> Array:
    radii = real_array("radii", radii, ("radii",))
    require_positive("radii", radii)
    return radii


@partial(jax.jit, static_argnames=("n_points", "n_nodes"))
def _integrals(
    images: Float[Array, "images x1 x2"],
    grid: ImageGrid,
    curve: DetectorCurve,
    radii: Array,
    n_points: int,
    n_nodes: int,
) -> Float[Array, "images detectors radii"]:
    cells = jax.vmap(_cells)(images)

    # the outermost loop, and made anew in reverse mode: inside a loop over images, the nodes of
    # all detectors would be kept (3.9 GB at the paper's size)
    @jax.checkpoint
    def of_detector(point: Array) -> Array:
        points, weights = _arc_nodes(point, radii, grid, n_points)
        return jax.lax.map(
            lambda one: jnp.sum(weights * _sample(one, grid, points), axis=-1), cells
        )

    g = curve.mean_over_elements(lambda points: jax.lax.map(of_detector, points), n_nodes)
    return jnp.moveaxis(g, 0, 1)


@eqx.filter_jit
def _adjoint(
    data: Array, grid: ImageGrid, curve: DetectorCurve, radii: Array, n_points: int, n_nodes: int
):
    def forward(images):
        return _integrals(images, grid, curve, radii, n_points, n_nodes)

    shape = jax.ShapeDtypeStruct((data.shape[0], *grid.shape), data.dtype)
    (images,) = jax.linear_transpose(forward, shape)(data)
    return images


def _arc_nodes(
    point: Array, radii: Array, grid: ImageGrid, n_points: int
) -> tuple[Float[Array, "radii points 2"], Float[Array, "radii 1"]]:
    """Midpoints of equal pieces of each circle inside the disk about the grid, and their length."""
    to_center = grid.center - point
    d2 = jnp.sum(to_center**2)
    # a detector at the very centre sees all of every circle: any distance does
    d = jnp.sqrt(jnp.where(d2 > 0, d2, 1.0))
    reach2 = jnp.sum((grid.half_width + grid.spacing) ** 2)  # interpolation reaches a pixel out
    cosine = (d**2 + radii**2 - reach2) / (2 * d * radii)
    proper = (jnp.abs(cosine) < 1) & (d2 > 0)
    angle = jnp.arccos(jnp.where(proper, cosine, 0.0))
    half = jnp.where(proper, angle, jnp.where((cosine <= -1) | (d2 == 0), jnp.pi, 0.0))
    towards = jnp.where(d2 > 0, to_center / d, jnp.array([1.0, 0.0]))
    phi = half[:, None] * ((2 * jnp.arange(n_points) + 1) / n_points - 1)
    along, across = jnp.cos(phi), jnp.sin(phi)
    direction = jnp.stack(
        [towards[0] * along - towards[1] * across, towards[1] * along + towards[0] * across], -1
    )
    return point + radii[:, None, None] * direction, (2 * half * radii / n_points)[:, None]


@jax.jit
def sample(
    image: Float[Array, "x1 x2"], grid: ImageGrid, points: Float[Array, "*n 2"]
) -> Float[Array, "*n"]:
    """Keys' bicubic interpolation of an image at any points, zero outside the grid.

    Args:
        image: f at the nodes of the grid, (x1, x2).
        grid: where the nodes are.
        points: (..., 2) [length].

    Returns:
        (...).

    >>> grid = ImageGrid(9)
    >>> parabola = grid.points[..., 0] ** 2  # is reproduced
    >>> round(float(sample(parabola, grid, jnp.array([0.3, 0.1]))), 12)
    0.09
    """
    return _sample(_cells(image), grid, points)


def _cells(image: Array) -> list[list[Array]]:
    """Bicubic polynomials, [power of t_2][power of t_1], of the cells between padded pixels."""
    padded = jnp.pad(image, 3)  # then every cell that meets a pixel's kernel is there
    along_x2 = cell_polynomials(KEYS, padded)
    return [[c.T for c in cell_polynomials(KEYS, rows.T)] for rows in along_x2]


def _sample(cells: list[list[Array]], grid: ImageGrid, points: Array) -> Array:
    position = (points - grid.center + grid.half_width) / grid.spacing
    first = jnp.floor(position)
    t = position - first
    n1, n2 = grid.shape
    inside = jnp.all((first >= -2) & (first <= jnp.array([n1, n2])), axis=-1)
    corner = jnp.where(inside[..., None], first + 2, 0.0).astype(jnp.int32)
    index = corner[..., 0] * (n2 + 3) + corner[..., 1]

    def read(array: Array) -> Array:
        return array.ravel().at[index].get(mode="promise_in_bounds")

    in_t1 = [[read(array) for array in row] for row in cells]
    value = polynomial([polynomial(row, t[..., 0]) for row in in_t1], t[..., 1])
    return jnp.where(inside, value, 0.0)
