"""Curve and region in polar coordinates, and the centre and axis of the cylindrical waves.

The waves J_n(lambda |x - c|) e^{in theta} write the potentials of all detectors that are farther
from c than every point of the region. The axis is the line in which the geometry is mirrored, if it
is: then cosines and sines do not mix.
"""

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...base.checks import by_library, is_concrete
from ...geometry import (
    Body,
    CircularArc,
    DetectorCurve,
    Disk,
    DiskBody,
    OutlineBody,
    Region,
    circle_through,
    near_circle,
    region_about,
)
from ...geometry.elements import NODES, gauss_rule, nodes_touching_circle, touch_circle
from ...special import decay_steps
from ..symmetry import elements_mirrored, mirrored_pairs
from .kernels import BodyKernels, HankelKernels, Kernels, OutlineKernels
from .orders import highest_orders

_ROUNDING = 1e-9  # relative, for positions that are called equal
_ROUNDED = 1e-15  # relative, for what is left out because it is zero
FARTHER = 1.2  # nearest detector over farthest point of the region, from which waves are worth it
RESOLVED = 0.02  # residual of an outline's equations half as deep as those that are solved
REACHED = 0.99  # the same, inverted, up to which they can be used at all
_CANDIDATES = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 17)] * 2), axis=-1).reshape(-1, 2)


class ElementNodes(eqx.Module):
    """Gauss rules on the elements of detectors, about c; nodes first.

    Attributes:
        radius, angles: |z_ki - c| [length], and theta_ki [rad]. Of elements that are all alike, on
            a circle about c, those of one of them, counted from its middle.
        weights: c_i, which add up to 1.
    """

    radius: Float[Array, "nodes *detectors"]
    angles: Float[Array, "nodes *detectors"]
    weights: Float[Array, " nodes"]


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
        halved: whether the chord of that disk goes through c.
        half_turn: whether the detectors are alike, evenly on half a circle about c and the axis.
        element_angle: D, of elements that are arcs of the circle, all alike [rad]; or else
        nodes: of other elements of finite size. None of both for point detectors.
        kernels: what detectors record of each wave.
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
    halved: bool = eqx.field(static=True)
    half_turn: bool = eqx.field(static=True)
    element_angle: Float[Array, ""] | None = None
    nodes: ElementNodes | None = None
    kernels: Kernels = HankelKernels()

    @property
    def on_circle(self) -> bool:
        return self.detector_radius.ndim == 0

    @property
    def reach(self) -> Float[Array, ""]:
        """Largest |x - c| in the region [length]."""
        if self.disk:
            return self.region.reach
        return by_library(_farthest, (self.region.points, self.center))

    @property
    def nearest(self) -> float:
        """The least |z - c| of all detectors, which are known, and of their elements [length]."""
        radius = self.detector_radius if self.nodes is None else self.nodes.radius
        return float(np.asarray(radius).min())

    def one_side(self) -> "PolarGeometry":
        """The first half of the detectors of a mirrored geometry, which stand for both halves."""
        weights = half_weights(self.weights)
        half, radius, nodes = weights.shape[0], self.detector_radius, self.nodes
        if not self.on_circle:
            radius = radius[:half]
            if nodes is not None:
                nodes = ElementNodes(nodes.radius[:, :half], nodes.angles[:, :half], nodes.weights)
        return replace(
            self,
            detector_radius=radius,
            detector_angles=self.detector_angles[:half],
            weights=weights,
            nodes=nodes,
        )


def _farthest(xp: Any, points: Any, center: Any) -> Any:
    return xp.linalg.norm(points - center, axis=1).max()


def wave_orders(geometry: PolarGeometry, frequencies: np.ndarray) -> np.ndarray:
    """N(lambda) of a concrete geometry; ValueError if waves about the centre do not reach."""
    reach, distance = float(geometry.reach), geometry.nearest
    if reach >= REACHED * distance:
        raise ValueError(
            f"the region reaches {reach:.6g} from {np.asarray(geometry.center)}, a detector is "
            f"only {distance:.6g} away: cylindrical waves need every detector farther off than "
            "the region. Use a smaller region, or method='auto' or 'collocation' of build_plan."
        )
    highest = frequencies * float(geometry.kernels.highest_ratio)
    return highest_orders(highest, reach, distance)


def require_resolved(geometry: PolarGeometry, frequency: float, n_max: int) -> None:
    """Raise ValueError where waves about its centre do not solve the equations of an outline."""
    if not isinstance(geometry.kernels, OutlineKernels):
        return
    few = slice(None, None, max(1, geometry.weights.shape[0] // 8))
    highest = jnp.asarray(frequency)
    residual = geometry.kernels.residual(
        highest,
        geometry.detector_radius[few],
        geometry.detector_angles[few],
        decay_steps(n_max + 1, highest * geometry.reach),
    )
    if not float(residual) < RESOLVED:
        raise ValueError(
            "waves about the body's centre miss the equations at the body's outline by "
            f"{float(residual):.2g} of their size, expected less than {RESOLVED}: smooth the "
            "outline, or take a DiskBody, or a lower max_frequency."
        )


def waves_reach(curve: DetectorCurve, region: Region, medium: Body | None = None) -> bool:
    """Whether cylindrical waves write the potentials of a concrete geometry with few orders.

    For detectors off a circle they are asked to reach with a ratio of 1.2; below it orders, and
    products over detectors, grow until direct kernels are cheaper, which there are none of through
    a body.
    """
    geometry = polar_geometry(curve, region, medium=medium)
    least = 1 / REACHED if medium is not None or near_circle(curve) else FARTHER * (1 - _ROUNDING)
    return geometry.nearest > least * float(geometry.reach)


def half_weights(weights: Float[Array, " detectors"]) -> Float[Array, " half"]:
    """Weights of the first half: twice w for a detector that stands for two, w for one on the axis.

    Detectors are in order along the curve, so that the mirror image of number k is the k-th last.
    """
    n = weights.shape[0]
    kept = np.arange(-(-n // 2))
    return weights[: len(kept)] * np.where(2 * kept == n - 1, 1.0, 2.0)


def wave_offset(curve: DetectorCurve, region: Region) -> tuple[float, float]:
    """Where waves are best centred, counted from the centre of the region [length].

    For detectors on a circle at its centre, so that radial factors are the same for all of them.
    For others at the centre of the region, or, if a detector is hardly farther from it than the
    region reaches, at the point for which the ratio of these distances is best.

    A size, which is decided once: images depend on the centre by the unit of alpha, so that one
    chosen anew for each position would make them jump.

    Args:
        curve, region: concrete.
    """
    circle = circle_through(curve)
    center = _best_center(curve, region) if circle is None else np.asarray(circle.center)
    x, y = center - np.asarray(region.center)
    near = max(abs(x), abs(y)) <= _ROUNDING * float(region.reach)
    return (0.0, 0.0) if near else (float(x), float(y))


def polar_geometry(
    curve: DetectorCurve,
    region: Region,
    n_nodes: int = NODES,
    offset: tuple[float, float] | None = None,
    medium: Body | None = None,
) -> PolarGeometry:
    """Curve and region about the centre of the waves.

    Symmetries are looked for in concrete geometries alone, since a derivative may move any position
    off them; they save time, and change results by rounding. A `CircularArc` remains an arc when
    its radius or opening is traced.

    Args:
        curve, region: the geometry.
        n_nodes: on elements of finite width, where they are no arcs about the centre.
        offset: `wave_offset`; by default that of a concrete geometry.
        medium: a body of another speed of sound. The waves are about its centre, and the region is
            the disk about it that holds the other.
    """
    if medium is None:
        return _polar_geometry(curve, region, n_nodes, offset)
    about = region_about(medium, region)
    if isinstance(medium, OutlineBody):
        with jax.ensure_compile_time_eval() if is_concrete(curve, about) else nullcontext():
            geometry = _with_nodes(_about_center(curve, about, (0.0, 0.0)), curve, n_nodes)
        return replace(geometry, kernels=OutlineKernels(medium, geometry.axis))
    assert isinstance(medium, DiskBody)
    geometry = _polar_geometry(curve, about, n_nodes, (0.0, 0.0))
    return replace(geometry, kernels=BodyKernels(medium))


def _polar_geometry(
    curve: DetectorCurve, region: Region, n_nodes: int, offset: tuple[float, float] | None
) -> PolarGeometry:
    offset = wave_offset(curve, region) if offset is None else offset
    if isinstance(curve, CircularArc) and is_concrete(curve.center, region.center):
        angle = curve.element_angle
        away = np.asarray(region.center) + np.array(offset) - np.asarray(curve.center)
        size = float(curve.radius) if is_concrete(curve.radius) else np.abs(offset).max()
        centred = np.abs(away).max() <= _ROUNDING * size
        if centred and (angle is None or angle.ndim == 0):
            return _about_arc(curve, region, offset)
    if is_concrete(curve.points, curve.weights, curve.normals, region):
        with jax.ensure_compile_time_eval():  # the width may be traced
            geometry = _with_symmetry(curve, region, offset)
    else:
        geometry = _about_center(curve, region, offset)
    return _with_nodes(geometry, curve, n_nodes)


def _about_arc(arc: CircularArc, region: Region, offset: tuple[float, float]) -> PolarGeometry:
    """An arc is symmetric for all its parameters; whether the region is too is checked."""
    concentric = isinstance(region, Disk) and offset == (0.0, 0.0)
    disk = concentric and _is_whole_disk(region)
    half = None
    if not disk and is_concrete(arc.points, arc.weights, region):
        with jax.ensure_compile_time_eval():
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
        halved=concentric and _through_center(region),
        half_turn=is_concrete(arc.half_opening)
        and abs(float(arc.half_opening) - np.pi / 2) < _ROUNDED,
        element_angle=arc.element_angle,
    )


def _about_center(
    curve: DetectorCurve, region: Region, offset: tuple[float, float]
) -> PolarGeometry:
    """Any positions, each detector by itself; the axis is between the first and the last."""
    center = region.center if offset == (0.0, 0.0) else region.center + np.array(offset)
    radius, angles, axis = by_library(_in_polar_coordinates, (curve.points, center))
    return PolarGeometry(
        center=center,
        axis=axis,
        detector_radius=radius,
        detector_angles=angles,
        weights=curve.weights,
        region=region,
        mirror=False,
        disk=_is_whole_disk(region) and offset == (0.0, 0.0),
        rim=0,
        halved=False,
        half_turn=False,
    )


def _in_polar_coordinates(xp: Any, points: Any, center: Any) -> tuple[Any, Any, Any]:
    local = points - center
    angles = xp.unwrap(xp.arctan2(local[:, 1], local[:, 0]))
    axis = (angles[0] + angles[-1]) / 2
    return xp.linalg.norm(local, axis=1), angles - axis, axis


def _with_symmetry(
    curve: DetectorCurve, region: Region, offset: tuple[float, float]
) -> PolarGeometry:
    """Concrete positions: on a circle and mirrored if they are to rounding."""
    geometry = _about_center(curve, region, offset)
    center, axis = np.asarray(geometry.center), float(geometry.axis)
    distance, angles = np.asarray(geometry.detector_radius), np.asarray(geometry.detector_angles)
    weights = np.asarray(curve.weights)
    direction = np.array([np.cos(axis), np.sin(axis)])
    mirrored = (
        np.abs(angles + angles[::-1]).max() < _ROUNDING
        and np.abs(weights - weights[::-1]).max() < _ROUNDING * weights.max()
        and np.abs(distance - distance[::-1]).max() < _ROUNDING * distance.max()
        and elements_mirrored(curve, center, direction)
    )
    outward = (np.asarray(curve.points) - center) / distance[:, None]
    on_circle = np.ptp(distance) <= _ROUNDING * distance.max() and _elements_alike(curve, outward)
    half = _one_side(region, center, axis) if mirrored and not geometry.disk else None
    concentric = isinstance(region, Disk) and offset == (0.0, 0.0)
    return replace(
        geometry,
        detector_radius=jax.device_put(distance.mean()) if on_circle else geometry.detector_radius,
        region=region if half is None else half,
        mirror=bool(mirrored and geometry.disk) or half is not None,
        rim=_rim(region, half) if concentric else 0,
        halved=concentric and _through_center(region),
    )


def _elements_alike(curve: DetectorCurve, outward: np.ndarray) -> bool:
    """Whether turning about the centre leads from one element to all others."""
    if curve.element_width is None:
        return True
    if isinstance(curve, CircularArc) or curve.element_width.ndim:
        return False
    return touch_circle(curve.normals, outward, _ROUNDING)


def _with_nodes(geometry: PolarGeometry, curve: DetectorCurve, n: int) -> PolarGeometry:
    """The geometry with the nodes of its elements, if these have a width."""
    if curve.element_width is None:
        return geometry
    nodes, weights = map(jnp.asarray, gauss_rule(n))
    if geometry.on_circle:  # straight, and touching the circle in their middles
        where = geometry.detector_radius, curve.element_width, nodes
        distance, angles = nodes_touching_circle(jnp, *where)
    else:
        local = jnp.moveaxis(curve.element_nodes(n)[0], 1, 0) - geometry.center
        distance = jnp.linalg.norm(local, axis=-1)
        angles = jnp.arctan2(local[..., 1], local[..., 0]) - geometry.axis
    return replace(geometry, nodes=ElementNodes(distance, angles, weights))


def _best_center(curve: DetectorCurve, region: Region) -> Float[np.ndarray, "2"]:
    """c with the largest min |z_k - c| / max |x - c|, or the region's centre if that is enough.

    The best centre of a disk is its own: if c moves by d, detectors are at most d farther off, and
    the rim is d farther off.
    """
    own = np.asarray(region.center)
    if _is_whole_disk(region):
        return own
    detectors, boundary = np.asarray(curve.points), np.asarray(region.points)

    def ratio(c: np.ndarray) -> np.ndarray:
        nearest = np.linalg.norm(detectors - c[:, None], axis=-1).min(axis=-1)
        return nearest / np.linalg.norm(boundary - c[:, None], axis=-1).max(axis=-1)

    if ratio(own[None])[0] >= FARTHER:
        return own
    best, step = own, np.linalg.norm(boundary - own, axis=-1).max()
    for _ in range(4):
        candidates = best + step * np.concatenate([_CANDIDATES, np.zeros((1, 2))])
        best, step = candidates[np.argmax(ratio(candidates))], step / 6
    return best


def _is_whole_disk(region: Region) -> bool:
    return isinstance(region, Disk) and region.whole


def _rim(region: Region, half: Region | None) -> int:
    """Boundary points on the arc of a disk that is cut, or of one half of it."""
    assert isinstance(region, Disk)
    if region.whole:
        return 0
    return region.counts[0] if half is None else region.counts[0] // 2


def _through_center(region: Region) -> bool:
    """Whether the chord of a disk goes through its centre, and is known to stay there."""
    if not isinstance(region, Disk) or region.whole or not is_concrete(region):
        return False
    return bool(abs(float(region.cut)) <= _ROUNDED * float(region.radius))


def _one_side(region: Region, center: Any, axis: float) -> Region | None:
    """One side of a mirrored boundary, counted twice; None if it is not mirrored."""
    direction = np.array([np.cos(axis), np.sin(axis)])
    points, weights, normals = map(np.asarray, (region.points, region.weights, region.normals))
    pairs = mirrored_pairs(points - np.asarray(center), weights, direction)
    if pairs is None:
        return None
    side = pairs[0]
    return eqx.tree_at(
        lambda tree: (tree.points, tree.weights, tree.normals),
        region,
        jax.device_put((points[side], 2 * weights[side], normals[side])),
    )
