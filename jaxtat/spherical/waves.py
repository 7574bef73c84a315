"""Spherical waves j_l(lambda |x|) Y_lm(x): their sizes at the detectors and on the region.

With c_lm(lambda) = ∫ f(x) j_l(lambda |x|) conj Y_lm(x) dx the addition theorem writes the data as

    G_J(z) = ∫ f(x) j_0(lambda |x - z|) dx = 4π Σ_lm j_l(lambda |z|) Y_lm(z) c_lm,

G_Y with y_l(lambda |z|), for |x| < |z| (DLMF 10.60.1-3). As in the plane, waves are divided by the
scales Delta_l of `decay_steps`, and the products with Delta_l y_l stay finite. Of sources in a body
of another speed of sound j_l and y_l at the detectors become real and imaginary part of t_l h_l, of
`special.transmission`, at lambda c_1/c_2.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry import BallBody
from ..geometry.balls import Boundary
from ..special import decay_steps, scaled_spherical_sequence, transmitted_factors


class CapWaves(eqx.Module):
    """Tables from which waves are computed; frequencies first, l = 0 .. l_max last.

    Attributes:
        frequencies: lambda [rad/length].
        steps: of the scales, up to l_max + 1.
        at_detectors: 4π Delta_l (j_l | y_l)(lambda |z|), one distance or all of them; of a body
            (Re | Im) t_l h_l.
        norms: s_l = R √(j_l² + j_l'²)(lambda R) / Delta_l, the L2 norms of the waves' traces
            (u, (1/lambda) du/dn) on the sphere |x| = R, where they are orthogonal [length].
    """

    frequencies: Float[Array, " f"]
    steps: Float[Array, "f more"]
    at_detectors: Float[Array, "f 2 *detectors orders"]
    norms: Float[Array, "f orders"]

    @property
    def scale(self) -> Float[Array, "f orders"]:
        """Delta_l."""
        return jnp.cumprod(self.steps, axis=-1)[..., :-1]


def cap_waves(
    frequencies: Float[Array, " f"],
    region_radius: Float[Array, ""],
    detector_radius: Float[Array, "*detectors"],
    l_max: int,
    factor: Float[Array, "orders *detectors"] | None = None,
    medium: BallBody | None = None,
) -> CapWaves:
    """The waves of all frequencies at detectors in one or several distances from the centre.

    Args:
        frequencies, region_radius, detector_radius, l_max: as above.
        factor: mean over an element of finite size by degree.
        medium: a body about the centre.
    """
    steps = decay_steps(l_max + 1, frequencies * region_radius)
    more = steps.reshape(*steps.shape, *[1] * detector_radius.ndim)
    outside = frequencies if medium is None else frequencies * medium.speed_ratio
    argument = outside.reshape(-1, *[1] * detector_radius.ndim) * detector_radius
    j, y = scaled_spherical_sequence(argument, more[:-1])
    j = j * jnp.cumprod(more[:-1], axis=0) ** 2
    if medium is not None:
        through = frequencies * medium.radius, outside * medium.radius, medium.density_ratio
        factors = transmitted_factors(l_max, *through, spherical=True)
        each = l_max + 1, *frequencies.shape, *[1] * detector_radius.ndim
        real, imaginary = (factor.reshape(each) for factor in factors)
        j, y = real * j - imaginary * y, real * y + imaginary * j
    waves = 4 * jnp.pi * jnp.stack([j, y])  # (J|Y, orders, frequencies, detectors)
    if factor is not None:
        waves = waves * factor[:, None]
    value, below, above = radial_values(frequencies * region_radius, steps)
    norms = region_radius * jnp.sqrt(value**2 + _slope(below, above) ** 2)
    return CapWaves(
        frequencies=frequencies,
        steps=steps.T,
        at_detectors=jnp.moveaxis(jnp.moveaxis(waves, 1, -1), 1, 0),
        norms=norms.T,
    )


def radial_values(
    x: Float[Array, "*shape"], steps: Float[Array, "more *broadcast"]
) -> Float[Array, "3 orders *shape"]:
    """j_l, j_{l-1} and j_{l+1} of x, each over Delta_l, l = 0 .. l_max, of steps up to l_max + 1.

    j_{-1} is given as 0: whatever it enters is multiplied by 0.
    """
    j, _ = scaled_spherical_sequence(x, steps)
    below = jnp.concatenate([jnp.zeros_like(j[:1]), j[:-2] / steps[1:-1]])
    return jnp.stack([j[:-1], below, j[1:] * steps[1:]])


def boundary_traces(
    order: Array,
    legendre: Float[Array, "one_more points"],
    radial: Float[Array, "3 degrees points"],
    boundary: Boundary,
) -> Float[Array, "traces degrees"]:
    """(u, (1/lambda) du/dn) of the waves l = m, m + 1, ... of one order m, rows scaled by √w.

    On the sphere the normal derivative is j_l' P_lm; on the flat part it is (1/lambda) d/dx_3,

        A_lm j_{l-1} P_{l-1,m} - A_{l+1,m} j_{l+1} P_{l+1,m},  A_lm² = (l² - m²)/(4l² - 1),

    which needs no division near the centre.

    Args:
        order: m.
        legendre: P_lm at the points, of one degree more than is wanted.
        radial: of `radial_values`, l = m, m + 1, ...
        boundary: the points.
    """
    value, below, above = radial
    degree = (order + jnp.arange(value.shape[0] + 1.0))[:, None]
    factor = jnp.sqrt((degree**2 - order**2) / (4 * degree**2 - 1))
    lower = jnp.concatenate([jnp.zeros_like(legendre[:1]), legendre[:-2]])
    upwards = factor[:-1] * below * lower - factor[1:] * above * legendre[1:]
    outwards = ((degree[:-1] * below - (degree[:-1] + 1) * above) / (2 * degree[:-1] + 1)) * (
        legendre[:-1]
    )
    normal = jnp.where(boundary.flat > 0, upwards, outwards)
    return (jnp.concatenate([value * legendre[:-1], normal], axis=1)).T * jnp.sqrt(
        jnp.tile(boundary.weights, 2)
    )[:, None]


def boundary_radial(
    boundary: Boundary, frequencies: Float[Array, " f"], steps: Float[Array, "f more"]
) -> Float[Array, "f 3 orders points"]:
    """`radial_values` of all frequencies at the boundary points."""
    argument = frequencies[:, None] * boundary.distance
    return jnp.moveaxis(radial_values(argument, steps.T[:, :, None]), 2, 0)


def _slope(below: Array, above: Array) -> Array:
    """j_l' = (l j_{l-1} - (l + 1) j_{l+1}) / (2l + 1), DLMF 10.51.2; orders first."""
    order = jnp.arange(below.shape[0]).reshape(-1, *[1] * (below.ndim - 1))
    return (order * below - (order + 1) * above) / (2 * order + 1)


def order_slice(values: Float[Array, "*f orders"], order: Array, size: int) -> Array:
    """Degrees l = m .. m + size - 1 of arrays whose last axis is long enough."""
    return jax.lax.dynamic_slice_in_dim(values, order, size, axis=-1)
