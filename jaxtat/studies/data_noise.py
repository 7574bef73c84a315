"""The noise of the data, separated from errors of the model.

Along a curve of detectors a wave of wave number lambda turns by at most lambda radians per length,
wherever it comes from. So the part of the data outside the cone |kappa| <= lambda (kappa along the
curve, lambda along the radius) is noise that differs from detector to detector. Sources outside the
region, a wrong speed of sound and details finer than the pixels all stay inside the cone.
"""

from enum import Enum

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import is_concrete
from ..reconstruction import Setup
from ..reconstruction.setup import plane_of
from .residual import DataResidual

_BINS = 2  # of the window's spectrum, by which the cone is widened
_LEAST = 24  # coefficients outside the cone that are needed to estimate noise
_WIDE = 0.9  # of the steps between detectors are no wider than the one that is reckoned with


class NoiseSource(Enum):
    """How the noise of the data is known; the words follow 'known by'."""

    GIVEN = "what was given"
    RECORD = "the record before sound from the region arrives"
    INCOHERENT = "what differs from detector to detector faster than any wave"
    UNKNOWN = "all that the image leaves of a typical detector's data: it is at most that"


class DataNoise(eqx.Module):
    """Noise in the circular integrals.

    Attributes:
        sigma: its root mean square on circles that meet the region [unit of g].
        source: how it is known.
    """

    sigma: Float[Array, ""]
    source: NoiseSource = eqx.field(static=True)


def noise_of_residual(setup: Setup, residual: DataResidual) -> DataNoise:
    """White noise by the part of g - A f outside the cone |kappa| <= lambda, else by all of it.

    Detectors that stand out are replaced by their neighbours. The median of the periodogram counts,
    ln 2 times the mean for normal noise, so that single strong coefficients do not.

    Args:
        setup: in the plane, concrete, with equispaced radii.
        residual: of `data_residual`.

    Returns:
        DataNoise.

    Raises:
        ValueError: in space, and inside of `jax.jit`, unless the residual is known there.

    >>> from jaxtat import ImageGrid, Setup, circular_arc, disk, phantoms
    >>> from jaxtat.studies import data_residual
    >>> setup = Setup(circular_arc(1.3, 1.3, 90), disk(1.0), ImageGrid(33))
    >>> curve, radii = setup.curve, setup.radii
    >>> noise = 0.1 * np.random.default_rng(0).standard_normal((90, len(radii)))
    >>> far = phantoms.Bells([[0.5, 0.4]], [0.4]).circular_integrals(curve, radii)  # unexplained
    >>> residual = data_residual(setup, far + noise, np.zeros((33, 33)))
    >>> result = noise_of_residual(setup, residual)
    >>> result.source.name, abs(float(result.sigma) - 0.1) < 0.01, bool(residual.typical > 0.12)
    ('INCOHERENT', True, True)
    """
    curve, _, radii, _ = plane_of(setup)
    if not is_concrete(residual, curve, radii):
        raise ValueError(
            "noise_of_residual is for known data, not inside jax.jit: how many detectors it leaves "
            "out depends on them."
        )
    values = _without(np.asarray(residual.values), residual.unusual)
    n, m = values.shape
    window = np.hanning(n + 2)[1:-1, None] * np.hanning(m + 2)[1:-1]
    power = np.abs(np.fft.rfft2(values * window)) ** 2 / np.sum(window**2)
    step = float(radii[-1] - radii[0]) / (m - 1)
    along = 2 * np.pi * np.fft.rfftfreq(m, step) + _BINS * 2 * np.pi / (m * step)
    across = 2 * np.pi * (np.abs(np.fft.fftfreq(n)) - _BINS / n)
    steps = np.linalg.norm(np.diff(np.asarray(curve.points), axis=0), axis=1)
    outside = across[:, None] > float(np.quantile(steps, _WIDE)) * along
    if outside.sum() < _LEAST:
        return DataNoise(residual.typical, NoiseSource.UNKNOWN)
    sigma = np.sqrt(np.median(power[outside]) / np.log(2))
    return DataNoise(jnp.asarray(sigma), NoiseSource.INCOHERENT)


def _without(values: Float[np.ndarray, "n m"], rows: np.ndarray) -> Float[np.ndarray, "n m"]:
    """Values with some rows interpolated from those beside them."""
    good = np.setdiff1d(np.arange(len(values)), rows)
    if len(good) < 2:
        return values
    filled = values.copy()
    for row in rows:
        after = int(np.clip(np.searchsorted(good, row), 1, len(good) - 1))
        before, behind = good[after - 1], good[after]
        share = np.clip((row - before) / (behind - before), 0.0, 1.0)
        filled[row] = (1 - share) * values[before] + share * values[behind]
    return filled
