"""Mirror symmetry of a geometry: one problem becomes two of half the size.

If detectors and boundary points are their own mirror images about a line, functions on them split
into even and odd ones, and the potentials map even to even and odd to odd. In the orthonormal basis
(e_k ± e_k')/√2 of mirrored pairs k, k' the matrix A falls into the blocks A_rk ± A_rk'.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from ..base.checks import is_concrete
from ..geometry import DetectorCurve, Region


class Mirror(eqx.Module):
    """Mirrored pairs: indices of the points on one side, and of their images on the other."""

    detectors: Int[Array, "2 half"]
    boundary: Int[Array, "2 half_boundary"]

    def half_region(self, region: Region) -> Region:
        """The region with the boundary points of one side."""
        chosen = self.boundary[0]
        return eqx.tree_at(
            lambda tree: (tree.points, tree.weights, tree.normals),
            region,
            (region.points[chosen], region.weights[chosen], region.normals[chosen]),
        )

    def fold_matrix(self, matrix: Float[Array, "rows unknowns"]) -> Float[Array, "2 rows half"]:
        """Even and odd block of a matrix with rows of one side; columns (2, detectors)."""
        here, there = (matrix.reshape(matrix.shape[0], 2, -1)[..., i] for i in self.detectors)
        return jnp.stack([here + there, here - there]).reshape(2, matrix.shape[0], -1)

    def fold_rhs(self, rhs: Complex[Array, "equations rhs"]) -> Complex[Array, "2 rows rhs"]:
        """Even and odd part of right-hand sides with rows (2, boundary)."""
        here, there = (rhs.reshape(2, -1, rhs.shape[1])[:, i] for i in self.boundary)
        return jnp.stack([here + there, here - there]).reshape(2, -1, rhs.shape[1]) / np.sqrt(2)

    def unfold(self, parts: Complex[Array, "2 half rhs"]) -> Complex[Array, "unknowns rhs"]:
        """Unknowns (2, detectors) from their even and odd part."""
        even, odd = parts.reshape(2, 2, -1, parts.shape[-1]) / np.sqrt(2)
        both = jnp.concatenate([even + odd, even - odd], axis=1)
        order = jnp.argsort(self.detectors.ravel())
        return both[:, order].reshape(-1, parts.shape[-1])


def find_mirror(curve: DetectorCurve, region: Region) -> Mirror | None:
    """The mirror symmetry of curve and region about the line towards the middle of the curve.

    None if there is no such symmetry, if a point lies on the line, or if the geometry is traced
    (derivatives with respect to single positions would break it).

    >>> from jaxtat import circular_arc, disk
    >>> curve, region = circular_arc(1.3, 0, 6, angle=2.0), disk(1, 1, n_boundary=8, angle=2.0)
    >>> mirror = find_mirror(curve, region)
    >>> mirror.detectors.tolist()
    [[0, 1, 2], [5, 4, 3]]
    """
    if not is_concrete(curve, region):
        return None
    center, points = np.asarray(region.center), np.asarray(curve.points)
    axis = points.mean(axis=0) - center
    if np.linalg.norm(axis) < 1e-6 * float(region.reach):
        return None
    pairs = [
        mirrored_pairs(np.asarray(p) - center, np.asarray(w), axis / np.linalg.norm(axis))
        for p, w in ((points, curve.weights), (region.points, region.weights))
    ]
    if pairs[0] is None or pairs[1] is None:
        return None
    if not elements_mirrored(curve, center, axis / np.linalg.norm(axis)):
        return None
    return Mirror(jnp.asarray(pairs[0]), jnp.asarray(pairs[1]))


def elements_mirrored(curve: DetectorCurve, center: np.ndarray, axis: np.ndarray) -> bool:
    """Whether the elements of known, mirrored detectors are mirrored too; ``axis`` a unit vector.

    Traced widths count as mirrored if there is one for all.
    """
    width, normals = curve.element_width, np.asarray(curve.normals)
    if width is None:
        return True
    weights = np.asarray(curve.weights)
    if not is_concrete(width):
        if width.ndim:
            return False
        width = weights.max()
    along = np.broadcast_to(width, weights.shape)[:, None] * normals[:, ::-1] * (-0.5, 0.5)
    middle = np.asarray(curve.points) - center
    ends = np.concatenate([middle + along, middle - along])
    return mirrored_pairs(ends, np.tile(weights, 2), axis) is not None


def mirrored_pairs(points: np.ndarray, weights: np.ndarray, axis: np.ndarray) -> np.ndarray | None:
    """Indices of points on one side of the line through 0 along ``axis``, and of their images.

    None if the points and their weights are not mirrored, or one lies on the line.
    """
    from scipy.spatial import KDTree  # slow to import

    images = 2 * np.outer(points @ axis, axis) - points
    distance, partner = map(np.asarray, KDTree(points).query(images))
    index = np.arange(len(points))
    tolerance = 1e-9 * np.abs(points).max()
    if distance.max() > tolerance or (partner == index).any():
        return None
    if np.abs(weights - weights[partner]).max() > 1e-9 * weights.max():
        return None
    side = index[index < partner]
    return np.stack([side, partner[side]])
