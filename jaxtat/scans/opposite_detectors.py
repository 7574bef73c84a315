"""The speed of sound at which opposite detectors agree, in space.

A wave front that runs towards one detector runs away from the one opposite. Back-projected at the
true speed, they lie on each other with the same sign where the record is filtered evenly in time,
and with opposite signs where its Hilbert transform is. So of Z(x) = Σ_k w_k b_k(|x - y_k|/c), b the
filtered record as an analytic signal, the real part adds up and the imaginary one cancels:

    M(c) = Re ∫ Z² dx / ∫ |Z|² dx,

1 for perfect agreement and about 0 for noise, has its peak there. b = t d³p/dt³ has two derivatives
more than the term -2 t dp/dt of Xu and Wang, since to long waves the detectors are not far away:
these displace the peak, by 1/(kR)² of the speed, mean over the spectrum of b. That is taken off; it
was found on simulated records, which it fits to a fifth.

Source of the back-projection: Xu, Wang, Phys. Rev. E 71 (2005) 016706.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from ..base.size_ladder import filled_up, rung
from ..geometry import DetectorPoints
from ..io import Scan
from .acquisition import FASTEST, SLOWEST, times_of, typical_frame
from .choices import Choices
from .estimate import Estimate
from .frames import conditioned
from .space import facts_in_space
from .speed_found import believed, jackknife, summit, unknown

SPEEDS = np.linspace(SLOWEST, FASTEST, 15)
AGREE = 0.3  # M at the peak, at least
FITS = 0.2  # of what displaces the peak, to which that is known
SECTORS = 6  # of azimuths, each of which is left out in turn
LISTENED = 700  # detectors, at most
SHARPER = 1.5  # times the image's highest frequency, up to which the record is heard
ACROSS = 25  # points along the region's diameter, at which they agree or not


def agreement(scan: Scan, choices: Choices) -> float:
    """How far opposite detectors agree at the speed of the choices: M, 1 at most.

    Args:
        scan, choices: in space, of pressure; of a typical frame.
    """
    return _agreements(_filtered_record(scan, choices), choices.sound_speed)[0]


def speed_in_space(scan: Scan, choices: Choices) -> Estimate:
    """The speed over that of the choices at which opposite detectors agree best.

    Args:
        scan, choices: in space, of pressure; of a typical frame.

    Returns:
        With M as ``agreement`` in its data, where that is enough.
    """
    record, assumed = _filtered_record(scan, choices), choices.sound_speed

    def agreement_at(speeds: np.ndarray) -> np.ndarray:
        return np.array([_agreements(record, speed) for speed in assumed * speeds])

    coarse = agreement_at(SPEEDS)[:, 0]
    best = int(np.argmax(coarse[1:-1])) + 1
    near = np.linspace(SPEEDS[best - 1], SPEEDS[best + 1], 9)
    found = agreement_at(near)
    most = float(found[:, 0].max())
    if most < AGREE:
        return unknown(f"opposite detectors agree at no other within 10 %, to {most:.0%} at most")
    agreed = {"agreement": most}
    displaced = record.displaced(assumed)
    speed = summit(near, found[:, 0]) / (1 + displaced)
    scatter = jackknife([summit(near, without) for without in found[:, 1:].T])
    error = float(np.hypot(scatter, FITS * displaced * speed))
    why = f"opposite detectors agree best, to {most:.0%}; none in the file"
    return believed(speed, error, why, "detectors")._replace(data=agreed)


class _Record(NamedTuple):
    """Some of the detectors' records b_k, with the areas that they stand for, and where they meet.

    Attributes:
        points: y_k from the middle, (detectors, 2 or 3) [length].
        filtered: analytic signals, (detectors, times).
        times: (times,) [time].
        sector: of azimuths, in which a detector lies, (detectors,).
        where: x from the middle, (points, 3) [length].
    """

    points: Float[np.ndarray, "detectors space"]
    filtered: Complex[np.ndarray, "detectors times"]
    times: Float[np.ndarray, " times"]
    sector: Int[np.ndarray, " detectors"]
    where: Float[np.ndarray, "points space"]

    def displaced(self, speed: float) -> float:
        """Mean of 1/(kR)² over the spectrum."""
        power = np.sum(np.abs(np.fft.fft(self.filtered, axis=1)) ** 2, axis=0)
        k = 2 * np.pi * np.fft.fftfreq(len(self.times), self.times[1] - self.times[0]) / speed
        radius = float(np.median(np.linalg.norm(self.points, axis=1)))
        return float(np.sum(power[k > 0] / (k[k > 0] * radius) ** 2) / np.sum(power[k > 0]))


def _filtered_record(scan: Scan, choices: Choices) -> _Record:
    facts, times = facts_in_space(scan, choices.channels), times_of(scan)
    assert times is not None
    some = slice(None, None, -(-len(facts.order) // LISTENED))
    rows = list(choices.channels)
    points = np.asarray(scan.known["detectors"], float)[rows][some]
    points = points - np.array(choices.region_center)
    record = jnp.asarray(typical_frame(scan)[rows])  # all of them: each may have a response
    record = conditioned(scan, choices, record, times, baseline=False)[some]
    highest = SHARPER * choices.max_frequency * choices.sound_speed / (2 * np.pi)
    filtered = _filtered(np.asarray(record), times, highest) * _weights(facts.detectors)[some, None]
    line = np.linspace(-choices.region_radius, choices.region_radius, ACROSS)
    where = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    where = where[np.linalg.norm(where, axis=1) < choices.region_radius]
    return _Record(points, filtered, times, _sectors(points), where)


def _agreements(record: _Record, speed: float) -> list[float]:
    """M of all detectors, then without each of the sectors."""
    points, filtered, times, sector, where = record
    n, m = rung(len(points)), rung(len(where))  # detectors without a signal, and points
    arrays = (
        filled_up(where, (m, where.shape[1])),
        filled_up(points, (n, points.shape[1])),
        filled_up(filtered, (n, rung(len(times)))),
        filled_up(sector, (n,)),
    )
    found = _back_projected(*arrays, times[:2], np.int64(len(times)), np.float64(speed))
    of_sectors = np.asarray(found)[:, : len(where)]
    whole = of_sectors.sum(axis=0)
    return [_agreement(whole - left) for left in (0.0, *of_sectors)]


def _agreement(z: np.ndarray) -> float:
    return float(np.sum(z**2).real / max(np.sum(np.abs(z) ** 2), 1e-300))


def _sectors(points: Float[np.ndarray, "detectors space"]) -> Int[np.ndarray, " detectors"]:
    azimuth = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) + 0.5
    return np.minimum((SECTORS * azimuth).astype(int), SECTORS - 1)


def _weights(detectors: object) -> Float[np.ndarray, " detectors"]:
    """Areas of the detectors of rings; equal ones for points."""
    if isinstance(detectors, DetectorPoints):
        return np.ones(len(detectors.points))
    weights = np.asarray(detectors.weights)  # type: ignore[attr-defined]
    return np.broadcast_to(weights.reshape(len(weights), -1), detectors.shape).ravel()  # type: ignore[attr-defined]


def _filtered(
    record: Float[np.ndarray, "detectors times"], times: np.ndarray, highest: float
) -> Complex[np.ndarray, "detectors times"]:
    """t d³p/dt³ as an analytic signal, up to a frequency [cycles/time]."""
    n, step = record.shape[1], times[1] - times[0]
    f = np.fft.fftfreq(2 * n, step)
    passed = np.where((f > 0) & (f < highest), 1 + np.cos(np.pi * f / highest), 0.0)
    spectrum = np.fft.fft(record - np.median(record, axis=1, keepdims=True), 2 * n)
    return times * np.fft.ifft(spectrum * passed * (2j * np.pi * f) ** 3)[:, :n]


@jax.jit
def _back_projected(
    where: Float[Array, "points space"],
    detectors: Float[Array, "detectors space"],
    filtered: Complex[Array, "detectors times"],
    sector: Array,
    times: Float[Array, "2"],
    n: Array,
    speed: Array,
) -> Complex[Array, "sectors points"]:
    """Straight lines between the first n samples, nothing beyond them."""

    def add(total: Array, of_detector: tuple[Array, Array, Array]) -> tuple[Array, None]:
        z, values, k = of_detector
        at = (jnp.linalg.norm(where - z, axis=1) / speed - times[0]) / (times[1] - times[0])
        first = jnp.clip(at.astype(int), 0, n - 2)
        between = values[first] + (at - first) * (values[first + 1] - values[first])
        return total.at[k].add(jnp.where((at >= 0) & (at <= n - 1), between, 0.0)), None

    nothing = jnp.zeros((SECTORS, len(where)), complex)
    return jax.lax.scan(add, nothing, (detectors, filtered, sector))[0]
