"""Step 2 of a record for many speeds of sound at once."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry import VisibilityWarning
from ..io import Scan
from ..reconstruction import OnLadder
from ..special import both_kinds
from ..steps.quadrature import radial_quadrature
from .acquisition import facts_of
from .choices import Choices
from .frames import problem_of

FADING = 0.05  # of the time in which the region sounds, before and after it


def problem_for_speeds(scan: Scan, choices: Choices) -> OnLadder:
    """The scan's, without a warning of unseen edges: the image comes with that."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VisibilityWarning)
        return problem_of(scan, choices)


def about_center(scan: Scan, choices: Choices) -> Float[np.ndarray, "detectors 2"]:
    """The detectors that are used, from the region's centre [length]."""
    return facts_of(scan).points[list(choices.channels)] - np.asarray(choices.region_center)


@jax.jit
def data_by_speed(
    g: Float[Array, "detectors radii"],
    radii: Float[Array, " radii"],
    stretches: Float[Array, " speeds"],
    frequencies: Float[Array, " frequencies"],
    sounding: Float[Array, "detectors 2"] | None = None,
) -> Float[Array, "speeds frequencies 2 detectors"]:
    """(G_J, G_Y) for radii that are stretched by each of the speeds: images of the same geometry.

    Args:
        g, radii, frequencies: as in `radial_transform`.
        stretches: speeds over the one of the radii.
        sounding: least and largest distance from each detector from which sound counts, whatever
            the speed; all by default [length].
    """
    nodes, weights = radial_quadrature(radii)
    read = g @ weights.T

    def transform(stretch: Array) -> Array:
        argument = stretch * frequencies[:, None] * nodes
        heard = read if sounding is None else read * faded(stretch * nodes, sounding)
        return stretch * jnp.einsum("jfr,kr->fjk", jnp.stack(both_kinds(0, argument)), heard)

    return jax.lax.map(transform, stretches)


@jax.jit
def faded(
    radii: Float[Array, " radii"], sounding: Float[Array, "detectors 2"]
) -> Float[Array, "detectors radii"]:
    """1 between both distances, falling to 0 beyond them."""
    first, last = sounding[:, :1], sounding[:, 1:]
    beyond = jnp.maximum(first - radii, radii - last) / (FADING * (last - first))
    return 0.5 + 0.5 * jnp.cos(jnp.pi * jnp.clip(beyond, 0.0, 1.0))
