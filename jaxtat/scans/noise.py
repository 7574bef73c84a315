"""alpha: by the quiet part of a record; of waves in the plane by what no image explains.

The quiet part of a record shows the noise of its elements. But walls and a wrong speed of sound
disturb images, too, and no image explains them either.
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..base.choice_table import GUESSED, LIKELY
from ..densities.cylindrical_waves import cross_validation, waves_of
from ..io import Scan
from ..reconstruction import OnLadder
from ..records.signal_power import noise_before, record_power
from ..steps.radial_transforms import radial_transform
from .acquisition import typical_frame
from .choices import Choices
from .estimate import Estimate, Source
from .frames import integrals, problem_of
from .parameters import Parameters
from .preprocess import Acquisition, AcquisitionInSpace
from .resolution import first_arrival

ALPHAS = (1e-6, 1e-1)
CLEAN = 1e-5  # alpha below which no low-pass filter is needed
INTEGRALS_ALPHA = 1e-6
UNKNOWN_NOISE = 1e-3  # alpha of a record in space that starts with sound
PER_DECADE = 10  # values of alpha to choose from
FREQUENCIES = 32  # at most, among all of the image's, that decide


def noise_in_plane(record: Acquisition, p: Parameters) -> Parameters:
    """alpha and low pass: power of the noise over that of the sound, as in Wiener's filter."""
    power = record.power.after(record.begin)
    ratio = noise_before(power._replace(power=power.power[record.good]), first_arrival(record, p))
    if ratio is None:
        return with_alpha(p, record.floor, "by differences of samples", GUESSED)
    return with_alpha(p, ratio, "before sound from the region arrives")


def noise_in_space(record: AcquisitionInSpace, p: Parameters) -> Parameters:
    """The same of a record around a volume."""
    if record.listened is None or record.facts.times is None:
        return exact_integrals(record, p)
    power = record_power(record.listened, record.facts.times, detrend=False)
    ratio = noise_before(power.after(2 * p["dead_time"] or -np.inf), record.arrival(p.values))
    if ratio is None:
        how = "assumed: no silence in the record, by which it could be told"
        return with_alpha(p, UNKNOWN_NOISE, how, GUESSED)
    p = with_alpha(p, ratio, "before sound from the region arrives")
    why = "all waves up to the highest stand out of the noise"
    return p.with_(low_pass=Estimate("none", why, LIKELY, Source.ESTIMATE))


def exact_integrals(_: Any, p: Parameters) -> Parameters:
    """alpha and low pass of integrals over circles or spheres."""
    what = "circular integrals" if len(p["region_center"]) == 2 else "integrals over spheres"
    why = f"{what} are taken to be exact"
    return p.with_(
        alpha=Estimate(INTEGRALS_ALPHA, why, GUESSED), low_pass=Estimate("none", why, GUESSED)
    )


def with_alpha(p: Parameters, ratio: float, how: str, grade: str = LIKELY) -> Parameters:
    """alpha and low pass by the power of the noise over that of the sound, and how it is known.

    Args:
        ratio: as in Wiener's filter; alpha is kept within `ALPHAS`.
        how: words that follow the number.
        grade: of that number.
    """
    least, most = ALPHAS
    kept = "raised to the least: " if ratio < least else "capped: " if ratio > most else ""
    why, data = f"{kept}noise over signal power {{ratio:.2g}}, {how}", {"ratio": ratio}
    alpha = float(np.clip(ratio, least, most))
    p = p.with_(alpha=Estimate(alpha, why, grade, Source.ESTIMATE, data=data))
    noisy = p["alpha"] > CLEAN
    low_pass, why = ("cosine", "noise") if noisy else ("none", "hardly any noise")
    return p.with_(low_pass=Estimate(low_pass, why, grade, Source.ESTIMATE))


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
        The same choices for other models, for images under constraints, through a body of another
        speed, for detectors that cylindrical waves do not reach, and if alpha is given.
    """
    if choices.model != "2d" or choices.model_based or "alpha" in choices.user_set:
        return choices
    if choices.medium is not None:  # its waves are not those of the criterion
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
