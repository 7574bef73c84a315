"""What sounds: sums of soft disks, or balls, of which every record is known exactly.

A soft disk of radius a and edge d is a mean of disks of radii a + d s, s in (-1, 1) with weights
(1 - s²)²: its edge rises smoothly over a length 2 d. Everything is exact that is for disks.
"""

from dataclasses import dataclass

import numpy as np

STEP = 1e-4  # between the disks of which a soft one is made, at most [m]


@dataclass(frozen=True)
class Body:
    """Parts, each of a centre, a radius, an edge and an amplitude.

    Attributes:
        centers: (parts, 2 or 3) [m].
        radii, edges: (parts,) [m].
        amplitudes: (parts,).
    """

    centers: np.ndarray
    radii: np.ndarray
    edges: np.ndarray
    amplitudes: np.ndarray

    @property
    def reach(self) -> float:
        """Radius of the disk about the origin that holds it [m]."""
        return float((np.linalg.norm(self.centers, axis=1) + self.radii + self.edges).max())

    @property
    def middle(self) -> np.ndarray:
        """Of the box around all centres [m]."""
        return (self.centers.min(axis=0) + self.centers.max(axis=0)) / 2

    @property
    def extent(self) -> float:
        """Radius of the disk about `middle` that holds it [m]."""
        offset = np.linalg.norm(self.centers - self.middle, axis=1)
        return float((offset + self.radii + self.edges).max())

    def image(self, points: np.ndarray) -> np.ndarray:
        """f at points (..., 2 or 3)."""
        f = np.zeros(points.shape[:-1])
        for center, radius, edge, amplitude in self._parts():
            distance = np.linalg.norm(points - center, axis=-1)
            s = np.clip((distance - radius) / edge, -1, 1)
            f += amplitude * (0.5 - 15 / 16 * (s - 2 / 3 * s**3 + s**5 / 5))
        return f

    def disks(self):
        """Centre, radius and amplitude of every sharp disk, or ball, that it is made of."""
        for center, radius, edge, amplitude in self._parts():
            n = max(8, int(np.ceil(2 * edge / STEP)))
            s, weights = np.polynomial.legendre.leggauss(n)
            weights = weights * (1 - s**2) ** 2
            for part, weight in zip(radius + edge * s, weights / weights.sum(), strict=True):
                if part > 0:
                    yield center, part, amplitude * weight

    def _parts(self):
        return zip(self.centers, self.radii, self.edges, self.amplitudes, strict=True)

    def joined(self, other: "Body") -> "Body":
        pairs = (
            (self.centers, other.centers),
            (self.radii, other.radii),
            (self.edges, other.edges),
            (self.amplitudes, other.amplitudes),
        )
        return Body(*(np.concatenate(pair) for pair in pairs))

    def moved(self, by) -> "Body":
        return Body(self.centers + np.asarray(by), self.radii, self.edges, self.amplitudes)


def body(parts: list[tuple], edge: float) -> Body:
    """Of (centre, radius, amplitude), all with one edge, at most nine tenths of the radius."""
    centers, radii, amplitudes = (np.array(column, float) for column in zip(*parts, strict=True))
    return Body(centers, radii, np.minimum(edge, 0.9 * radii), amplitudes)


def vessels(rng: np.random.Generator, edge: float, size: float = 9e-3) -> Body:
    """Seven bent tubes within a disk, as chains of disks."""
    parts = []
    for _ in range(7):
        place = size * np.sqrt(rng.uniform(0.0, 0.7)) * _direction(rng.uniform(0, 2 * np.pi))
        angle, bend = rng.uniform(0, 2 * np.pi), rng.normal(0, 60.0)
        radius, amplitude = rng.uniform(0.25e-3, 0.7e-3), rng.uniform(0.4, 1.0)
        for _ in range(40):
            parts.append((place.copy(), radius, amplitude / 3))
            angle += bend * radius
            place = place + 0.7 * radius * _direction(angle)
            if np.linalg.norm(place) > size:
                break
    return body(parts, edge)


def mouse(rng: np.random.Generator, edge: float) -> Body:
    """A cross-section with skin, organs, spine and vessels."""
    organs = [((0.0, 0.0), 10.5e-3, 1.0), ((0.0, 0.0), 10.0e-3, -0.8)]
    for x, y, radius, amplitude in (
        (-4e-3, 1e-3, 3e-3, 0.3),
        (4.2e-3, 0.5e-3, 2.8e-3, 0.35),
        (0.3e-3, -5.5e-3, 1.6e-3, 0.5),
        (0.5e-3, 4.5e-3, 2.2e-3, -0.1),
    ):
        at = (x + rng.normal(0, 3e-4), y + rng.normal(0, 3e-4))
        organs.append((at, radius * rng.uniform(0.9, 1.1), amplitude))
    for _ in range(12):
        place = 8.5e-3 * np.sqrt(rng.uniform()) * _direction(rng.uniform(0, 2 * np.pi))
        organs.append((place, rng.uniform(0.2e-3, 0.5e-3), rng.uniform(0.5, 1.0)))
    return body(organs, edge)


def derenzo(rng: np.random.Generator, edge: float) -> Body:
    """Rods in six sectors, of 0.7 to 2 mm, twice their diameter apart."""
    parts, turn = [], rng.uniform(0, np.pi / 3)
    for sector, diameter in enumerate((0.7e-3, 0.9e-3, 1.1e-3, 1.4e-3, 1.7e-3, 2e-3)):
        along = _direction(turn + sector * np.pi / 3 - np.pi / 6)
        across = _direction(turn + sector * np.pi / 3 + np.pi / 6)
        for i in range(12):
            for j in range(12 - i):
                place = (2.2e-3 / 2) * (along + across) + 2 * diameter * (i * along + j * across)
                if np.linalg.norm(place) < 9e-3:
                    parts.append((place, diameter / 2, 1.0))
    return body(parts, edge)


def bells(rng: np.random.Generator, edge: float) -> Body:
    """Four smooth bumps of 3 to 5 mm: hardly an edge in them."""
    places = [5e-3 * _direction(rng.uniform(0, 2 * np.pi)) for _ in range(4)]
    return body([(c, rng.uniform(2e-3, 3.5e-3), rng.uniform(0.5, 1.0)) for c in places], 1.0)


def off_middle(rng: np.random.Generator, edge: float) -> Body:
    """Vessels 8 mm off the middle."""
    return vessels(rng, edge, 6e-3).moved(8e-3 * _direction(rng.uniform(0, 2 * np.pi)))


def balls(rng: np.random.Generator, edge: float) -> Body:
    """Six soft balls, for detectors around a volume."""
    places = rng.uniform(-1, 1, (6, 3)) * np.array([8e-3, 8e-3, 8e-3])
    return body([(c, rng.uniform(4e-3, 7e-3), rng.uniform(0.5, 1.0)) for c in places], 3e-3)


def _direction(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


BODIES = {
    "vessels": vessels,
    "mouse": mouse,
    "derenzo": derenzo,
    "bells": bells,
    "off-middle": off_middle,
}
"""By name: functions of a generator of random numbers and of the edges' width [m]."""
