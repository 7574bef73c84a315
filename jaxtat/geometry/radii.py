"""Radii of the circular integrals: which of them the region needs."""

import jax
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_objects, require_positive
from .bodies import Body, lag
from .curves import DetectorCurve
from .regions import Region


def data_radii(
    curve: DetectorCurve,
    region: Region,
    step: Numbers,
    *,
    sources: Region | None = None,
    medium: Body | None = None,
) -> Float[Array, " radii"]:
    """Equispaced radii r_min, r_min + step, ... up to the first one at or beyond r_max.

    r_min and r_max are the least and largest distances from a detector to a point of the region of
    interest, and of the region that holds the sources: the method needs all circles that meet a
    source, also for sources outside the region. Without them the image inside is wrong.

    Args:
        curve, region: the geometry (concrete, since it decides how many radii there are).
        step: distance between radii, usually the pixel size [length].
        sources: where f may differ from zero, if that is not inside the region of interest.
        medium: a body of another speed of sound; radii are then paths in water that take as long.

    Returns:
        (radii,) [length].

    Raises:
        ValueError: for a step that is not above zero, or a traced geometry.

    >>> from jaxtat import circular_arc, disk
    >>> radii = data_radii(circular_arc(1.3, 1.0, 500), disk(1.0, n_boundary=1000), 1 / 64)
    >>> radii.shape, round(float(radii[0]), 3), round(float(radii[-1]), 3)
    ((129,), 0.3, 2.3)
    """
    require_objects(curve=curve, region=region)
    step = real_array("step", step, ())
    require_positive("step", step)
    if not is_concrete(curve, region, step, sources, medium):
        raise ValueError(
            "curve, region, step or sources are traced, and decide how many radii there are: "
            "compute radii outside of jax.jit, and pass them in."
        )
    spans = [_distances(curve, where, medium) for where in (region, sources) if where is not None]
    least, most = min(span[0] for span in spans), max(span[1] for span in spans)
    # a span that is a whole number of steps but for rounding and sampling needs no further radius
    n = int(np.ceil((most - least) / float(step) - 1e-3)) + 1
    return jax.device_put(least + float(step) * np.arange(n))


def require_radii(radii: Float[Array, " radii"]) -> None:
    """Raise ValueError unless radii are positive, increasing and without holes."""
    if radii.shape[0] < 4:
        raise ValueError(f"got {radii.shape[0]} radii, expected at least 4.")
    if not is_concrete(radii):
        return
    values = np.asarray(radii)
    if not (values[0] > 0 and (np.diff(values) > 0).all()):
        raise ValueError(
            f"radii run from {values[0]:.6g} to {values[-1]:.6g}, expected positive values in "
            "increasing order: sort them and the data alike, without r = 0, where integrals vanish."
        )
    steps = np.diff(values)
    hole = int(np.argmax(steps))
    if steps[hole] > 4 * np.median(steps):
        raise ValueError(
            f"radii have a hole from {values[hole]:.6g} to {values[hole + 1]:.6g}, expected about "
            f"equal steps of {np.median(steps):.3g}: interpolate the data."
        )


def covers(radii: Float[np.ndarray, " radii"], least: float, most: float) -> bool:
    """Whether all circles from the least to the largest distance have data.

    One step may be missing at either end, where the integrals of a function that vanishes at the
    boundary are nearly zero.
    """
    steps = np.diff(radii)
    return bool(radii[0] <= least + steps[0] and radii[-1] >= most - steps[-1])


def uncovered(
    curve: DetectorCurve,
    region: Region,
    radii: Float[Array, " radii"],
    medium: Body | None = None,
) -> str:
    """Text about circles that meet the region but have no data; "" for none, or traced ones.

    See `covers`. Whether they also cover sources outside the region only the user can know, see
    `data_radii`.

    Raises:
        ValueError: if none of those that have data meets it.
    """
    if not is_concrete(curve, region, radii, medium):
        return ""
    values = np.asarray(radii)
    least, most = _distances(curve, region, medium)
    if covers(values, least, most):
        return ""
    missing = (
        f"radii run from {values[0]:.6g} to {values[-1]:.6g}, but circles about the detectors "
        f"meet the region of interest for radii from {least:.6g} to {most:.6g}"
    )
    if values[-1] <= least or values[0] >= most:
        raise ValueError(f"{missing}: check that radii and positions use the same unit of length.")
    return missing


def _distances(curve: DetectorCurve, region: Region, medium: Body | None) -> tuple[float, float]:
    """Least and largest distance from a detector to the boundary of the region.

    Through a body the straight way, as far as water would be crossed in the same time.
    """
    along1, along2 = (
        np.subtract.outer(one, other)
        for one, other in zip(np.asarray(curve.points).T, np.asarray(region.points).T, strict=True)
    )
    square = along1**2 + along2**2
    if medium is None:
        return float(np.sqrt(square.min())), float(np.sqrt(square.max()))
    distance = np.sqrt(square) + np.asarray(lag(medium, curve.points, region.points))
    return float(distance.min()), float(distance.max())
