"""Detectors of finite size: the datum is the mean of g(z, r) over the element of a detector.

In the plane an element is a short piece of curve, so long as its width: along the circle for
detectors of a `CircularArc`, along the tangent for others. On a circle about which waves are taken
the mean of exp(i m theta) over an element of the angle D is exp(i m theta_k) sin(m D/2) / (m D/2);
elsewhere means are Gauss-Legendre sums.

In space an element is a round piece of the sphere about the detectors' centre on which it lies, so
long from its middle to its rim as its radius. There the mean of Y_lm over an element of the angle D
is Y_lm(z_k) times the mean of P_l(cos theta) over theta < D (the addition theorem, DLMF 14.30.9).
Elements that face elsewhere are flat disks, and means over them sums over points of them.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..base.checks import Numbers, is_concrete, real_array
from ..special import legendre_functions

T = TypeVar("T")

NODES = 8  # by default: exact to 1e-7 for elements of three pixels
MOST_NODES = 100
SQUARE = 1 / np.sqrt(3)  # radius of a disk over the side of a square, of the same second moment


def element_factor(
    orders: Int[Array, " orders"], angle: Float[Array, "*detectors"]
) -> Float[Array, "orders *detectors"]:
    """sin(m D/2) / (m D/2), the mean of cos m theta over -D/2 < theta < D/2; 1 for m D = 0.

    Args:
        orders: m.
        angle: D, under which elements are seen from the centre of their circle [rad].

    >>> round(float(element_factor(jnp.array([3]), jnp.array(0.5))[0]), 6)  # sin(0.75) / 0.75
    0.908852
    """
    shape = (-1, *[1] * jnp.ndim(angle))
    return jnp.sinc(jnp.reshape(orders, shape) * angle / (2 * jnp.pi))


def round_factor(
    n_degrees: int, angle: Float[Array, "*detectors"], n_nodes: int
) -> Float[Array, "degrees *detectors"]:
    """(P_{l-1}(cos D) - P_{l+1}(cos D)) / ((2l + 1)(1 - cos D)), the mean of P_l over theta < D.

    As a Gauss-Legendre sum in cos theta, in which nothing cancels for small D.

    Args:
        n_degrees: l = 0 .. n_degrees - 1.
        angle: D, under which an element's radius is seen from the centre [rad].
        n_nodes: of the sum, see `enough_nodes`.

    >>> factor = round_factor(3, jnp.array(0.5), 8)  # P_1 is the cosine: (1 + cos D) / 2
    >>> bool(abs(float(factor[1]) - (1 + np.cos(0.5)) / 2) < 1e-14)
    True
    """
    nodes, weights = gauss_rule(n_nodes)
    cosines = 1 - jnp.sin(angle[..., None] / 2) ** 2 * (1 - nodes)
    legendre = legendre_functions(jnp.zeros(1, int), n_degrees, cosines.reshape(-1), 0)[0]
    means = legendre.reshape(n_degrees, *cosines.shape) @ weights
    norms = np.sqrt(4 * np.pi / (2 * np.arange(n_degrees) + 1))
    return means * norms.reshape(-1, *[1] * angle.ndim)


def enough_nodes(width: Numbers | None, highest_frequency: float) -> int:
    """Number of nodes that give the mean of cos(lambda s) over |s| < width/2 to 5e-6.

    The error of the Gauss rule falls like (e lambda width / 8 n)^(2n) once n exceeds that.

    Args:
        width: of the elements, concrete; None of point detectors [length].
        highest_frequency: lambda [rad/length].

    Raises:
        ValueError: for elements of more than a hundred wavelengths or so.
    """
    if width is None:
        return 1
    widest = float(np.max(np.asarray(width)))
    n = 4 + math.ceil(highest_frequency * widest / 3)
    if n > MOST_NODES:
        raise ValueError(
            f"elements of {widest:.6g} are {highest_frequency * widest / (2 * np.pi):.3g} "
            "wavelengths wide at the highest frequency, expected at most "
            f"{3 * (MOST_NODES - 4) / (2 * np.pi):.3g}: check the unit of element_width, or pass a "
            "smaller max_frequency."
        )
    return n


def checked_width(
    width: Numbers | None, weights: Float[Array, " detectors"]
) -> Float[Array, "*one_or_detectors"] | None:
    """A width for all elements or one for each, or ValueError.

    Args:
        width: in the unit of the positions [length].
        weights: of the detectors, which add up to the length of the curve [length].
    """
    if width is None:
        return None
    width = real_array("element_width", width, None)
    if width.shape not in ((), weights.shape):
        raise ValueError(
            f"element_width has shape {width.shape}, expected one number, or one for each of "
            f"{weights.shape[0]} detectors."
        )
    if is_concrete(width):
        low, high = float(np.min(width)), float(np.max(width))
        if low < 0:
            raise ValueError(f"element_width is {low:.6g}, expected a length, 0 or above.")
        length = float(weights.sum()) if is_concrete(weights) else np.inf
        if high > length:
            raise ValueError(
                f"element_width is {high:.6g}, longer than the whole curve, {length:.6g}: expected "
                "the width of one element, in the unit of the positions."
            )
    return width


def checked_element_radius(
    element_radius: Numbers | None,
    distance: Float[Array, "*detectors"],
    element_size: Numbers | None = None,
) -> Float[Array, "*one_or_detectors"] | None:
    """A radius for all elements or one for each, or ValueError.

    Args:
        element_radius: in the unit of the positions [length].
        distance: of the detectors from their centre, one of all on a sphere [length].
        element_size: the side of square elements in its place, see `SQUARE` [length].
    """
    if element_radius is not None and element_size is not None:
        raise ValueError("element_radius and element_size are both given, expected one of them.")
    name, given = "element_radius", element_radius
    if given is None:
        name, given = "element_size", element_size
    if given is None:
        return None
    size = real_array(name, given, None)
    if size.shape not in ((), distance.shape):
        each = f", or one for each of {distance.shape[0]} detectors" if distance.ndim else ""
        raise ValueError(f"{name} has shape {size.shape}, expected one number{each}.")
    if is_concrete(size, distance):
        low, angle = float(np.min(size)), float(np.max(size / distance))
        if low < 0 or angle > 1:
            raise ValueError(
                f"{name} is {low if low < 0 else float(np.max(size)):.6g}, expected a length, 0 or "
                "above, and below the detectors' distance from their centre, "
                f"{float(np.min(distance)):.6g}: in the unit of the positions."
            )
    return size if name == "element_radius" else size * SQUARE


def checked_normals(normals: Numbers, n: int) -> Float[Array, "detectors 3"]:
    """Unit vectors, or ValueError for zeros."""
    normals = real_array("normals", normals, (n, 3))
    lengths = jnp.linalg.norm(normals, axis=1, keepdims=True)
    if is_concrete(lengths) and not np.asarray(lengths).all():
        raise ValueError(
            f"normal {int(np.argmin(np.asarray(lengths)))} is zero, expected a direction."
        )
    return normals / lengths


def gauss_rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in (-1, 1), and weights that add up to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return nodes, weights / 2


def nodes_along_tangent(xp: Any, points: Any, normals: Any, width: Any, nodes: np.ndarray) -> Any:
    """z_k + s t_k, |s| < width/2, (detectors, nodes, 2), by numpy or jax.numpy."""
    tangents = xp.stack([-normals[:, 1], normals[:, 0]], axis=-1)
    along = xp.broadcast_to(width, points.shape[:1])[:, None] / 2 * nodes
    return points[:, None, :] + along[..., None] * tangents[:, None, :]


def nodes_along_circle(
    xp: Any, center: Any, radius: Any, normals: Any, width: Any, nodes: np.ndarray
) -> Any:
    """c + R (n cos phi + t sin phi), |phi| < width/2R, (detectors, nodes, 2), likewise."""
    tangents = xp.stack([-normals[:, 1], normals[:, 0]], axis=-1)
    phi = xp.broadcast_to(width / radius, normals.shape[:1])[:, None, None] / 2 * nodes[:, None]
    turned = normals[:, None, :] * xp.cos(phi) + tangents[:, None, :] * xp.sin(phi)
    return center + radius * turned


def nodes_touching_circle(xp: Any, radius: Any, width: Any, nodes: Any) -> tuple[Any, Any]:
    """Distances from a circle's centre, and angles, of a straight element that touches it.

    Args:
        radius, width: of the circle and of the element [length].
        nodes: in (-1, 1).
    """
    along = width / 2 * nodes
    return xp.hypot(radius, along), xp.arctan2(along, radius)


def nodes_on_sphere(
    units: Float[Array, "*detectors 3"], angle: Float[Array, "*one_or_detectors"], n: int
) -> tuple[Float[Array, "nodes *detectors 3"], Float[np.ndarray, " nodes"]]:
    """Unit vectors to n circles of 2n nodes on every round element, and weights that add up to 1.

    Args:
        units: from the centre to the middles of the elements.
        angle: as in `round_factor`.
        n: of Gauss's rule in the cosine.
    """
    nodes, weights = gauss_rule(n)
    around = np.pi / n * (np.arange(2 * n) + 0.5)
    sine = jnp.sin(jnp.broadcast_to(angle, units.shape[:-1]) / 2)
    depth = (sine**2 * (1 - nodes.reshape(-1, *[1] * sine.ndim)))[..., None]
    # of d(2 - d), which is zero for elements without size, the root that can be differentiated
    ring = sine[..., None] * np.sqrt(1 - nodes).reshape(depth.shape[:1] + (1,) * sine.ndim + (1,))
    ring = ring * jnp.sqrt(2 - depth)
    first, second = across(units)
    turned = [np.cos(phi) * first + np.sin(phi) * second for phi in around]
    nodes = [(1 - depth) * units + ring * direction for direction in turned]
    return jnp.concatenate(nodes), np.tile(weights, 2 * n) / (2 * n)


def nodes_on_disks(
    points: Float[Array, "detectors 3"],
    normals: Float[Array, "detectors 3"],
    radius: Float[Array, "*one_or_detectors"],
    n: int,
) -> tuple[Float[Array, "nodes detectors 3"], Float[np.ndarray, " nodes"]]:
    """n circles of 2n + 3 nodes on flat disks, and weights that add up to 1.

    Of waves along the disks the mean is exact to 1e-3 up to lambda a = 3 (n - 1).

    Args:
        points, normals: the middles of the disks, and unit vectors at right angles to them.
        radius: a [length].
        n: of Gauss's rule in the square of the distance from the middle.

    >>> nodes, weights = nodes_on_disks(jnp.zeros((1, 3)), jnp.eye(3)[2:], jnp.array(0.5), 2)
    >>> mean = jnp.cos(6 * nodes[:, 0, 0]) @ weights  # 2 J_1(3) / 3
    >>> bool(abs(mean - 0.226039) < 1e-3)
    True
    """
    nodes, weights = gauss_rule(n)
    first, second = across(normals)
    around = 2 * np.pi / (2 * n + 3) * (np.arange(2 * n + 3) + 0.5 * (np.arange(n) % 2)[:, None])
    steps = np.sqrt((1 + nodes) / 2)[:, None] * np.stack([np.cos(around), np.sin(around)])
    along, aside = (jnp.asarray(step.reshape(-1, 1, 1)) for step in steps)
    sides = jnp.broadcast_to(radius, points.shape[:1])[:, None]
    placed = points + sides * (along * first + aside * second)
    return placed, np.repeat(weights, 2 * n + 3) / (2 * n + 3)


def across(e: Float[Array, "*n 3"]) -> tuple[Float[Array, "*n 3"], Float[Array, "*n 3"]]:
    """Two unit vectors at right angles to e and each other.

    Source: Duff et al., Journal of Computer Graphics Techniques 6 (2017) 1-8.
    """
    x, y, z = jnp.moveaxis(e, -1, 0)
    sign = jnp.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = jnp.stack([1 + sign * x**2 * a, sign * b, -sign * x], axis=-1)
    return first, jnp.stack([b, sign + y**2 * a, -y], axis=-1)


def touch_circle(normals: Any, outward: Any, rounding: float) -> bool:
    """Whether straight elements are at right angles to their radii, unit vectors; concrete."""
    across = np.abs(np.sum(np.asarray(normals) * outward, axis=1))
    return bool(across.min() > 1 - rounding)


def mean_over_nodes(compute: Callable[[Any], T], nodes: Any, weights: Float[Array, " nodes"]) -> T:
    """Σ_i c_i compute(nodes_i), one node after the other: the memory is that of one node.

    Args:
        compute: of one node of every element, to arrays.
        nodes: arrays, nodes first.
        weights: c_i.
    """

    def add(total: T, node_and_weight: tuple[Any, Array]) -> tuple[T, None]:
        node, weight = node_and_weight
        return jax.tree.map(lambda t, v: t + weight * v, total, compute(node)), None

    one = jax.eval_shape(compute, jax.tree.map(lambda leaf: leaf[0], nodes))
    start = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), one)
    return jax.lax.scan(jax.checkpoint(add), start, (nodes, weights))[0]
