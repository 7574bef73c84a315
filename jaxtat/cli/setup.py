"""From command-line options to geometry, regularisation and data."""

import argparse
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..geometry import (
    DetectorCurve,
    ImageGrid,
    TruncatedDisk,
    circular_arc,
    data_radii,
    detector_curve,
    fit_circle,
    truncated_disk,
)
from ..io.scans import Scan
from ..plan import PAPER_K, ReconstructionPlan, build_plan
from ..pressure import condition_record, pressure_to_circular_integrals
from ..reconstruction import cosine_filter
from ..regularization import FixedRank, NormBound, Regularization, SingularValueCutoff


def detectors(options: argparse.Namespace, known: dict[str, np.ndarray]) -> DetectorCurve:
    """The curve of --arc, --ring or the file's positions, reduced to --use."""
    if options.arc:
        radius, z_right, n = options.arc
        curve = circular_arc(radius, z_right, int(n))
        if options.use is None:
            return curve
        positions = np.asarray(curve.points)
    elif options.ring:
        radius, n = options.ring
        theta = 2 * np.pi * np.arange(int(n)) / int(n)
        positions = radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    elif "detectors" in known:
        positions = known["detectors"]
    else:
        raise ValueError("no detector positions: give --arc or --ring, or name them in the file.")
    return detector_curve(positions[chosen(options.use, len(positions))])


def chosen(use: str | None, n: int) -> np.ndarray:
    """Indices of the slices in ``use``, all n by default.

    >>> chosen("6:8,0:2", 8).tolist()
    [6, 7, 0, 1]
    """
    if use is None:
        return np.arange(n)
    try:
        pieces = [slice(*(int(v) if v else None for v in s.split(":"))) for s in use.split(",")]
        indices = np.concatenate([np.arange(n)[piece] for piece in pieces])
    except (ValueError, TypeError):
        raise ValueError(
            f"--use {use}: expected slices such as 904:1024,0:616 or 0:500:2."
        ) from None
    return indices


def plan_for(
    options: argparse.Namespace, known: dict[str, np.ndarray], radii: Array | None
) -> ReconstructionPlan:
    """Build the plan that the options ask for; data radii are the pixel apart by default."""
    curve = detectors(options, known)
    region = _region(options, curve)
    half_width = options.half_width or float(region.reach)
    grid = ImageGrid(options.pixels, half_width, region.center)
    radii = data_radii(curve, region, grid.spacing[0]) if radii is None else radii
    return build_plan(
        curve,
        region,
        grid,
        radii,
        _regularization(options),
        method="series" if options.series else "collocation",
        max_frequency=options.max_frequency,
        precision="single" if options.single else "double",
        progress=not options.quiet,
    )


def circular_integrals_of(scan: Scan, options: argparse.Namespace, plan: ReconstructionPlan):
    """The scan's data at the plan's detectors and radii."""
    data = _detectors_first(scan, options)
    data = data[chosen(options.use, data.shape[0])]
    if data.shape[0] != plan.curve.n_detectors:
        raise ValueError(
            f"the data have {data.shape[0]} detectors (shape {scan.data.shape}), the geometry has "
            f"{plan.curve.n_detectors}: choose them with --use, or use another plan."
        )
    _require_same_detectors(scan, options, plan)
    if scan.kind == "circular_integrals":
        return data.astype(np.float64)
    times = _times(scan, options, data.shape[1])
    record = data.astype(np.float64)
    if options.band or options.dead_time:
        record = condition_record(
            record,
            times,
            dead_time=options.dead_time,
            band=tuple(options.band) if options.band else None,
        )
    return pressure_to_circular_integrals(
        record, times, plan.radii, sound_speed=sound_speed(scan, options), model=options.model
    )


def low_pass(options: argparse.Namespace) -> Callable[[Array], Array] | None:
    """The filter of --low-pass."""
    return cosine_filter if options.low_pass == "cosine" else None


def sound_speed(scan: Scan, options: argparse.Namespace) -> float:
    """--sound-speed, else the file's, else 1."""
    if options.sound_speed is not None:
        return options.sound_speed
    return float(np.mean(scan.known.get("sound_speed", 1.0)))


def _region(options: argparse.Namespace, curve: DetectorCurve) -> TruncatedDisk:
    circle = fit_circle(curve.points)
    center = circle.center if options.region_center is None else jnp.array(options.region_center)
    opening, cut = _opening(curve)
    angle = opening if options.region_angle is None else np.radians(options.region_angle)
    radius, right = options.region_radius, options.region_cut
    if radius is None:
        radius = 0.75 * float(circle.radius)
        right = cut if right is None else right
    right = radius if right is None else right
    return truncated_disk(radius, right, 2 * curve.n_detectors, center=center, angle=angle)


def _opening(curve: DetectorCurve) -> tuple[float, float]:
    """Direction in which an arc opens, and where along it its ends lie, from its centre."""
    if curve.closed:
        return 0.0, np.inf
    center = np.asarray(fit_circle(curve.points).center)
    points = np.asarray(curve.points) - center
    normal = np.array([1.0, -1.0]) * (points[-1] - points[0])[::-1]  # to the chord of the ends
    normal *= -np.sign(normal @ (points.mean(axis=0) - (points[0] + points[-1]) / 2))
    normal /= np.linalg.norm(normal)
    return float(np.arctan2(normal[1], normal[0])), float(normal @ (points[0] + points[-1]) / 2)


def _regularization(options: argparse.Namespace) -> Regularization:
    if options.j_max is not None:
        return FixedRank(options.j_max)
    if options.sigma_min is not None:
        return SingularValueCutoff(options.sigma_min)
    return NormBound(PAPER_K if options.K is None else options.K)


def _detectors_first(scan: Scan, options: argparse.Namespace) -> np.ndarray:
    """Data as (detectors, samples); a file in the other order is told by its other axis."""
    if scan.data.ndim != 2:
        raise ValueError(f"the data have shape {scan.data.shape}, expected (detectors, samples).")
    n = None
    if options.ring or options.arc:
        n = int((options.ring or options.arc)[-1])
    elif "detectors" in scan.known:
        n = len(scan.known["detectors"])
    return scan.data.T if n == scan.data.shape[1] != scan.data.shape[0] else scan.data


def _times(scan: Scan, options: argparse.Namespace, n: int) -> Array:
    if options.duration is not None:
        return jnp.linspace(0.0, options.duration, n)
    rate = options.sampling_rate or scan.known.get("sampling_rate")
    if rate is not None:
        return jnp.arange(n) / float(np.mean(rate))
    if "times" in scan.known:
        return jnp.asarray(scan.known["times"])
    raise ValueError(
        "no sample times: give --sampling-rate or --duration, or name times in the file."
    )


def _require_same_detectors(
    scan: Scan, options: argparse.Namespace, plan: ReconstructionPlan
) -> None:
    """A plan made for other detectors would give a wrong image without a sign."""
    if not (options.arc or options.ring or "detectors" in scan.known):
        return
    points = detectors(options, scan.known).points
    off = float(jnp.abs(points - plan.curve.points).max())
    if off > 1e-6 * float(jnp.abs(plan.curve.points).max()):
        raise ValueError(
            f"the plan was built for other detectors (positions differ by up to {off:.3g}): "
            "build one for this scan."
        )
