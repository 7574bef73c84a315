"""Extent of the source of a record, from the onset and end times of sound at the detectors.

Detector k records a body of radius a about m from (|y_k - m| - a)/c to (|y_k - m| + a)/c. Half the
time between is a/c, which depends little on an error of c. The first times alone would give a wrong
size if c is wrong, and on a short arc they do not determine the position across.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .signal_power import RecordPower

BEGINS, CEASES = 0.02, 0.05  # share of a detector's highest power that counts as sound
QUIETEST, QUIET = 0.05, 0.25  # shares of a record, from which noise and its scatter are taken
ABOVE_NOISE, ABOVE_SCATTER = 2.0, 4.0  # times the quiet power, and times its scatter over that
CLEARLY = 0.5  # of the highest power, below which the least that counts has to be
NEIGHBOURS, AT_MOST = 60, 8  # detectors over those to each side, with which one is averaged
# priors of the disk, over the radius on which the detectors lie
OFF_MIDDLE, DEVIATION, SPEEDS = 0.2, 0.02, 0.03
INDEPENDENT = 10  # detectors with independent errors; neighbours err alike
STEPS = 60
# of areas, see `sounding_place`: over the detectors' radius; points across; shares of detectors
RIM, ACROSS = 0.95, 51
FEWEST, MOST = 0.2, 0.7  # whose record covers a point at all; that record sound from it, of those
STANDS_OUT = 0.6  # of all points from which sound comes, the share in the largest area
BESIDE = 0.12  # over the detectors' radius: width of the surroundings of an area


class Heard(NamedTuple):
    """Onset and end times of sound at the detectors.

    Attributes:
        first, last: (detectors,) [time].
        begins, ceases: whether these are known: the record is quiet before the one and after
            the other.

    `tells` is whether one of the two is known for most detectors.
    """

    first: Float[np.ndarray, " detectors"]
    last: Float[np.ndarray, " detectors"]
    begins: Bool[np.ndarray, " detectors"]
    ceases: Bool[np.ndarray, " detectors"]

    @property
    def tells(self) -> bool:
        return bool(max(self.begins.mean(), self.ceases.mean()) > 0.5)


Within = Bool[np.ndarray, "detectors pieces"]


def heard(power: RecordPower, pause: float, within: Within | None = None) -> Heard:
    """Onset and end time at each detector: above its noise, and a share of its highest power.

    Fainter sound from holders, membranes and walls is ignored. Pauses divide the sound into parts,
    and parts after a pause are echoes: the last time is the end of the part with the largest total
    power.

    Args:
        power: in order along the curve, since neighbours are averaged.
        pause: the shortest that separates an echo [time].
        within: pieces whose sound counts; all by default.

    >>> times = np.arange(100.0)
    >>> power = np.where(abs(times - 40) < 10, 1.0, 1e-3) * np.ones((5, 1))
    >>> when = heard(RecordPower(times, power), 5.0)
    >>> float(when.first[0]), float(when.last[0]), bool(when.begins.all())
    (31.0, 49.0, True)
    """
    values = _with_neighbours(power.power)
    counted = values if within is None else np.where(within, values, 0.0)
    highest, least = counted.max(axis=1), _least(values, counted)
    first = np.argmax(counted > least[0][:, None], axis=1)
    pieces = int(np.ceil(pause / (power.times[1] - power.times[0])))
    last = np.array([_end_of_loudest(*of, pieces) for of in zip(counted, least[1], strict=True)])
    sounds = least[1] < CLEARLY * highest  # not the highest of the noise alone
    return Heard(
        power.times[first],
        power.times[last],
        sounds & (first > 0),
        sounds & (last < len(power.times) - 1),
    )


def _least(values: np.ndarray, counted: np.ndarray) -> list[Float[np.ndarray, " detectors"]]:
    """The least power that counts as sound, for onset and for end times.

    Args:
        values: of all pieces, among them quiet ones.
        counted: of the pieces whose sound counts, zero in others.
    """
    highest = counted.max(axis=1)
    quietest, quiet = np.quantile(values, [QUIETEST, QUIET], axis=1)
    noise = np.maximum(ABOVE_NOISE * quiet, quiet + ABOVE_SCATTER * (quiet - quietest))
    return [np.maximum(noise, quiet + share * highest) for share in (BEGINS, CEASES)]


def _end_of_loudest(values: Float[np.ndarray, " pieces"], least: float, pause: int) -> int:
    """Number of the last window in the part between pauses that has the largest total power."""
    sounds = np.flatnonzero(values > least)
    if not len(sounds):
        return len(values) - 1
    parts = np.split(sounds, np.flatnonzero(np.diff(sounds) > pause) + 1)
    return int(max(parts, key=lambda part: values[part].sum())[-1])


def _with_neighbours(
    power: Float[np.ndarray, "detectors pieces"],
) -> Float[np.ndarray, "detectors pieces"]:
    each = min(max(1, len(power) // NEIGHBOURS), AT_MOST)
    sums = np.cumsum(np.pad(power, ((each + 1, each), (0, 0)), mode="edge"), axis=0)
    return (sums[2 * each + 1 :] - sums[: -2 * each - 1]) / (2 * each + 1)


def sounding_place(
    points: Float[np.ndarray, "detectors 2"], power: RecordPower, speed: float
) -> Float[np.ndarray, "places 2"] | None:
    """The largest area from which sound reaches most detectors; None if it does not stand out.

    A point x counts if, of the detectors whose record covers the time |y_k - x|/c, 70 % record
    sound then. That is so in a body and in a wall, but hardly elsewhere. Of several areas a wall
    may be the strongest; the largest is taken for the body.

    Args:
        points: y_k, from the middle of the array [length].
        power: in order along the curve.
        speed: c [length/time].

    Returns:
        Its points, on a grid [length].

    >>> theta = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
    >>> y = 40 * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    >>> times, d = np.arange(0.0, 80.0), np.linalg.norm(y - [5.0, 2.0], axis=1)
    >>> area = sounding_place(y, RecordPower(times, 1.0 * (abs(times - d[:, None]) < 9)), 1.0)
    >>> area.mean(axis=0).round().tolist()
    [5.0, 2.0]
    """
    from scipy.ndimage import label  # slow to import

    values = _with_neighbours(power.power)
    sounds = values > _least(values, values)[0][:, None]
    size = float(np.median(np.linalg.norm(points, axis=1)))
    line = np.linspace(-RIM * size, RIM * size, ACROSS)
    where = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)
    step, n = power.times[1] - power.times[0], len(power.times)
    hear, can = np.zeros(where.shape[:2]), np.zeros(where.shape[:2])
    for point, own in zip(points, sounds, strict=True):
        arrival = np.linalg.norm(where - point, axis=-1) / speed
        piece = np.rint((arrival - power.times[0]) / step).astype(int)
        recorded = (piece >= 0) & (piece < n)
        can += recorded
        hear += recorded & own[np.clip(piece, 0, n - 1)]
    judged = (np.linalg.norm(where, axis=-1) < RIM * size) & (can > FEWEST * len(points))
    places = np.zeros(judged.shape, int)
    label(judged & (hear > MOST * can), np.ones((3, 3)), output=places)
    sizes = np.bincount(places.ravel(), minlength=2)[1:]
    if sizes.max() == 0 or sizes.max() < STANDS_OUT * sizes.sum():
        return None
    return where[places == 1 + np.argmax(sizes)]


def arriving_from(
    place: Float[np.ndarray, "places 2"],
    points: Float[np.ndarray, "detectors 2"],
    times: Float[np.ndarray, " pieces"],
    speed: float,
) -> Within:
    """Which windows of a record can hold sound from an area or its surroundings.

    Args:
        place: from `sounding_place`.
        points, speed: as there.
        times: of the pieces.
    """
    distances = np.linalg.norm(points[:, None] - place, axis=-1)
    beside = BESIDE * float(np.median(np.linalg.norm(points, axis=1)))
    nearest, farthest = distances.min(axis=1) - beside, distances.max(axis=1) + beside
    return (speed * times >= nearest[:, None]) & (speed * times <= farthest[:, None])


class SoundingDisk(NamedTuple):
    """The disk, or ball, that holds the source of the sound.

    Attributes:
        middle, radius: [length].
        speed: fitted, over the assumed one.
        deviation: median distance by which onset and end times deviate from it [length].
    """

    middle: Float[np.ndarray, " space"]
    radius: float
    speed: float
    deviation: float

    @property
    def reach(self) -> float:
        """The distance from the array's middle within which it lies."""
        return self.radius + float(np.linalg.norm(self.middle))


def sounding_disk(
    points: Float[np.ndarray, "detectors space"],
    when: Heard,
    speed: float,
    speed_known: bool,
) -> SoundingDisk:
    """The disk |x - m| < a that fits |y_k - m| ∓ a = s c t to the first and last times t.

    The sum of absolute differences is minimised, so that up to half of the detectors may record
    something else, such as a holder or an echo. Priors keep the middle within about a fifth of the
    detectors' radius of the origin, and s within about 3 % of 1: on short arcs a nearer body and a
    faster sound have almost the same times.

    Args:
        points: y_k, from the middle of the array [length].
        when: from `heard`.
        speed: c [length/time].
        speed_known: s is 1.

    >>> theta = np.linspace(0.0, 2.0, 60)
    >>> y = 40 * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    >>> d, told = np.linalg.norm(y - [5.0, 2.0], axis=1), np.ones(60, bool)
    >>> first = d - 9.0
    >>> first[::4] = 20.0  # a quarter of the detectors
    >>> disk = sounding_disk(y, Heard(first, d + 9.0, told, told), 1.0, True)
    >>> disk.middle.round(1).tolist(), round(disk.radius, 1), disk.speed
    ([5.0, 2.0], 9.0, 1.0)
    """
    size, n = float(np.median(np.linalg.norm(points, axis=1))), len(points)
    points, first, last = points / size, speed / size * when.first, speed / size * when.last
    told = np.concatenate([when.begins, when.ceases]) * (INDEPENDENT / n)
    supposed = np.full(points.shape[1] + 2, 1 / OFF_MIDDLE**2)
    supposed[-2:] = 0.0, 1 / SPEEDS**2
    fit = np.zeros(len(supposed))  # middle, radius, s - 1
    fit[-2] = max(float(np.median(last - first)) / 2, DEVIATION)
    one, stretched = np.ones(n), 0.0 if speed_known else 1.0
    for _ in range(STEPS):  # weighted least squares with weights 1/|difference|, linearised
        away, difference = _differences(points, first, last, fit)
        slopes = np.concatenate(
            [
                np.column_stack([away, -one, -stretched * first]),
                np.column_stack([away, one, -stretched * last]),
            ]
        )
        weights = told / (DEVIATION * (np.abs(difference) + DEVIATION / 4))
        system = slopes.T @ (weights[:, None] * slopes) + np.diag(supposed)
        fit -= np.linalg.lstsq(system, slopes.T @ (weights * difference) + supposed * fit)[0]
    left = np.abs(_differences(points, first, last, fit)[1])[told > 0]
    deviation = float(np.median(left)) if len(left) else 0.0
    fit[:-1] *= size
    return SoundingDisk(fit[:-2], max(float(fit[-2]), 0.0), float(1 + fit[-1]), size * deviation)


def _differences(
    points: np.ndarray, first: np.ndarray, last: np.ndarray, fit: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Directions from the detectors to m, and |y - m| ∓ a - s c t for onset and end times."""
    offset = points - fit[:-2]
    distance = np.linalg.norm(offset, axis=1)
    near, far = distance - fit[-2], distance + fit[-2]
    difference = np.concatenate([near, far]) - (1 + fit[-1]) * np.concatenate([first, last])
    return -offset / distance[:, None], difference
