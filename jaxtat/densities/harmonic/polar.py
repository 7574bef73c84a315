"""Curve and region in polar coordinates: about which point and axis cylindrical waves are taken.

The waves J_n(lambda |x - c|) e^{in theta} write the potentials of all detectors that are farther
from c than every point of the region. The axis is the line in which the geometry is mirrored, if it
is: then cosines and sines do not mix.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...base.checks import is_concrete
from ...geometry import CircularArc, DetectorCurve, Disk, Region, fit_circle, near_circle
from ..symmetry import mirrored_pairs
from .orders import highest_orders

_ROUNDING = 1e-9  # relative, for positions that are called equal
FARTHER = 1.2  # nearest detector over farthest point of the region, from which waves are worth it
_REACHED = 0.99  # the same, inverted, up to which they can be used at all
_CANDIDATES = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 17)] * 2), axis=-1).reshape(-1, 2)


class PolarGeometry(eqx.Module):
    """Detectors and region about c, angles counted from the axis.

    Attributes:
        center, axis: c [length], and the direction of the axis [rad].
        detector_radius: |z_k - c|, one number if the detectors lie on a circle about c [length].
        detector_angles, weights: theta_k [rad] and w_k [length].
        region: the region of interest; in a mirrored geometry that is no disk, one side of its
            boundary with twice the weights.
        mirror: whether the axis is one of mirror symmetry.
        disk: whether the region is a disk about c.
        rim: how many boundary points, the first ones, lie on the arc of a cut disk about c; 0 for
            other regions.
    """

    center: Float[Array, "2"]
    axis: Float[Array, ""]
    detector_radius: Float[Array, "*one_or_detectors"]
    detector_angles: Float[Array, " detectors"]
    weights: Float[Array, " detectors"]
    region: Region
    mirror: bool = eqx.field(static=True)
    disk: bool = eqx.field(static=True)
    rim: int = eqx.field(static=True)

    @property
    def on_circle(self) -> bool:
        return self.detector_radius.ndim == 0

    @property
    def reach(self) -> Float[Array, ""]:
        """Largest |x - c| in the region [length]."""
        if self.disk:
            return self.region.reach
        return jnp.linalg.norm(self.region.points - self.center, axis=1).max()

    def one_side(self) -> "PolarGeometry":
        """The first half of the detectors of a mirrored geometry, which stand for both halves."""
        weights = half_weights(self.weights)
        radius = self.detector_radius
        return eqx.tree_at(
            lambda tree: (tree.detector_radius, tree.detector_angles, tree.weights),
            self,
            (
                radius if self.on_circle else radius[: weights.shape[0]],
                self.detector_angles[: weights.shape[0]],
                weights,
            ),
        )


def harmonic_orders(geometry: PolarGeometry, frequencies: np.ndarray) -> np.ndarray:
    """N(lambda) of a concrete geometry; ValueError if waves about the centre do not reach."""
    reach, distance = float(geometry.reach), float(geometry.detector_radius.min())
    if reach >= _REACHED * distance:
        raise ValueError(
            f"the region reaches {reach:.6g} from {np.asarray(geometry.center)}, a detector is "
            f"only {distance:.6g} away: cylindrical waves need every detector farther off than "
            "the region. Use a smaller region, or method='auto' or 'collocation' of build_plan."
        )
    return highest_orders(frequencies, reach, distance)


def waves_reach(curve: DetectorCurve, region: Region) -> bool:
    """Whether cylindrical waves write the potentials of a concrete geometry with few orders.

    For detectors off a circle they are asked to reach with a ratio of 1.2; below it orders, and
    products over detectors, grow until direct kernels are cheaper.
    """
    geometry = polar_geometry(curve, region)
    least = 1 / _REACHED if near_circle(curve) else FARTHER * (1 - _ROUNDING)
    return float(np.asarray(geometry.detector_radius).min()) > least * float(geometry.reach)


def half_weights(weights: Float[Array, " detectors"]) -> Float[Array, " half"]:
    """Of the first half: twice w for a detector that stands for two, w for one on the axis.

    Detectors are in order along the curve, so that the mirror image of number k is the k-th last.
    """
    n = weights.shape[0]
    kept = np.arange(-(-n // 2))
    return weights[: len(kept)] * np.where(2 * kept == n - 1, 1.0, 2.0)


def polar_geometry(curve: DetectorCurve, region: Region) -> PolarGeometry:
    """The best centre and axis that curve and region allow.

    Detectors on a circle are expanded about its centre, which makes the waves at all of them alike.
    Others are about the centre of the region, or, if a detector is hardly farther from it than the
    region reaches, about the point for which that ratio is best. Traced positions are taken one by
    one, and without symmetry, since a derivative may move any of them; a `CircularArc` remains an
    arc when its radius or opening is traced.
    """
    if isinstance(curve, CircularArc) and is_concrete(curve.center, region.center):
        return _about_arc(curve, region)
    if is_concrete(curve, region):
        return _about_points(curve, region)
    center = _best_center(curve, region, jnp)
    local = curve.points - center
    return PolarGeometry(
        center=center,
        axis=jnp.zeros(()),
        detector_radius=jnp.linalg.norm(local, axis=1),
        detector_angles=jnp.arctan2(local[:, 1], local[:, 0]),
        weights=curve.weights,
        region=region,
        mirror=False,
        disk=_is_whole_disk(region),
        rim=0,
    )


def _about_arc(arc: CircularArc, region: Region) -> PolarGeometry:
    """The arc's own symmetry holds for all its parameters; whether the region shares it is seen."""
    offset = np.abs(np.asarray(region.center) - np.asarray(arc.center)).max()
    near = _ROUNDING * float(arc.radius) if is_concrete(arc.radius) else 0.0
    concentric = isinstance(region, Disk) and bool(offset <= near)
    disk = concentric and _is_whole_disk(region)
    half = None
    if not disk and is_concrete(arc, region):
        half = _one_side(region, arc.center, float(arc.angle))
    return PolarGeometry(
        center=arc.center,
        axis=arc.angle + jnp.pi,
        detector_radius=arc.radius,
        detector_angles=arc.angles,
        weights=arc.weights,
        region=region if half is None else half,
        mirror=disk or half is not None,
        disk=disk,
        rim=_rim(region, half) if concentric else 0,
    )


def _about_points(curve: DetectorCurve, region: Region) -> PolarGeometry:
    """Measured positions: on a circle and mirrored if they are to rounding."""
    center, radius = _circle(curve, region)
    local = np.asarray(curve.points) - np.asarray(center)
    angles = np.unwrap(np.arctan2(local[:, 1], local[:, 0]))
    axis = (angles[0] + angles[-1]) / 2
    angles = angles - axis
    weights, distance = np.asarray(curve.weights), np.linalg.norm(local, axis=1)
    offset = float(np.abs(np.asarray(region.center) - np.asarray(center)).max())
    concentric = isinstance(region, Disk) and offset <= _ROUNDING * float(region.reach)
    disk = concentric and _is_whole_disk(region)
    mirrored = (
        np.abs(angles + angles[::-1]).max() < _ROUNDING
        and np.abs(weights - weights[::-1]).max() < _ROUNDING * weights.max()
        and np.abs(distance - distance[::-1]).max() < _ROUNDING * distance.max()
    )
    half = _one_side(region, center, float(axis)) if mirrored and not disk else None
    return PolarGeometry(
        center=center,
        axis=jax.device_put(axis),
        detector_radius=jax.device_put(distance) if radius is None else radius,
        detector_angles=jax.device_put(angles),
        weights=curve.weights,
        region=region if half is None else half,
        mirror=bool(mirrored and disk) or half is not None,
        disk=disk,
        rim=_rim(region, half) if concentric else 0,
    )


def _circle(curve: DetectorCurve, region: Region) -> tuple[Array, Array | None]:
    """Centre of the waves, and the detectors' common radius about it if they have one."""
    try:
        circle = fit_circle(curve.points)
    except ValueError:  # a straight line
        return jax.device_put(_best_center(curve, region, np)), None
    points, center, radius = map(np.asarray, (curve.points, circle.center, circle.radius))
    distance = np.linalg.norm(points - center, axis=1)
    if np.abs(distance - radius).max() > _ROUNDING * radius:
        return jax.device_put(_best_center(curve, region, np)), None
    return circle.center, circle.radius


def _best_center(curve: DetectorCurve, region: Region, xp: Any) -> Any:
    """c with the largest min |z_k - c| / max |x - c|, or the region's centre if that does.

    No image depends on c but by rounding and by the unit of alpha. Of a disk the best
    centre is its own: whoever moves by d has detectors at most d farther off, and the rim just d.

    Args:
        xp: numpy, or jax.numpy for what is traced.
    """
    if _is_whole_disk(region):
        return region.center
    points = curve.points, region.points, region.center
    detectors, boundary, own = (xp.asarray(part) for part in points)

    def ratio(c: Any) -> Any:
        nearest = xp.linalg.norm(detectors - c[:, None], axis=-1).min(axis=-1)
        return nearest / xp.linalg.norm(boundary - c[:, None], axis=-1).max(axis=-1)

    best, step = own, xp.linalg.norm(boundary - own, axis=-1).max()
    for _ in range(4):
        candidates = best + step * xp.concatenate([_CANDIDATES, np.zeros((1, 2))])
        best, step = candidates[xp.argmax(ratio(candidates))], step / 6
    return xp.where(ratio(own[None]) >= FARTHER, own, best)


def _is_whole_disk(region: Region) -> bool:
    return isinstance(region, Disk) and region.whole


def _rim(region: Region, half: Region | None) -> int:
    """Boundary points on the arc of a disk that is cut, or of one half of it."""
    assert isinstance(region, Disk)
    if region.whole:
        return 0
    return region.counts[0] if half is None else region.counts[0] // 2


def _one_side(region: Region, center: Array, axis: float) -> Region | None:
    """One side of a mirrored boundary, counted twice; None if it is not mirrored."""
    direction = np.array([np.cos(axis), np.sin(axis)])
    pairs = mirrored_pairs(
        np.asarray(region.points - center), np.asarray(region.weights), direction
    )
    if pairs is None:
        return None
    side = pairs[0]
    return eqx.tree_at(
        lambda tree: (tree.points, tree.weights, tree.normals),
        region,
        (region.points[side], 2 * region.weights[side], region.normals[side]),
    )
