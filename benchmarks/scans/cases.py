"""Which scans there are: arrays, bodies, acoustics and dirt, combined by a seed; and their files.

The truth of a scan is made again from its case: files hold what a scanner would have written.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import acoustics
import dirt
import numpy as np
from arrays import ARRAYS, Array
from bodies import BODIES, Body, balls

N = 48  # of each seed
# by the number of the first scan
SEEDS = {
    0: 18,
    100: 2026,
    200: 2027,
    300: 2028,
    400: 2029,
    500: 2030,
    600: 2031,
    700: 2032,
    800: 2033,
    900: 2034,
    1000: 2035,
    1100: 2036,
    1200: 2037,
    1300: 2038,
    1400: 2039,
    1500: 2040,
    1600: 2041,
    1700: 2042,
    1800: 2043,
}
HELD_OUT = 900  # from there on: rules are made on the others, these tell how good they are
HALVES = ("rules", "held-out")
SPEEDS = ("unsaid", "one", "two", "two-water-given")  # of sound, that are looked for
HARDER = 1000  # from there on with more of what scanners do, see `_harder`
LATE, WRONG = 2e-6, 0.005  # s that a record starts late or early, and radius of an array, at most
RATE, SAMPLES = 40e6, 2030  # of a scanner
LOUDER = 0.12  # of the sound: root mean square of what comes from out of the plane


@dataclass(frozen=True)
class Size:
    """Share of a scanner's detectors and samples, and the width of edges that goes with it [m]."""

    share: float
    edge: float


SIZES = {"full": Size(1.0, 1.2e-4), "quick": Size(0.3, 4e-4)}


@dataclass(frozen=True)
class Case:
    """One scan.

    Attributes:
        number: from 0.
        array, body: names in `ARRAYS` and `BODIES`.
        model: "in-plane", "2d" or "in-space".
        speed: of sound in the body [m/s].
        water: of sound around it; the same, but for a few [m/s].
        noise: over the sound.
        dirt: names, see `record`.
        start: time of the first sample, of which the file does not know [s].
        stretch: of the array in the file over the true one.
    """

    number: int
    array: str
    body: str
    model: str
    speed: float
    water: float
    noise: float
    dirt: tuple[str, ...]
    start: float = 0.0
    stretch: float = 1.0

    @property
    def name(self) -> str:
        return f"{self.number:02d}-{self.array}-{self.body}"

    @property
    def half(self) -> str:
        return HALVES[self.number >= HELD_OUT]

    def generator(self, what: str) -> np.random.Generator:
        seed = SEEDS[self.number // 100 * 100]
        return np.random.default_rng([seed, self.number, *what.encode()])


def cases() -> list[Case]:
    """All of them."""
    first, *others = ([_case(seed, start + k) for k in range(N)] for start, seed in SEEDS.items())
    return [*first, *K_WAVE, *(case for more in others for case in more)]


# waves in the plane through a body and water, of one speed in two, by another code: `two_speeds.py`
K_WAVE = [
    Case(N, "arc270", "vessels", "2d", 1540.0, 1500.0, 0.01, ("k-wave",)),
    Case(N + 1, "arc270", "mouse", "2d", 1560.0, 1490.0, 0.03, ("k-wave",)),
    Case(N + 2, "ring", "off-middle", "2d", 1550.0, 1510.0, 0.03, ("k-wave",)),
    Case(N + 3, "arc180", "derenzo", "2d", 1580.0, 1500.0, 0.01, ("k-wave",)),
    Case(HELD_OUT + N, "ring", "vessels", "2d", 1530.0, 1490.0, 0.03, ("k-wave",)),
    Case(HELD_OUT + N + 1, "arc270", "derenzo", "2d", 1450.0, 1500.0, 0.01, ("k-wave",)),
    Case(HELD_OUT + N + 2, "arc270", "mouse", "2d", 1555.0, 1505.0, 0.03, ("k-wave",)),
    Case(HELD_OUT + N + 3, "arc180", "vessels", "2d", 1560.0, 1500.0, 0.01, ("k-wave",)),
    Case(HELD_OUT + N + 4, "arc270", "mouse", "2d", 1500.0, 1500.0, 0.03, ("k-wave",)),
    Case(HELD_OUT + N + 5, "ring", "off-middle", "2d", 1510.0, 1510.0, 0.03, ("k-wave",)),
]


def simulated_by_k_wave(case: Case, folder: Path) -> Path:
    return folder / "k-wave" / f"{case.name}.npy"


def _case(seed: int, number: int) -> Case:
    rng = np.random.default_rng([seed, number])
    array = list(ARRAYS)[number % len(ARRAYS)]
    speed = float(rng.uniform(1440, 1620))
    noise = float(rng.choice([0.0, 0.01, 0.03, 0.1, 0.2]))
    if array == "cap":
        return Case(number, array, "balls", "in-space", speed, speed, noise, ("float",))
    body = str(rng.choice(list(BODIES)))
    model = "2d" if rng.uniform() < 0.12 else "in-plane"
    names = [] if model == "2d" else _dirt(rng)
    mixed = model == "in-plane" and rng.uniform() < 0.2
    water = speed - rng.uniform(20, 60) if mixed else speed
    names += [name for name, share in (("shuffled", 0.2), ("early", 0.08)) if rng.uniform() < share]
    case = Case(number, array, body, model, speed, float(water), noise, tuple(names))
    return _harder(seed, case) if number >= HARDER else case


def _harder(seed: int, case: Case) -> Case:
    """The same with, in some, another start, radius, silence of zeros, elements that differ."""
    rng = np.random.default_rng([seed, case.number, *b"harder"])
    names, start, stretch = list(case.dirt), 0.0, 1.0
    if rng.uniform() < 1 / 3:
        start = float(rng.uniform(-LATE, LATE))
        names.append(f"start {1e6 * start:+.2f} us")
    if rng.uniform() < 0.3:
        stretch = float(rng.uniform(1 - WRONG, 1 + WRONG))
        names.append(f"radius {100 * (stretch - 1):+.2f} %")
    if rng.uniform() < 0.25:
        names.append("silent")
    if rng.uniform() < 0.25 and not {"band", "band-known"} & set(names):
        names.append("elements")
    return replace(case, dirt=tuple(names), start=start, stretch=stretch)


def _dirt(rng: np.random.Generator) -> list[str]:
    chances = {
        "counts": 0.6,
        "plane": 0.4,
        "artefact": 0.3,
        "bad": 0.25,
        "coloured": 0.4,
        "out-of-plane": 0.3,
        "mirror": 0.15,
        "wall": 0.2,
        "muted": 0.12,
        "frames": 0.1,
    }
    names = [name for name, chance in chances.items() if rng.uniform() < chance]
    return names + [[], [], ["band"], ["band-known"]][int(rng.integers(4))]


def geometry(case: Case, size: Size) -> Array:
    return ARRAYS[case.array](size.share if case.array != "cap" else 1.0)


def truth(case: Case, size: Size) -> Body:
    """What sounds."""
    make = balls if case.body == "balls" else BODIES[case.body]
    return make(case.generator("body"), size.edge)


def write(case: Case, size: Size, folder: Path) -> Path:
    """The scan's file, with nothing in it but what it recorded, where and how fast."""
    array, rate = geometry(case, size), RATE * size.share
    if "k-wave" in case.dirt:
        pressure, response = np.load(simulated_by_k_wave(case, folder)), np.ones(1)
    else:
        pressure, response = record(case, size)
    positions = case.stretch * array.positions
    if case.model == "2d" or "plane" in case.dirt:
        positions = positions[:, :2]
    order = np.arange(len(positions))
    if "shuffled" in case.dirt:
        order = case.generator("order").permutation(order)
    facts = {"detectors": positions[order], "sampling_rate": rate}
    if "band-known" in case.dirt:
        facts["impulse_response"] = response
    frames = list(_frames(case, pressure, rate))
    if len(frames) > 1:
        facts["wavelengths"] = 700.0 + 20.0 * np.arange(len(frames))
    path = folder / f"{case.name}.npz"
    data = np.stack(frames)[:, order]
    np.savez(path, pressure=data if len(frames) > 1 else data[0], **facts)
    return path


def _frames(case: Case, pressure: np.ndarray, rate: float) -> Iterator[np.ndarray]:
    rng = case.generator("frames")
    strengths = (0.6, 1.0, 0.4) if "frames" in case.dirt else (1.0,)
    for strength in strengths:
        frame = dirt.noise(rng, strength * pressure, case.noise / strength, _colour(case))
        yield _as_written(case, frame, pressure, rate, rng)


def _colour(case: Case) -> str:
    return "coloured" if "coloured" in case.dirt else "white"


def _as_written(
    case: Case, frame: np.ndarray, pressure: np.ndarray, rate: float, rng: np.random.Generator
) -> np.ndarray:
    if "artefact" in case.dirt:
        frame = dirt.artefact(frame, rate, 20.0, late(case, rate))
    if "silent" in case.dirt:
        frame = dirt.silent(frame, pressure)
    if "bad" in case.dirt:
        frame = dirt.bad_channels(case.generator("bad"), frame, 0.05)
    if "counts" in case.dirt:
        frame = dirt.counts(rng, frame, level="silent" in case.dirt).copy()
    if "muted" in case.dirt:
        first = int(0.55 * ARRAYS[case.array](0.1).radius / case.water * rate) - late(case, rate)
        frame = frame.copy()
        frame[:, :first] = 32768 if "counts" in case.dirt else 0
    if "early" in case.dirt:
        frame = frame[:, : int(0.62 * frame.shape[1])]
    return frame


def late(case: Case, rate: float) -> int:
    """Whole samples that a record starts late."""
    return round(case.start * rate)


def record(case: Case, size: Size) -> tuple[np.ndarray, np.ndarray]:
    """Exact pressure (detectors, samples) without noise, and the response of the elements."""
    n, first = int(SAMPLES * size.share), late(case, RATE * size.share)
    found, pulse = _sound(case, size, n + max(first, 0))
    return dirt.starting(found, first, n), pulse


def _sound(case: Case, size: Size, n: int) -> tuple[np.ndarray, np.ndarray]:
    """That of n samples from the time 0."""
    array, body, rate = geometry(case, size), truth(case, size), RATE * size.share
    step = case.water / rate
    points, rng = array.positions, case.generator("sound")
    pulse = dirt.response(rate, 3.5e6 * size.share, rng.uniform(0.9, 1.4))
    if case.model == "in-space":
        return acoustics.in_space(body, points, n, step), pulse
    if case.model == "2d":
        return acoustics.two_dimensional(body, points, n, step), pulse
    detour = None
    if case.water != case.speed:
        detour = acoustics.straight_rays(body, case.speed, case.water)
    found = acoustics.in_plane(body, points, n, step, detour)
    power = np.mean(found**2)
    if "out-of-plane" in case.dirt:
        other = acoustics.in_space(acoustics.out_of_plane(rng, body), points, n, step)
        found = found + LOUDER * np.sqrt(power / np.mean(other**2)) * other
    if "mirror" in case.dirt:
        wall = acoustics.mirrored(body, rng.uniform(0, 2 * np.pi), rng.uniform(20e-3, 40e-3), 0.3)
        found = found + acoustics.in_plane(wall, points, n, step)
    if "wall" in case.dirt:
        where = rng.uniform(0, 2 * np.pi), rng.uniform(20e-3, 28e-3)
        wall = acoustics.sounding_wall(*where, size.edge, 0.15)
        found = found + acoustics.in_plane(wall, points, n, step)
    if {"band", "band-known"} & set(case.dirt):
        found = dirt.heard_by(found, pulse)
    if "elements" in case.dirt:
        found = dirt.heard_by_each(case.generator("elements"), found, rate, 3.5e6 * size.share)
    return found, pulse
