"""Facts of a scan, as opposed to choices: positions in the plane, their order, times, units."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..base.checks import real_array
from ..base.scanners import scanner_named
from ..base.units import MICROSECONDS, MILLIMETRES, Units
from ..geometry import ArcFit, fit_arc, in_plane, order_along_curve
from ..geometry.arcs import ROUND
from ..geometry.measured_curves import behind_gap
from ..io import Scan
from ..io.frames import LazyFrames
from ..io.scan import require_one_rate
from ..records import gaussian_response, require_equispaced

PER_FRAME = {"wavelengths", "laser_energy", "frame_numbers"}
FEWEST = 4  # detectors of a curve
NEIGHBOURS = 1.6  # distances to the nearest detector within which others are neighbours
SHORTEST = 32  # samples of a record, whose power is measured in pieces of 16
RESPONSE = "impulse response"  # in what is said about a scan
FLAT = 1e-3  # least extent over largest, from which detectors are not in a plane
WATER = 1500.0  # speed of sound, nominal [m/s]
SLOWEST, FASTEST = 1400 / WATER, 1650 / WATER  # of water and tissue, over that
# radii of scanners and sampling rates of theirs, by which units are told: (unit, least, greatest);
# a radius of 1 with 100 samples per time is of no unit
LENGTHS = (("m", 1e-3, 2.0), ("mm", 3.0, 1e3))
TIMES = (("s", 1e5, 1e10), ("us", 0.5, 1e3))
IN_METRES = (1e-3, 0.3)  # radii that are in metres even where there is no sampling rate to ask


class Facts(NamedTuple):
    """A scan's geometry and times.

    Attributes:
        points: detector positions in the plane, in the order of the data, (detectors, 2) [length].
        order: rows of the data, in order along the curve.
        arc: the circle and arc that they lie on; None of another curve.
        times: of a pressure record, (times,) [time].
        units: of lengths and times.
        in_space: whether positions have three coordinates.
    """

    points: Float[np.ndarray, "detectors 2"]
    order: Int[np.ndarray, " used"]
    arc: ArcFit | None
    times: Float[np.ndarray, " times"] | None
    units: Units
    in_space: bool

    def later(self, shift: float) -> "Facts":
        """The same with a pressure record whose samples are later [time]."""
        return self if self.times is None else self._replace(times=self.times + shift)


def with_facts(
    scan: Scan,
    *,
    scanner: str | None = None,
    detectors: Any = None,
    sampling_rate: float | None = None,
    times: Any = None,
    start_time: float | None = None,
    element_response: Any = None,
    element_band: Any = None,
    frames: Any = None,
) -> Scan:
    """The scan with facts that its file lacks, or has wrongly.

    Args:
        scan: from `load_scan`.
        scanner: name in `SCANNERS`, for positions, and for the sampling rate if the file has none.
        detectors: positions, (detectors, 2 or 3) [length]; data that are (samples, detectors) are
            turned to fit.
        sampling_rate: of a record that starts at time 0 [1/time]; it or times replace both of the
            file.
        times: of the record, (samples,) [time].
        start_time: of the first sample, in place of 0 or of the file's; below zero where samples
            were taken before the laser fired [time].
        element_response: impulse response of the elements in place of the file's, (taps,) or
            (detectors, taps), at the sampling rate, time 0 in the middle.
        element_band: centre frequency and -6 dB bandwidth over it, as a data sheet has them, in
            place of a response, see `records.gaussian_response` [1/time, 1].
        frames: numbers of those that are wanted, from 0, (some,).

    Raises:
        ValueError: for an unknown scanner, frames that are not there, and what does not fit the
            data.
    """
    known = dict(scan.known)
    if scanner is not None:
        preset = scanner_named(scanner)
        detectors = preset.positions if detectors is None else detectors
        if not {"times", "sampling_rate"} & set(known) and scan.kind == "pressure":
            sampling_rate = preset.sampling_rate if sampling_rate is None else sampling_rate
    if detectors is not None:
        known["detectors"] = np.asarray(detectors)
        if len(known["detectors"]) == scan.n_samples != scan.n_detectors:
            scan = replace(scan, data=scan.data.swapaxes(-1, -2), known={})
    clock = {"sampling_rate": sampling_rate, "times": times}
    if sampling_rate is not None or times is not None:
        known = {name: value for name, value in known.items() if name not in clock}
    known |= {name: np.asarray(value) for name, value in clock.items() if value is not None}
    scan = replace(scan, known=known)
    require_one_rate(scan)
    if element_response is not None or element_band is not None:
        scan = _heard_by(scan, element_response, element_band)
    if start_time is not None:
        scan = _starting_at(scan, float(real_array("start_time", start_time, ())))
    return scan if frames is None else some_frames(scan, frames)


def _heard_by(scan: Scan, response: Any, band: Any) -> Scan:
    """The scan with a response of its elements."""
    times = times_of(scan)
    if times is None:
        raise ValueError("responses of elements are of pressure records, the data are integrals.")
    if response is not None and band is not None:
        raise ValueError("element_response and element_band are given, expected one of them.")
    given, why = response, "given"
    if band is not None:
        center, width = map(float, real_array("element_band", band, (2,)))
        rate = float(scan.known.get("sampling_rate", 1 / (times[1] - times[0])))
        given = gaussian_response(rate, center, width)
        why = f"of the band that is given, {width:.0%} wide about {center:g}"
    response = np.asarray(real_array("element_response", np.asarray(given), None))
    if response.ndim == 2 and 1 in response.shape:  # as MATLAB writes a list
        response = response.reshape(-1)
    if response.shape[-1:] > (scan.n_samples,) or not response.any():
        raise ValueError(
            f"element_response has {response.shape[-1]} samples, expected some that are not 0, and "
            f"no more than the record's {scan.n_samples}: is it at the same sampling rate, its "
            "frequency in the same unit?"
        )
    known = {**scan.known, "impulse_response": response}
    return replace(scan, known=known, about={**scan.about, RESPONSE: why})


def _starting_at(scan: Scan, start: float) -> Scan:
    """The scan with times from ``start`` on, in place of a sampling rate too."""
    times = times_of(scan)
    if times is None:
        raise ValueError("start_time is of pressure records, and the data are integrals.")
    others = {name: value for name, value in scan.known.items() if name != "sampling_rate"}
    return replace(scan, known=others | {"times": times - times[0] + start})


def some_frames(scan: Scan, frames: Any) -> Scan:
    """The scan of these frames, read when asked for; they keep their numbers."""
    numbers = _numbers("frames", frames, "frames", scan.n_frames)
    if scan.data.ndim == 2:
        return scan
    data, known = scan.data, dict(scan.known)
    known.setdefault("frame_numbers", np.arange(scan.n_frames))
    known |= {name: known[name][numbers] for name in PER_FRAME & set(known)}
    shape = (len(numbers), *data.shape[1:])
    some = LazyFrames(shape, data.dtype, lambda chosen: np.asarray(data[numbers[chosen]]))
    return replace(scan, data=some, known=known)


def blank_frames(scan: Scan, rows: Sequence[int]) -> Bool[np.ndarray, " frames"]:
    """Which of several frames hold NaN or infinity in these rows; a single one is kept."""
    if scan.n_frames == 1 or scan.data.dtype.kind != "f":
        return np.zeros(scan.n_frames, bool)
    frames = (scan.frame(k)[list(rows)] for k in range(scan.n_frames))
    return np.array([not np.isfinite(frame).all() for frame in frames])


def frame_numbers(scan: Scan) -> Int[np.ndarray, " frames"]:
    """Numbers of the frames in the file, from 0."""
    return np.asarray(scan.known.get("frame_numbers", np.arange(scan.n_frames)), int)


def in_space(scan: Scan) -> bool:
    """Whether detectors have three coordinates and lie in none of the coordinate planes."""
    points = scan.known.get("detectors")
    if points is None or points.shape[1] != 3:
        return False
    spread = np.ptp(points, axis=0)
    return bool(spread.min() > FLAT * spread.max())


def _require_curve(points: Float[np.ndarray, "detectors 2"]) -> None:
    """Raise ValueError for detectors that fill an area: on a curve few have a third neighbour."""
    distances = np.linalg.norm(points[:, None] - points, axis=-1)
    nearest = np.sort(distances, axis=1)[:, 1:]
    if np.median((nearest < NEIGHBOURS * nearest[:, :1]).sum(axis=1)) > 2:
        raise ValueError(
            f"the {len(points)} detectors lie in a plane and fill an area of it: expected those "
            "of a curve in the plane, or for volumes detectors that surround the object, on a cup "
            "or a sphere."
        )


def rows_used(scan: Scan, use: Any) -> Int[np.ndarray, " used"]:
    """Rows of the data to use, each at most once; all if none are given.

    Raises:
        ValueError: for anything but numbers of rows, and rows that the data do not have.
    """
    if use is None:
        return np.arange(scan.n_detectors)
    return _numbers("use", use, "rows", scan.n_detectors)


def _numbers(name: str, values: Any, what: str, n: int) -> Int[np.ndarray, " some"]:
    numbers = np.asarray(values)
    if numbers.ndim != 1 or not numbers.size or not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError(
            f"{name} has dtype {numbers.dtype} and shape {numbers.shape}, expected whole numbers, "
            "one at least."
        )
    bad = numbers[(numbers < 0) | (numbers >= n)]
    if bad.size:
        raise ValueError(f"{name} holds {bad[0]}, but the data have {what} 0 to {n - 1}.")
    if len(np.unique(numbers)) < len(numbers):
        raise ValueError(f"{name} holds a number more than once.")
    return numbers


def facts_of(scan: Scan, use: Any = None) -> Facts:
    """Geometry and times of a scan.

    Args:
        scan: with positions, and with times or a sampling rate if it is of pressure.
        use: rows of the data to use, in any order, (used,); all by default.

    Raises:
        ValueError: for detectors around a volume, and if something is missing or does not fit, see
            `rows_used` and `order_along_curve`.
    """
    if "detectors" not in scan.known:
        raise ValueError(
            "no detector positions: give --arc, --ring or --scanner (in Python detectors or "
            "scanner), or name them in the file."
        )
    if in_space(scan):
        raise ValueError(
            "the detectors surround a volume, and plans, reports and the settings of an image in "
            "the plane are not for volumes: use jaxtat reconstruct without them, and without "
            "options that ask for a plan (in Python scans.reconstruct)."
        )
    points, rows = np.asarray(in_plane(scan.known["detectors"])), rows_used(scan, use)
    if len(rows) < FEWEST:
        raise ValueError(
            f"{len(rows)} detectors, expected at least {FEWEST}: is the record "
            "(detectors, samples)?"
        )
    if scan.known["detectors"].shape[1] == 3:
        _require_curve(points[rows])
    order = rows[order_along_curve(points[rows])]
    times = times_of(scan)
    arc = arc_through(points[order])
    size = arc.radius if arc else float(np.linalg.norm(np.ptp(points[order], axis=0))) / 2
    return Facts(
        points,
        order,
        arc,
        times,
        units_of(size, times),
        scan.known["detectors"].shape[1] == 3,
    )


def begin_behind_gap(
    order: Int[np.ndarray, " used"], points: Float[np.ndarray, "detectors 2"], good: np.ndarray
) -> int:
    """Index at which a ring without its bad detectors begins: behind the gap they leave."""
    kept = np.flatnonzero(good)
    steps = np.linalg.norm(
        np.diff(points[order[kept]], axis=0, append=points[order[kept[:1]]]), axis=1
    )
    wide = behind_gap(steps, True)
    return int(kept[(int(np.argmax(wide * steps)) + 1) % len(kept)]) if wide.any() else 0


def units_of(radius: float, times: np.ndarray | None) -> Units:
    """Units, guessed by the radius of the detectors and the sampling rate if there is one.

    Args:
        radius: or half the extent of detectors on no circle [length].
        times: of a record [time].

    >>> units_of(0.04, np.arange(9) / 4e7), units_of(0.04, None), units_of(1.3, None)
    (Units(length='m', time='s'), Units(length='m', time=None), Units(length=None, time=None))
    """
    if times is None:
        least, greatest = IN_METRES
        return Units("m") if least <= radius <= greatest else Units()
    rate = 1 / float(times[1] - times[0])
    for length, least, greatest in LENGTHS:
        for time, slowest, fastest in TIMES:
            unlikely = (length, time) == ("m", "us")
            if least <= radius <= greatest and slowest <= rate <= fastest and not unlikely:
                return Units(length, time)
    return Units()


def nominal_water_speed(units: Units) -> float | None:
    """The nominal speed of sound in water, in the scan's units; None if they are not known.

    >>> nominal_water_speed(Units("mm", "us")), nominal_water_speed(Units())
    (1.5, None)
    """
    if units.length is None or units.time is None:
        return None
    return WATER * 1e-3 * MICROSECONDS[units.time] / MILLIMETRES[units.length]


def times_of(scan: Scan) -> Float[np.ndarray, " times"] | None:
    """Sample times of a pressure record, by themselves or by the sampling rate."""
    if scan.kind != "pressure":
        return None
    if scan.n_samples < SHORTEST:
        raise ValueError(
            f"the record has {scan.n_samples} samples, expected at least {SHORTEST}: is it "
            "(detectors, samples)?"
        )
    if "times" in scan.known:
        times = np.asarray(scan.known["times"], float)
    elif "sampling_rate" in scan.known:
        times = np.arange(scan.n_samples) / float(scan.known["sampling_rate"])
    else:
        raise ValueError(
            "no sample times: give --sampling-rate or --duration (in Python sampling_rate or "
            "times), or name times in the file."
        )
    require_equispaced(real_array("times", times, ("times",)))
    return times


def typical_frame(scan: Scan) -> Float[np.ndarray, "detectors samples"]:
    """The frame of median power, out of up to five that are evenly chosen.

    Those count that have the fewest detectors with NaN.
    """
    numbers = np.unique(np.linspace(0, scan.n_frames - 1, 5).round().astype(int))
    frames = [np.asarray(scan.frame(int(k)), float) for k in numbers]
    blank = [int((~np.isfinite(frame)).any(axis=1).sum()) for frame in frames]
    frames = [frame for frame, n in zip(frames, blank, strict=True) if n == min(blank)]
    heard = [frame[np.isfinite(frame)] for frame in frames]
    power = [float(np.var(values)) if values.size else 0.0 for values in heard]
    return frames[int(np.argsort(power)[len(power) // 2])]


def arc_through(points: Float[np.ndarray, "detectors 2"]) -> ArcFit | None:
    """Circle and arc of detectors in order along it; None of those on no circle."""
    try:
        arc = fit_arc(points)
    except ValueError:  # a straight line
        return None
    return arc if arc.deviation < ROUND * arc.radius else None
