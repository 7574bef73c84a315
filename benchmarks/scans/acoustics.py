"""What detectors hear of a body, exactly: means of the pressure over each sampling interval.

In the plane, of elements focused into it, p = d(g/r)/dr at r = c t, and of a disk of radius a whose
centre is at the distance d, g/r = 2 arccos((d² + r² - a²) / (2 d r)): the mean of p over a sample
is a difference of that. Of a ball in space p = (d - r)/(2d) for |d - r| < a.
"""

import numpy as np
from bodies import Body


def _add(record, distances, radius, amplitude, step, primitive) -> None:
    """Adds a (P(r + step/2) - P(r - step/2)) / step about every detector's distance, in place."""
    n = record.shape[1]
    first = np.floor((distances - radius) / step).astype(int) - 1
    width = int(np.ceil(2 * radius / step)) + 4
    samples = first[:, None] + np.arange(width)
    edges = step * (np.append(samples, samples[:, -1:] + 1, axis=1) - 0.5)
    values = np.diff(primitive(edges, distances[:, None], radius), axis=1) / step
    kept = (samples >= 0) & (samples < n)
    rows = np.broadcast_to(np.arange(len(record))[:, None], samples.shape)
    record[rows[kept], samples[kept]] += amplitude * values[kept]


def _angle(r, d, a):
    """g/r of a disk."""
    safe = np.where(r > 0, r, 1.0)
    cosine = (d**2 + safe**2 - a**2) / (2 * d * safe)
    return np.where(r > 0, 2 * np.arccos(np.clip(cosine, -1, 1)), 0.0)


def _ball(r, d, a):
    """Integral over r of the pressure of a ball."""
    return (a**2 - np.clip(r - d, -a, a) ** 2) / (4 * d)


def in_plane(body: Body, points: np.ndarray, n: int, step: float, detour=None) -> np.ndarray:
    """Records (detectors, n) of elements focused into the plane, a path ``step`` = c dt apart.

    Args:
        detour: function (centre, points) of what the path of sound seems longer [m].
    """
    record = np.zeros((len(points), n))
    for center, radius, amplitude in body.disks():
        distances = np.linalg.norm(points[:, :2] - center, axis=1)
        distances = distances if detour is None else distances + detour(center, points[:, :2])
        _add(record, distances, radius, amplitude, step, _angle)
    return record


def in_space(body: Body, points: np.ndarray, n: int, step: float) -> np.ndarray:
    """Records of point-like detectors that hear from everywhere."""
    record = np.zeros((len(points), n))
    for center, radius, amplitude in body.disks():
        distances = np.linalg.norm(points - center, axis=1)
        _add(record, distances, radius, amplitude, step, _ball)
    return record


def two_dimensional(body: Body, points: np.ndarray, n: int, step: float) -> np.ndarray:
    """Records of waves in the plane, as of integrating line detectors."""
    from jaxtat.records import circular_integrals_to_pressure

    radii = step * np.arange(1, n + 1)
    g = np.zeros((len(points), n))
    for center, radius, amplitude in body.disks():
        distances = np.linalg.norm(points[:, :2] - center, axis=1)[:, None]
        g += amplitude * radii * _angle(radii, distances, radius)
    pressure = circular_integrals_to_pressure(g, radii, step * np.arange(n))
    return np.asarray(pressure)


def out_of_plane(rng: np.random.Generator, body: Body) -> Body:
    """Balls 3 to 8 mm above and below the plane, where the body is."""
    parts = 12
    inside = rng.uniform(-0.7, 0.7, (parts, 2)) * body.extent + body.middle
    height = rng.choice([-1, 1], parts) * rng.uniform(3e-3, 8e-3, parts)
    radii = rng.uniform(0.4e-3, 1.2e-3, parts)
    centers = np.column_stack([inside, height])
    return Body(centers, radii, 0.5 * radii, rng.uniform(0.3, 1.0, parts))


def straight_rays(body: Body, inside: float, outside: float):
    """What the path seems longer where the body's speed is another than the water's.

    Straight rays through the disk that holds the body: to first order in the difference of speeds.
    """
    middle, extent = body.middle, body.extent

    def detour(center: np.ndarray, points: np.ndarray) -> np.ndarray:
        ray = points - center
        ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
        along = ray @ (center - middle)
        within = -along + np.sqrt(along**2 + extent**2 - np.sum((center - middle) ** 2))
        return (outside / inside - 1) * within

    return detour


def mirrored(body: Body, angle: float, distance: float, strength: float) -> Body:
    """Mirror images, by which a wall reflects: so far from the origin, towards an angle."""
    normal = np.array([np.cos(angle), np.sin(angle)])
    off = distance - body.centers @ normal
    return Body(
        body.centers + 2 * off[:, None] * normal,
        body.radii,
        body.edges,
        strength * body.amplitudes,
    )


def sounding_wall(angle: float, distance: float, edge: float, strength: float) -> Body:
    """A piece of a wall that light reaches: a row of small disks, 12 mm long."""
    normal = np.array([np.cos(angle), np.sin(angle)])
    along = np.linspace(-6e-3, 6e-3, 50)[:, None] * np.array([-normal[1], normal[0]])
    n = len(along)
    return Body(
        distance * normal + along,
        np.full(n, 0.3e-3),
        np.full(n, min(edge, 0.27e-3)),
        np.full(n, strength),
    )
