"""From command-line options to geometry, regularisation and data."""

import argparse
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..checks import Numbers, real_array
from ..geometry import (
    DetectorCurve,
    ImageGrid,
    Region,
    TruncatedDisk,
    circular_arc,
    data_radii,
    detector_curve,
    fit_circle,
    require_outside,
    truncated_disk,
)
from ..io.scans import Scan
from ..plan import PAPER_K, ReconstructionPlan, build_plan
from ..pressure import condition_record, pressure_to_circular_integrals
from ..reconstruction import cosine_filter
from ..regularization import FixedRank, NormBound, Regularization, SingularValueCutoff

_OF_PLANS = ("K", "j_max", "sigma_min", "series", "collocation", "single")


def detectors(options: argparse.Namespace, known: dict[str, np.ndarray]) -> DetectorCurve:
    """The curve of --arc, --ring or the file's positions, reduced to --use."""
    if options.arc:
        radius, z_right, n = options.arc
        curve = circular_arc(radius, z_right, _count("--arc", n))
        if options.use is None:
            return curve
        positions = np.asarray(curve.points)
    elif options.ring:
        radius, n = options.ring[0], _count("--ring", options.ring[1])
        theta = 2 * np.pi * np.arange(n) / n
        positions = radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    elif "detectors" in known:
        positions = known["detectors"]
        if positions.ndim != 2:
            raise ValueError(
                f"positions have shape {positions.shape}, expected (detectors, 2 or 3)."
            )
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
    return np.concatenate([_piece(piece, n) for piece in use.split(",")])


def _piece(text: str, n: int) -> np.ndarray:
    """Indices of one slice; what reaches beyond the n detectors is refused, not clipped."""
    try:
        bounds = [int(bound) if bound else None for bound in text.split(":")]
        piece = np.arange(n)[slice(*bounds)]
    except (ValueError, TypeError):
        bounds, piece = [], np.arange(0)
    if len(bounds) < 2:
        raise ValueError(f"--use {text}: expected slices such as 904:1024,0:616 or 0:500:2.")
    if piece.size == 0 or any(abs(bound) > n for bound in bounds[:2] if bound is not None):
        raise ValueError(f"--use {text}: there are {n} detectors, 0 to {n - 1}.")
    return piece


def geometry(
    options: argparse.Namespace, scan: Scan | None
) -> tuple[DetectorCurve, TruncatedDisk, ImageGrid, Array]:
    """Curve, region, grid and radii that the options and the file ask for.

    Radii are those of the file's circular integrals, else the pixel apart.
    """
    curve = detectors(options, scan.known if scan else {})
    region = _region(options, curve)
    require_outside(curve, region)
    half_width = float(region.reach) if options.half_width is None else options.half_width
    grid = ImageGrid(129 if options.pixels is None else options.pixels, half_width, region.center)
    if scan and scan.kind == "circular_integrals" and "radii" in scan.known:
        return curve, region, grid, real_array("radii", scan.known["radii"], ("radii",))
    end = None if scan is None or scan.kind != "pressure" else _record_end(scan, options, curve)
    # the last radius may lie a step beyond the farthest source
    sources = None if end is None else _sources(curve, region, end - float(grid.spacing[0]))
    return curve, region, grid, data_radii(curve, region, grid.spacing[0], sources=sources)


def _sources(curve: DetectorCurve, region: TruncatedDisk, end: float) -> TruncatedDisk:
    """Where sources may be: all the circle of the array but its rim, as far as the record tells.

    Water, skin and bed outside the region of interest are recorded too, and cutting their circles
    would falsify the image inside.
    """
    circle = fit_circle(curve.points)
    radius = min(0.95 * float(circle.radius), end - float(circle.radius))
    if radius <= 0:
        return region
    return truncated_disk(radius, radius, 256, center=circle.center)


def plan_for(
    options: argparse.Namespace, geometry: tuple[DetectorCurve, Region, ImageGrid, Array]
) -> ReconstructionPlan:
    """Build the plan that the options ask for."""
    return build_plan(
        *geometry,
        _regularization(options),
        method=_method(options),
        max_frequency=options.max_frequency,
        precision="single" if options.single else "double",
        progress=not options.quiet,
    )


def _method(options: argparse.Namespace) -> str:
    if options.series:
        return "series"
    return "collocation" if options.collocation else "harmonic"


def wants_plan(options: argparse.Namespace) -> bool:
    """Whether an option asks for densities, and so for a plan, where none is given."""
    asked = any(getattr(options, name) not in (None, False) for name in _OF_PLANS)
    if asked and options.alpha is not None:
        raise ValueError("--alpha is for a reconstruction without densities: leave out the others.")
    return asked


def require_free(options: argparse.Namespace) -> None:
    """Raise ValueError for options that a finished plan has already decided."""
    decided = (
        *("region_radius", "region_cut", "region_angle", "region_center", "pixels", "half_width"),
        *("max_frequency", "alpha"),
        *_OF_PLANS,
    )
    for name in decided:
        if getattr(options, name) not in (None, False):
            raise ValueError(f"--{name.replace('_', '-')} and --plan: the plan has decided that.")


def circular_integrals_of(
    scan: Scan, options: argparse.Namespace, curve: DetectorCurve, radii: Array
) -> Array:
    """The scan's data at the detectors and radii."""
    data = _detectors_first(scan, options, curve)
    data = data[chosen(options.use, data.shape[0])]
    if data.shape[0] != curve.n_detectors:
        raise ValueError(
            f"the data have {data.shape[0]} detectors (shape {scan.data.shape}), the geometry has "
            f"{curve.n_detectors}: choose them with --use, or use another plan."
        )
    data = real_array(scan.kind, data, None)
    _require_same_detectors(scan, options, curve)
    if scan.kind == "circular_integrals":
        _require_same_radii(scan, radii, data.shape[1])
        return data
    times = _times(scan, options, data.shape[1])
    if options.band or options.dead_time:
        band = tuple(options.band) if options.band else None
        data = condition_record(
            data,
            times,
            dead_time=options.dead_time,
            band=band,
            baseline=options.model == "in-plane",  # the slow tail of 2-D waves is signal
        )
    return pressure_to_circular_integrals(
        data, times, radii, sound_speed=sound_speed(scan, options), model=options.model
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


def _count(option: str, value: float) -> int:
    if not (value >= 1 and value.is_integer() and value < 2**31):
        raise ValueError(f"{option}: the number of detectors is {value:g}, expected a whole one.")
    return int(value)


def _regularization(options: argparse.Namespace) -> Regularization | None:
    if options.series:
        if not options.K == options.j_max == options.sigma_min is None:
            raise ValueError("--series is a closed form: --K, --j-max and --sigma-min do nothing.")
        return None
    if options.j_max is not None:
        return FixedRank(options.j_max)
    if options.sigma_min is not None:
        return SingularValueCutoff(options.sigma_min)
    return NormBound(PAPER_K if options.K is None else options.K)


def _detectors_first(scan: Scan, options: argparse.Namespace, curve: DetectorCurve) -> np.ndarray:
    """Data as (detectors, samples); a file in the other order is told by its other axis."""
    if scan.data.ndim != 2:
        raise ValueError(f"the data have shape {scan.data.shape}, expected (detectors, samples).")
    if options.ring or options.arc:
        n = _count("--ring" if options.ring else "--arc", (options.ring or options.arc)[-1])
    elif "detectors" in scan.known:
        n = len(scan.known["detectors"])
    else:
        n = curve.n_detectors if options.use is None else None
    return scan.data.T if n == scan.data.shape[1] != scan.data.shape[0] else scan.data


def _record_end(scan: Scan, options: argparse.Namespace, curve: DetectorCurve) -> float:
    """The path that sound travels within the record [length]."""
    samples = _detectors_first(scan, options, curve).shape[1]
    times = real_array("times", _times(scan, options, samples), ("times",))
    return float(times[-1]) * sound_speed(scan, options)


def _times(scan: Scan, options: argparse.Namespace, n: int) -> Numbers:
    if options.duration is not None:
        return jnp.linspace(0.0, options.duration, n)
    rate = options.sampling_rate
    if rate is None and "sampling_rate" in scan.known:
        rate = float(np.mean(scan.known["sampling_rate"]))
    if rate is not None:
        if not rate > 0:
            raise ValueError(f"the sampling rate is {rate:g}, expected a value above zero.")
        return jnp.arange(n) / rate
    if "times" in scan.known:
        return scan.known["times"]
    raise ValueError(
        "no sample times: give --sampling-rate or --duration, or name times in the file."
    )


def _require_same_detectors(scan: Scan, options: argparse.Namespace, curve: DetectorCurve) -> None:
    """A plan made for other detectors would give a wrong image without a sign."""
    if not (options.arc or options.ring or "detectors" in scan.known):
        return
    points = detectors(options, scan.known).points
    if points.shape != curve.points.shape:
        raise ValueError(
            f"the scan has positions of {points.shape[0]} detectors, but its data and the plan "
            f"{curve.n_detectors}: build a plan for this scan."
        )
    off = float(jnp.abs(points - curve.points).max())
    if off > 1e-6 * float(jnp.abs(curve.points).max()):
        raise ValueError(
            f"the plan was built for other detectors (positions differ by up to {off:.3g}): "
            "build one for this scan."
        )


def _require_same_radii(scan: Scan, radii: Array, n: int) -> None:
    """Integrals over other circles would give a wrong image without a sign."""
    if n != radii.shape[0]:
        raise ValueError(
            f"the data have {n} radii, the geometry has {radii.shape[0]}: name radii in the file, "
            "or choose --region-radius, --pixels and --half-width to match."
        )
    if "radii" not in scan.known:
        return
    own = real_array("radii", scan.known["radii"], radii.shape)
    off = float(jnp.abs(own - radii).max())
    if off > 1e-6 * float(radii.max()):
        raise ValueError(
            f"the plan was built for other radii (they differ by up to {off:.3g}): "
            "build one for this scan."
        )
