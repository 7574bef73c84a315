"""The yardstick in space: back-projection by the formula for the whole sphere."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_positive, whole_number
from ..base.rows import equal_parts
from ..geometry.caps import Detectors
from ..steps.quadrature import interpolation_matrix

_DETECTORS = 64  # worked on together


def back_projection(
    detectors: Detectors, radii: Numbers, g: Numbers, points: Numbers
) -> Float[Array, "..."]:
    """f(x) = -1/(8π² R_g) ∫ (1/r) d²g(z, r)/dr² at r = |x - z| dS(z), exact on a whole sphere.

    On a cap the integral is over the cap, as is customary, and the missing part causes artefacts.
    Second differences in r, straight lines between, on as many equispaced radii as there are; data
    on others are read there first, see `radial_quadrature`.

    Args:
        detectors: on a sphere about their centre; the weights of points are areas [length²].
        radii: increasing, at least 3, above zero, (radii,) [length].
        g: spherical integrals, (*detectors, radii).
        points: x, (..., 3), inside the sphere [length].

    Returns:
        (...), the unit of g per length².

    Raises:
        ValueError: for radii that do not increase, wrong shapes, or NaN.

    Source: Finch, Patch, Rakesh, SIAM J. Math. Anal. 35 (2004) 1213-1240, theorem 3.

    >>> from jaxtat.geometry import spherical_cap
    >>> from jaxtat.phantoms.space import SolidBells
    >>> cap, radii = spherical_cap(1.3, 1.3, 24, 48), jnp.linspace(0.2, 2.4, 221)
    >>> bell = SolidBells([[0.1, 0.2, 0.0]], [0.7])
    >>> x = jnp.array([[0.1, 0.2, 0.1], [0.0, 0.0, -0.5]])
    >>> f = back_projection(cap, radii, bell.spherical_integrals(cap, radii), x)
    >>> bool(abs(f - bell(x)).max() < 2e-3)
    True
    """
    radii = real_array("radii", radii, ("radii",))
    whole_number("the number of radii", radii.shape[0], 3)
    require_positive("radii", radii)
    if is_concrete(radii) and not (np.diff(np.asarray(radii)) > 0).all():
        raise ValueError("radii do not increase from one to the next: sort them, and g with them.")
    g = real_array("g", g, (*detectors.shape, radii.shape[0]))
    points = real_array("points", points, ("...", 3))
    found = _back_projection(detectors, radii, g, points.reshape(-1, 3))
    return found.reshape(points.shape[:-1])


@eqx.filter_jit
def _back_projection(detectors: Detectors, radii: Array, g: Array, points: Array) -> Array:
    nodes = jnp.linspace(radii[0], radii[-1], len(radii))
    g, radii, step = g @ interpolation_matrix(radii, nodes).T, nodes, nodes[1] - nodes[0]
    curvature = (g[..., 2:] - 2 * g[..., 1:-1] + g[..., :-2]) / step**2
    weights = (detectors.weights / detectors.distance).reshape(-1, 1)
    filtered = jnp.pad(curvature.reshape(-1, len(radii) - 2), ((0, 0), (1, 1))) / radii * weights

    def of_detector(z: Array, values: Array) -> Array:
        position = (jnp.linalg.norm(points - z, axis=-1) - radii[0]) / step
        first = jnp.clip(position.astype(int), 0, len(radii) - 2)
        t = position - first
        between = (1 - t) * values[first] + t * values[first + 1]
        return jnp.where((position >= 0) & (position <= len(radii) - 1), between, 0.0)

    def add(total: Array, some: tuple[Array, Array]) -> tuple[Array, None]:
        return total + jnp.sum(jax.vmap(of_detector)(*some), axis=0), None

    blocks = (
        equal_parts(detectors.points.reshape(-1, 3), _DETECTORS),
        equal_parts(filtered, _DETECTORS),
    )
    total, _ = jax.lax.scan(add, jnp.zeros(len(points)), blocks)
    return -total / (8 * jnp.pi**2)
