"""alpha of waves in the plane, by what of a typical frame no image explains.

The quiet part of a record shows the noise of its elements. But walls and a wrong speed of sound
disturb images, too, and no image explains them either.
"""

from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..base.choice_table import LIKELY
from ..densities.cylindrical_waves import cross_validation, waves_of
from ..io import Scan
from ..reconstruction import OnLadder
from ..steps.radial_transforms import radial_transform
from .acquisition import typical_frame
from .choices import Choices
from .found import ALPHAS
from .frames import integrals, problem_of

PER_DECADE = 10  # values of alpha to choose from
FREQUENCIES = 32  # at most, among all of the image's, that decide


def estimate_alpha(scan: Scan, choices: Choices) -> Choices:
    """Choices with alpha by cross-validation, and without a filter, of two-dimensional waves.

    alpha is one number for all frequencies: one for each, by this rule or by `NoiseLevel`, gave
    images that were no better, and worse where detectors are on one side only. Noise then needs no
    further filter.

    Elements focused into the plane also record what comes from out of it, and usually in a band
    that is not known, which makes high frequencies too strong. The filter makes up for that, and
    alpha hardly matters beside it: both are left as they are.

    Args:
        scan: any.
        choices: with the speed of sound estimated.

    Returns:
        The same choices for other models, for images under constraints, for detectors that
        cylindrical waves do not reach, and if alpha is given.
    """
    if not wants_alpha(choices):
        return choices
    problem = problem_of(scan, choices)
    if not (problem.setup.complete and problem.geometry is not None):
        return choices
    g = problem.data(integrals(scan, choices, problem.setup, typical_frame(scan)))
    least, most = ALPHAS
    alphas = np.geomspace(least, most, round(PER_DECADE * np.log10(most / least)) + 1)
    alpha = float(alphas[np.argmin(_prediction_error(problem, g, jax.device_put(alphas)))])
    why = "by cross-validation: what no image explains is noise"
    found = replace(choices, alpha=alpha).with_reason("alpha", why, LIKELY)
    if "low_pass" in choices.user_set:
        return found
    why = "alpha keeps the noise of two-dimensional waves out"
    return replace(found, low_pass="none").with_reason("low_pass", why, LIKELY)


def wants_alpha(choices: Choices) -> bool:
    """Whether alpha can be estimated and is not given."""
    of_formula = choices.model == "2d" and not choices.model_based
    return of_formula and "alpha" not in choices.user_set


def _prediction_error(problem: OnLadder, g: Array, alphas: Array) -> Float[np.ndarray, " alphas"]:
    """The geometric mean over frequencies, each of which has its own noise."""
    assert problem.geometry is not None
    some, n = problem.some_frequencies(FREQUENCIES)
    frequencies = jax.device_put(some)
    transformed = radial_transform(g, problem.radii, frequencies)
    waves = waves_of(problem.geometry, frequencies, problem.sizes.groups[-1][-1])
    found = _errors(problem.geometry, waves, transformed, alphas)
    return np.exp(np.log(np.asarray(found)[:n]).mean(axis=0))


_errors = eqx.filter_jit(cross_validation)
