"""Forward operator in space: integrals of a volume over spheres, and the adjoint.

The volume is continued between its nodes by Keys' tricubic interpolation, or by the trilinear one,
eight times cheaper, and by zero outside the grid. On each sphere the cap inside the ball about the
grid is covered by a product rule: Gauss-Legendre in the cosine, equispaced around.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_positive, whole_number
from ..base.interpolation import KEYS, LINEAR, polynomial
from ..geometry import VolumeGrid
from ..geometry.caps import Detectors
from ..geometry.elements import NODES, across

KERNELS = {"cubic": KEYS, "linear": LINEAR}


def integrate_over_spheres(
    volume: Numbers,
    grid: VolumeGrid,
    detectors: Detectors,
    radii: Numbers,
    *,
    kernel: str = "cubic",
    n_points: int | None = None,
    n_nodes: int = NODES,
) -> Float[Array, "..."]:
    """g(z, r) = ∫_{|x - z| = r} f dS of a volume known at the nodes of a grid.

    Linear in the volume; differentiable in it, the detectors' positions and the radii. The work is
    split over detectors and radii and done anew in reverse mode: memory is that of one sphere.

    Args:
        volume: f, (..., x1, x2, x3).
        grid: where the nodes are.
        detectors: z.
        radii: r > 0, (radii,) [length].
        kernel: "cubic" or "linear".
        n_points: points between the pole of a sphere's cap and its rim, 2 n_points around; by
            default two in each voxel along the longest cap.
        n_nodes: on round elements it is the mean over so many circles of twice as many points.

    Returns:
        (..., rings, azimuths, radii) or (..., detectors, radii) [length² times the unit of f].

    Raises:
        ValueError: for a volume that does not fit the grid, NaN in it, or an unknown kernel.

    >>> from jaxtat import VolumeGrid
    >>> from jaxtat.geometry import DetectorPoints
    >>> from jaxtat.phantoms.space import Bells
    >>> grid, z, radii = VolumeGrid(17), DetectorPoints([[0.0, 0.0, -1.3]]), jnp.array([1.0, 1.5])
    >>> bell = Bells([[0.1, 0.0, 0.2]], [0.9])
    >>> g = integrate_over_spheres(bell.volume(grid), grid, z, radii, n_points=24)
    >>> bool(abs(g - bell.spherical_integrals(z, radii)).max() < 0.02)
    True
    """
    volume = real_array("volume", volume, ("...", *grid.shape))
    given = _checked(grid, detectors, radii, kernel, n_points, n_nodes)
    found = _integrals(volume.reshape(-1, *grid.shape), *given)
    return found.reshape(*volume.shape[:-3], *detectors.shape, -1)


def integrate_over_spheres_adjoint(
    data: Numbers,
    grid: VolumeGrid,
    detectors: Detectors,
    radii: Numbers,
    *,
    kernel: str = "cubic",
    n_points: int | None = None,
    n_nodes: int = NODES,
) -> Float[Array, "*batch x1 x2 x3"]:
    """The exact transpose of `integrate_over_spheres`: Σ g·data = Σ volume·adjoint(data).

    Args:
        data: (..., rings, azimuths, radii) or (..., detectors, radii).
        grid, detectors, radii, kernel, n_points, n_nodes: as in `integrate_over_spheres`.

    Returns:
        (..., x1, x2, x3).

    Raises:
        ValueError: for data that do not fit the detectors, NaN in them, or an unknown kernel.

    >>> from jaxtat import VolumeGrid
    >>> from jaxtat.geometry import DetectorPoints
    >>> where = VolumeGrid(17), DetectorPoints([[0.0, 0.0, -1.3]]), jnp.array([1.0, 1.5])
    >>> back = integrate_over_spheres_adjoint([[1.0, 0.0]], *where, n_points=24)
    >>> sphere = integrate_over_spheres(jnp.ones((17, 17, 17)), *where, n_points=24)
    >>> bool(abs(back.sum() - sphere[0, 0]) < 1e-12)  # the same sum either way
    True
    """
    given = _checked(grid, detectors, radii, kernel, n_points, n_nodes)
    data = real_array("data", data, ("...", *detectors.shape, given[2].shape[0]))
    n_radii = data.shape[-1]
    found = _adjoint(data.reshape(-1, int(np.prod(detectors.shape)), n_radii), *given)
    return found.reshape(*data.shape[: data.ndim - len(detectors.shape) - 1], *grid.shape)


def default_points(grid: VolumeGrid) -> int:
    """Two points per voxel from the pole of the longest cap to its rim; of a concrete grid."""
    voxels = np.linalg.norm(2 * np.asarray(grid.half_width)) / np.asarray(grid.spacing).min()
    return int(np.ceil(np.pi / 2 * (voxels + 1)))


def _checked(
    grid: VolumeGrid,
    detectors: Detectors,
    radii: Numbers,
    kernel: str,
    n_points: int | None,
    n_nodes: int,
) -> tuple[VolumeGrid, Detectors, Array, str, int, int]:
    radii = real_array("radii", radii, ("radii",))
    require_positive("radii", radii)
    if kernel not in KERNELS:
        raise ValueError(f"kernel is {kernel!r}, expected one of {', '.join(KERNELS)}.")
    if n_points is None:
        if not is_concrete(grid):
            raise ValueError("n_points must be given when the grid is traced.")
        n_points = default_points(grid)
    n_points = whole_number("n_points", n_points, 2)
    n_nodes = whole_number("n_nodes", n_nodes, 1)
    return grid, detectors, radii, kernel, n_points, n_nodes


@partial(jax.jit, static_argnames=("kernel", "n_points", "n_nodes"))
def _integrals(
    volumes: Float[Array, "volumes x1 x2 x3"],
    grid: VolumeGrid,
    detectors: Detectors,
    radii: Float[Array, " radii"],
    kernel: str,
    n_points: int,
    n_nodes: int,
) -> Float[Array, "volumes detectors radii"]:
    taps = KERNELS[kernel].shape[0]
    padded = jnp.pad(volumes, ((0, 0), *[(taps - 1, taps - 1)] * 3))  # all cells a node reaches

    @jax.checkpoint
    def of_sphere(padded: Array, point: Array, r: Array) -> Array:
        points, weights = _sphere_nodes(point, r, grid, n_points)
        index, tap_weights = _taps(grid, points, kernel)
        values = padded.reshape(padded.shape[0], -1)[:, index]
        return jnp.sum(values * (tap_weights * weights[:, None]), axis=(1, 2))

    def of_detector(point: Array) -> Array:
        return jax.lax.map(lambda r: of_sphere(padded, point, r), radii)

    def of_points(points: Array) -> Array:
        return jax.lax.map(of_detector, points.reshape(-1, 3))

    return jnp.moveaxis(detectors.mean_over_elements(of_points, n_nodes), -1, 0)


@eqx.filter_jit
def _adjoint(
    data: Array, grid: VolumeGrid, detectors: Detectors, radii: Array, *how: str | int
) -> Array:
    def forward(volumes: Array) -> Array:
        return _integrals(volumes, grid, detectors, radii, *how)

    shape = jax.ShapeDtypeStruct((data.shape[0], *grid.shape), data.dtype)
    (volumes,) = jax.linear_transpose(forward, shape)(data)
    return volumes


def _sphere_nodes(
    point: Float[Array, "3"], r: Float[Array, ""], grid: VolumeGrid, n_points: int
) -> tuple[Float[Array, "nodes 3"], Float[Array, " nodes"]]:
    """Points on the part of the sphere inside the ball about the grid, and their area."""
    to_center = grid.center - point
    d2 = jnp.sum(to_center**2)
    # a detector at the very centre sees all of every sphere: any direction does
    d = jnp.sqrt(jnp.where(d2 > 0, d2, 1.0))
    towards = jnp.where(d2 > 0, to_center / d, jnp.array([0.0, 0.0, 1.0]))
    reach2 = jnp.sum((grid.half_width + grid.spacing) ** 2)  # interpolation reaches a voxel out
    cosine = jnp.where(d2 > 0, (d**2 + r**2 - reach2) / (2 * d * r), jnp.sign(r**2 - reach2) * 2)
    height = 1 - jnp.clip(cosine, -1.0, 1.0)  # of the cap, over r
    node, weight = np.polynomial.legendre.leggauss(n_points)
    depth = height * (node + 1) / 2
    around = np.pi / n_points * (np.arange(2 * n_points) + 0.5)
    ring = jnp.sqrt(jnp.maximum(depth * (2 - depth), 1e-300))  # a cap of no height has no rings
    first, second = across(towards)
    outwards = np.cos(around)[:, None] * first + np.sin(around)[:, None] * second
    direction = (1 - depth)[:, None, None] * towards + ring[:, None, None] * outwards
    areas = r**2 * height / 2 * weight * (np.pi / n_points)
    points = point + r * direction.reshape(-1, 3)
    return points, jnp.repeat(areas, 2 * n_points, total_repeat_length=points.shape[0])


def _taps(
    grid: VolumeGrid, points: Float[Array, "nodes 3"], kernel: str
) -> tuple[Array, Float[Array, "nodes taps"]]:
    """Indices in the padded volume of the nodes around each point, and their weights."""
    table = KERNELS[kernel]
    taps, shape = table.shape[0], np.asarray(grid.shape)
    position = (points - grid.center + grid.half_width) / grid.spacing
    cell = jnp.floor(position)
    inside = jnp.all((cell >= -taps // 2) & (cell < shape + taps // 2 - 1), axis=-1)
    corner = jnp.where(inside[:, None], cell + taps // 2, 0.0).astype(jnp.int32)
    wide = shape + 2 * (taps - 1)
    strides = np.array([wide[1] * wide[2], wide[2], 1])
    offsets = np.indices((taps,) * 3).reshape(3, -1).T @ strides
    t = position - cell
    w1, w2, w3 = (jnp.stack([polynomial(list(row), t[:, i]) for row in table]) for i in range(3))
    weights = jnp.einsum("an,bn,cn->nabc", w1, w2, w3).reshape(len(points), -1)
    index = corner @ strides.astype(np.int32)
    return index[:, None] + offsets, jnp.where(inside[:, None], weights, 0.0)
