"""The residual sinogram: the part of the data that the image does not explain.

If object and geometry are right, the residual is noise. Otherwise its shape indicates the cause:
whole rows are bad channels, curves outside the circles that meet the region are sources outside it,
double edges are a wrong speed of sound or wrong positions.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..base.checks import Numbers, data_array, real_array
from ..geometry import Body, DetectorCurve, Region
from ..geometry.bodies import lag
from ..reconstruction import Setup, forward_operator
from ..reconstruction.setup import plane_of

_SPREAD = 5.0  # standard deviations from the typical detector that make one unusual
_LEAST = 0.05  # of relative norm or gain, by which it must differ besides
_ACROSS = 3  # detectors, over which unusual ones between do not part others


class DataResidual(eqx.Module):
    """Data minus the circular integrals of the image, and their norms.

    Attributes:
        values: g - A f, (detectors, radii) [unit of g].
        modelled: A f, likewise.
        meets: circles that meet the region of interest; those of the image meet no others.
        relative: ||g - A f|| / ||g|| over the circles that meet the region.
        per_detector: the same of each detector, over the root mean square ||g_k||, so that
            ``relative`` is their root mean square, (detectors,).
        gains: by which A f would have to be multiplied to fit each detector's data best, 1 for a
            perfect channel, 0 for a dead one, (detectors,).
        outside: share of ||g||² on circles that miss the region: sources outside it, or noise.
    """

    values: Float[Array, "detectors radii"]
    modelled: Float[Array, "detectors radii"]
    meets: Bool[Array, "detectors radii"]
    relative: Float[Array, ""]
    per_detector: Float[Array, " detectors"]
    gains: Float[Array, " detectors"]
    outside: Float[Array, ""]

    @property
    def typical(self) -> Float[Array, ""]:
        """Root mean square on circles that meet the region, median over detectors [unit of g].

        Bad channels do not enter.
        """
        square = jnp.sum(self.meets * self.values**2, axis=1)
        return jnp.median(jnp.sqrt(square / jnp.sum(self.meets, axis=1)))

    @property
    def unusual(self) -> Int[np.ndarray, " some"]:
        """Detectors whose residual or gain stands out from that of the others.

        By five standard deviations, of the median absolute deviation, and a twentieth at least;
        not those to which others lead in smaller steps, as towards the ends of an open curve, which
        see less of the region.
        """
        residual, gains = _distance(self.per_detector), _distance(self.gains)
        return np.flatnonzero((_apart(residual) & (residual > 0)) | _apart(gains))


def data_residual(setup: Setup, g: Numbers, image: Numbers) -> DataResidual:
    """g - A f for the image f inside the region of interest, A its circular integrals.

    Outside the region, or beyond the rim of a fast body (`Setup.may_sound`), the image has no
    meaning and is set to zero. Differentiable in image, g and geometry, but for that boundary. A is
    `forward_operator`: exact for images that are band-limited between their pixels; at a sharp
    edge, also the region's, it rings.

    Args:
        setup: detectors, region, grid and radii, in the plane.
        g: the data, (detectors, radii).
        image: f, (x1, x2); what is outside the region may be NaN.

    Returns:
        DataResidual.

    Raises:
        ValueError: for shapes that do not fit or NaN, also in an image inside the region.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 12), disk(1.0), ImageGrid(33), max_frequency=10.0)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.6])
    >>> g = bell.circular_integrals(setup.curve, setup.radii).at[3].set(0.0)  # one dead channel
    >>> result = data_residual(setup, g, bell.image(setup.grid))
    >>> result.unusual.tolist(), bool(jnp.abs(result.gains[4] - 1) < 1e-3)
    ([3], True)
    """
    curve, region, radii, _ = plane_of(setup)
    grid = setup.grid
    g = real_array("g", data_array(g, *setup.data_shape), setup.data_shape)
    if np.shape(image) != grid.shape:
        raise ValueError(f"image has shape {np.shape(image)}, expected {grid.shape}.")
    operator = forward_operator(setup)
    sounds = setup.may_sound(grid, operator.max_frequency)
    image = real_array("image", jnp.where(sounds, jnp.asarray(image), 0.0), grid.shape)
    return _compared(g, operator(image), _meeting(curve, region, radii, setup.medium))


@jax.jit
def _compared(g: Array, modelled: Array, meets: Array) -> DataResidual:
    values = g - modelled
    power, left, model = (
        jnp.sum(meets * product, axis=1) for product in (g**2, values**2, modelled**2)
    )
    agreement = jnp.sum(meets * g * modelled, axis=1)
    size = jnp.sum(power)
    typical = jnp.where(size > 0, size / g.shape[0], 1.0)
    whole = jnp.sum(g**2)
    return DataResidual(
        values=values,
        modelled=modelled,
        meets=meets,
        relative=jnp.sqrt(jnp.mean(left) / typical),
        per_detector=jnp.sqrt(left / typical),
        gains=agreement / jnp.where(model > 0, model, 1.0),
        outside=1 - size / jnp.where(whole > 0, whole, 1.0),
    )


@jax.jit
def _meeting(
    curve: DetectorCurve, region: Region, radii: Array, medium: Body | None
) -> Bool[Array, "detectors radii"]:
    """Whether a circle meets the region, which is connected: between its nearest and farthest.

    Through a body by the straight way; its echoes come later.
    """
    offset = curve.points[:, None] - region.points
    distance = jnp.linalg.norm(offset, axis=-1)
    if medium is not None:
        distance = distance + lag(medium, curve.points, region.points)
    nearest, farthest = distance.min(axis=1), distance.max(axis=1)
    return (radii >= nearest[:, None]) & (radii <= farthest[:, None])


def _distance(values: Float[Array, " detectors"]) -> Float[np.ndarray, " detectors"]:
    """Distances from the median, in units of the threshold of unusual detectors."""
    off = np.asarray(values) - np.median(values)
    deviation = 1.4826 * np.median(np.abs(off))  # that of normally distributed values
    return off / max(_SPREAD * float(deviation), _LEAST)


def _apart(distances: Float[np.ndarray, " detectors"]) -> Bool[np.ndarray, " detectors"]:
    """Beyond the threshold, and so from their neighbours, or from all that lead to the others."""
    n, usual = len(distances), np.abs(distances) <= 1
    for along in (range(n), range(n - 1, -1, -1)):
        last = None
        for k in along:
            if not usual[k] and last is not None and abs(k - last) <= _ACROSS:
                usual[k] = abs(distances[k] - distances[last]) <= abs(k - last)
            last = k if usual[k] else last
    return ~usual
