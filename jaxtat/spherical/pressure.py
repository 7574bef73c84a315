"""Pressure records of waves in space -> spherical integrals."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.checks import Numbers
from ..records import pressure_to_circular_integrals


def pressure_to_spherical_integrals(
    pressure: Numbers, times: Numbers, radii: Numbers, *, sound_speed: Numbers = 1.0
) -> Float[Array, "*batch detectors radii"]:
    """g(z, r) = 4π r ∫_0^r p(z, tau/c) dtau from the records p(z, t) of point-like detectors.

    With (M f)(z, r) = g / (4π r²), the mean over the sphere, p = d/dtau (tau M f), tau = c t; so
    the integral up to r is r M f. Up to 4π that is the model of detectors focused into a plane,
    exact for band-limited records, see `jaxtat.records.pressure`.

    Args:
        pressure: (..., detectors, times) or (..., rings, azimuths, times), any unit.
        times, radii, sound_speed: as in `jaxtat.records.pressure_to_circular_integrals`.

    Returns:
        As pressure, with radii for times [unit of pressure times length²].

    Raises:
        ValueError: as `jaxtat.records.pressure_to_circular_integrals`.

    Source: Kirchhoff's formula; e.g. Evans, Partial Differential Equations (2010), section 2.4.1.

    >>> times = jnp.linspace(0.0, 3.0, 301)
    >>> p = jnp.ones((1, 301))  # f = 1 everywhere stays 1, and g is the sphere
    >>> g = pressure_to_spherical_integrals(p, times, jnp.array([2.0]))
    >>> print(round(float(g[0, 0] / jnp.pi), 6))
    16.0
    """
    g = pressure_to_circular_integrals(
        pressure, times, radii, sound_speed=sound_speed, model="in-plane"
    )
    return 4 * jnp.pi * g
