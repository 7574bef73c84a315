"""What is seen: soft strokes in a disk of 7 mm, each of a radius, an edge and an amplitude.

An image is the largest of its strokes; a stroke falls from its amplitude to 0 smoothly, across its
edge of 2 EDGE, so that a simulation on a grid of 0.15 mm resolves it.
"""

import numpy as np

EDGE = 0.35e-3  # half the width of an edge [m]
MM = 1e-3

# (x, y of one end, x, y of the other, radius, amplitude), millimetres
DISKS = [
    (-2.5, 2.0, -2.5, 2.0, 2.2, 1.0),
    (2.8, 2.6, 2.8, 2.6, 1.3, 0.6),
    (0.5, -3.0, 0.5, -3.0, 1.9, 0.8),
    (4.3, -1.2, 4.3, -1.2, 0.7, 1.0),
    (-4.4, -2.2, -4.4, -2.2, 0.9, 0.5),
]
VESSELS = [
    (-6.0, -1.5, -3.0, 0.0, 0.45, 1.0),
    (-3.0, 0.0, 0.0, 0.6, 0.45, 1.0),
    (0.0, 0.6, 3.2, 2.4, 0.4, 0.9),
    (3.2, 2.4, 5.2, 3.4, 0.35, 0.8),
    (0.0, 0.6, 2.6, -1.2, 0.35, 0.8),
    (2.6, -1.2, 4.0, -4.0, 0.3, 0.7),
    (2.6, -1.2, 6.0, -0.8, 0.3, 0.7),
    (-3.0, 0.0, -2.6, 3.2, 0.35, 0.8),
    (-2.6, 3.2, -4.0, 5.0, 0.3, 0.7),
    (-2.6, 3.2, -0.4, 5.8, 0.3, 0.7),
    (-3.0, 0.0, -1.6, -3.4, 0.35, 0.8),
    (-1.6, -3.4, -3.2, -5.6, 0.3, 0.6),
    (-1.6, -3.4, 0.6, -5.8, 0.3, 0.6),
]
LETTERS = [  # T, A, T
    (-5.6, 2.4, -2.4, 2.4, 0.35, 1.0),
    (-4.0, 2.4, -4.0, -2.4, 0.35, 1.0),
    (-1.8, -2.4, 0.0, 2.4, 0.35, 1.0),
    (1.8, -2.4, 0.0, 2.4, 0.35, 1.0),
    (-1.1, -0.7, 1.1, -0.7, 0.35, 1.0),
    (2.4, 2.4, 5.6, 2.4, 0.35, 1.0),
    (4.0, 2.4, 4.0, -2.4, 0.35, 1.0),
    (-3.0, 5.0, 3.0, 5.0, 0.25, 0.5),
    (-3.0, -5.0, 3.0, -5.0, 0.25, 0.5),
]
# bodies about the vessels: x, y of the middle, half axes, millimetres
BODIES = {"two-speeds-disk": (0.4, -0.3, 8.0, 8.0), "two-speeds-ellipse": (0.4, -0.3, 9.2, 7.6)}
IN_BODY = 1560.0  # their speed of sound [m/s]
PHANTOMS = {"disks": DISKS, "vessels": VESSELS, "letters": LETTERS}


def image(name: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(x, y) values of a phantom at the nodes x and y [m]."""
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    found = np.zeros(points.shape[:-1])
    for stroke in PHANTOMS[name]:
        start, stop = np.array(stroke[:2]) * MM, np.array(stroke[2:4]) * MM
        radius, amplitude = stroke[4] * MM, stroke[5]
        along = stop - start
        share = np.clip((points - start) @ along / max(along @ along, 1e-30), 0, 1)
        distance = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
        s = np.clip((distance - radius) / EDGE, -1, 1)
        found = np.maximum(found, amplitude * (0.5 - 15 / 16 * (s - 2 / 3 * s**3 + s**5 / 5)))
    return found
