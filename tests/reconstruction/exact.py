"""What images of bells should be, and where they count."""

import jax.numpy as jnp
import numpy as np

from jaxtat import phantoms
from jaxtat.steps import filtered_back_projection, offset_step, radon_projections


def data_of(phantom, setup):
    return phantom.circular_integrals(setup.curve, setup.radii)


def inside(setup):
    return np.asarray(setup.region.contains(setup.grid.points))


def turned(phantom, angle, shift):
    c, s = np.cos(angle), np.sin(angle)
    centers = np.asarray(phantom.centers) @ np.array([[c, s], [-s, c]]) + shift
    return phantoms.Bells(centers, phantom.radii, phantom.amplitudes)


def filtered(setup, phantom, low_pass):
    """The image of the exact transform times eta, on the frequencies of the setup."""
    n, angles, center = setup.sizes.n_frequencies, setup.sizes.angles, setup.region.center
    step = jnp.array(setup.sizes.max_frequency / n)
    local = phantoms.Bells(phantom.centers - center, phantom.radii, phantom.amplitudes)
    fhat = local.fourier(step * jnp.arange(n + 1), angles)
    p = radon_projections(fhat, step, low_pass(jnp.arange(n + 1) / n))
    return filtered_back_projection(p, offset_step(step, n), angles, setup.grid, center)
