"""The speed of sound of a scan that does not tell it: that of the sharpest image.

`sound_speed_by_sharpness` finds the same place by derivatives. Here a search by values does. The
speed stretches the radii only, so that the systems of a frequency are solved for all speeds at
once, and sharpness needs no image: by Parseval's formula

    ∫ |grad f|² dx = (1/2π)² ∫ |xi|² |fhat(xi)|² dxi.
"""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..base.choice_table import GUESSED, LIKELY
from ..io import Scan
from ..reconstruction.plane_basis import plane_basis
from ..reconstruction.setup import plane_of
from ..reconstruction.verbs import DEFAULT_TOLERANCE
from ..regularization import tikhonov_rule
from ..special import j0, y0
from ..steps.quadrature import radial_quadrature
from ..steps.radon import low_pass_values
from .choices import Choices
from .choose_in_plane import TO_BE_ESTIMATED
from .facts import FASTEST, SLOWEST, typical_frame
from .frames import integrals, setup_of

SPEEDS = np.linspace(SLOWEST, FASTEST, 17)
STANDS_OUT = 1.05  # the sharpest image's sharpness over the median one's, at least


def estimate_sound_speed(scan: Scan, choices: Choices) -> Choices:
    """With the speed of sound for which the image of a typical frame is sharpest, if none is known.

    Images are of half the resolution: that is quicker, and sharpness falls off less steeply beside
    its peak, which is easier to find. Radii keep their ratio to the speed. A speed of which the
    sharpness hardly depends, as with smooth objects, is not believed.
    """
    if dict(choices.reasons).get("sound_speed") != TO_BE_ESTIMATED:
        return choices
    coarse = replace(
        choices, pixels=choices.pixels // 4 * 2 + 1, max_frequency=choices.max_frequency / 2
    )
    setup = setup_of(scan, coarse)
    if not setup.complete:
        why = "water's: the record ends too early to tell another"
        return choices.with_reason("sound_speed", why, GUESSED)
    g = integrals(scan, coarse, setup, typical_frame(scan))
    *_, radii, sizes = where = plane_of(setup)
    basis = plane_basis(*where, "auto", jax.device_put(DEFAULT_TOLERANCE), None)
    rule = tikhonov_rule(coarse.alpha, sizes.n_frequencies)
    eta = low_pass_values(coarse.low_pass, sizes.n_frequencies)[1:]

    def sharpness_at(speeds: np.ndarray) -> np.ndarray:
        stretches = jax.device_put(speeds)
        fhat, _ = basis.fhat(_stretched(g, radii, stretches, sizes.frequencies), rule)
        return np.asarray(_sharpness(fhat, eta, stretches, sizes.frequencies))

    stretch, why = sharpest(sharpness_at)
    stretched = replace(
        choices,
        sound_speed=choices.sound_speed * stretch,
        first_radius=choices.first_radius * stretch,
        radial_step=choices.radial_step * stretch,
    )
    return stretched.with_reason("sound_speed", why, LIKELY if stretch != 1.0 else GUESSED)


def sharpest(sharpness_at: Callable[[np.ndarray], np.ndarray]) -> tuple[float, str]:
    """The speed of greatest sharpness, over that of water and within 7 % of it, and why.

    As many speeds again between the neighbours of the sharpest, and a parabola through the three
    highest values.

    >>> speed, _ = sharpest(lambda speeds: 1 / (1 + ((speeds - 0.9877) / 0.013) ** 2))
    >>> abs(speed - 0.9877) < 1e-5
    True
    """
    values = sharpness_at(SPEEDS)
    best, median = int(np.argmax(values)), float(np.median(values))
    if best in (0, len(values) - 1) or values[best] < STANDS_OUT * median:
        return 1.0, "water's: no other within 7 % gives an image much sharper than all others"
    near = np.linspace(SPEEDS[best - 1], SPEEDS[best + 1], len(SPEEDS))
    values = sharpness_at(near)
    best = int(np.argmax(values[1:-1])) + 1
    before, highest, behind = values[best - 1 : best + 2]
    curvature = min(before - 2 * highest + behind, -np.finfo(float).tiny)
    speed = near[best] + (near[1] - near[0]) * (before - behind) / (2 * curvature)
    more = float(highest / median - 1)
    return float(speed), f"the image is sharpest, by {more:.0%}; none in the file"


@jax.jit
def _stretched(
    g: Float[Array, "detectors radii"],
    radii: Float[Array, " radii"],
    stretches: Float[Array, " speeds"],
    frequencies: Float[Array, " frequencies"],
) -> Float[Array, "speeds frequencies 2 detectors"]:
    """Step 2 for radii that are stretched by each of the speeds: as images of the same geometry."""
    nodes, weights = radial_quadrature(radii)
    read = g @ weights.T

    def transform(stretch: Array) -> Array:
        argument = stretch * frequencies[:, None] * nodes
        return stretch * jnp.einsum("jfr,kr->fjk", jnp.stack([j0(argument), y0(argument)]), read)

    return jax.lax.map(transform, stretches)


@jax.jit
def _sharpness(
    fhat: Complex[Array, "speeds frequencies directions"],
    eta: Float[Array, " frequencies"],
    stretches: Float[Array, " speeds"],
    frequencies: Float[Array, " frequencies"],
) -> Float[Array, " speeds"]:
    """c² ∫ |grad f|² dx, up to a factor: f has the unit of g per length, which grows with c."""
    of_rings = jnp.mean(jnp.abs(fhat) ** 2, axis=-1)
    return stretches**2 * (of_rings @ (eta**2 * frequencies**3))
