"""Universal back-projection: the formula that most scanners use, for comparison.

Exact for detectors on a whole sphere. In the plane it is an approximation, and of a gap it knows
nothing.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry import DetectorCurve, ImageGrid


@eqx.filter_jit
def universal_back_projection(
    g: Float[Array, "detectors radii"],
    radii: Float[Array, " radii"],
    curve: DetectorCurve,
    grid: ImageGrid,
    center: Float[Array, "2"],
) -> Float[Array, "x1 x2"]:
    """f(x) = Σ_k dΩ_k b(z_k, |x - z_k|) / Σ_k dΩ_k up to a factor, b = p - r dp/dr, p = d(g/r)/dr.

    p is the pressure in the model of detectors focused into the plane, dΩ the angle under which x
    sees a detector.

    Args:
        g: circular integrals, (detectors, radii).
        radii: r [length].
        curve: detectors.
        grid: where the image is wanted.
        center: of the detectors' circle: where they look to, (2,) [length].

    Returns:
        (x1, x2).

    Source: Xu, Wang, Phys. Rev. E 71 (2005) 016706, equations 20 and 22.

    >>> from jaxtat import circular_arc, phantoms
    >>> curve, radii, grid = circular_arc(1.3, 1.3, 64), 0.01 * jnp.arange(1, 260), ImageGrid(33)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.5])
    >>> g = bell.circular_integrals(curve, radii)
    >>> image = universal_back_projection(g, radii, curve, grid, jnp.zeros(2))
    >>> bool(jnp.corrcoef(image.ravel(), bell.image(grid).ravel())[0, 1] > 0.8)
    True
    """
    n, (first, last) = radii.shape[0], (radii[0], radii[-1])
    r, step = jnp.linspace(first, last, n), (last - first) / (n - 1)
    equispaced = jax.vmap(lambda row: jnp.interp(r, radii, row))(g)
    pressure = _derivative(equispaced / r, step)
    terms = pressure - r * _derivative(pressure, step)
    points = grid.points.reshape(-1, 2)

    def add(sums: tuple[Array, Array], detector: tuple[Array, ...]) -> tuple[tuple, None]:
        position, weight, values = detector
        offset = points - position
        distance = jnp.linalg.norm(offset, axis=1)
        inward = (center - position) / jnp.linalg.norm(center - position)
        angle = weight * (offset @ inward) / distance**2
        place = jnp.clip((distance - first) / step, 0, n - 1)
        below = jnp.minimum(place.astype(int), n - 2)
        between = values[below] + (place - below) * (values[below + 1] - values[below])
        return (sums[0] + angle * between, sums[1] + angle), None

    start = jnp.zeros(len(points)), jnp.zeros(len(points))
    (total, angles), _ = jax.lax.scan(add, start, (curve.points, curve.weights, terms))
    return (total / angles).reshape(grid.shape)


def _derivative(values: Array, step: Array) -> Array:
    return jnp.asarray(jnp.gradient(values, axis=-1)) / step
