"""What an image shows that is not there, and what it lacks, by what the detectors see of it."""

import numpy as np
from problem import Examples, Problem

# shares of edge directions: none but a few missing, some, many
BINS = {"nearly all": (0.9, 1.01), "most": (0.7, 0.9), "fewer": (0.0, 0.7)}
BRIGHT, DIM = 0.5, 0.25  # of an object: at least; of what counts as shown


def judged(
    images: np.ndarray, some: Examples, seen: np.ndarray, inside: np.ndarray
) -> dict[str, dict[str, float]]:
    """In each range of visibility: relative error, and what is invented and missed.

    ``invented`` counts pixels brighter than `DIM` two pixels or more from any object, ``missed``
    pixels of objects brighter than `BRIGHT` that are darker than `DIM`; both for each pixel of an
    object there.

    Args:
        images: (stack, x1, x2).
        some: their data and truth.
        seen: share of edge directions that each pixel shows.
        inside: the region.
    """
    images, found = np.maximum(images, 0.0), {}
    empty = ~_grown(some.truth > 0)
    for name, (low, high) in BINS.items():
        here = (seen >= low) & (seen < high) & inside
        objects = (some.truth > BRIGHT) & here
        n = max(int(objects.sum()), 1)
        found[name] = {
            "error": float(
                np.linalg.norm((images - some.truth)[:, here])
                / max(np.linalg.norm(some.truth[:, here]), 1e-12)
            ),
            "invented": float((empty & here & (images > DIM)).sum() / n),
            "missed": float((objects & (images < DIM)).sum() / n),
        }
    return found


def residuals(of: Problem, images: np.ndarray, some: Examples) -> np.ndarray:
    """Root mean square of A f - g over the noise's standard deviation: 1 for the true image."""
    left = np.asarray(of.A(images)) - some.g
    return np.sqrt((left**2).mean(axis=(1, 2))) / some.sigma


def _grown(masks: np.ndarray) -> np.ndarray:
    """With the four neighbours of each pixel."""
    wide = np.pad(masks, ((0, 0), (1, 1), (1, 1)))
    around = [np.roll(wide, shift, axis) for axis in (1, 2) for shift in (-1, 1)]
    return np.logical_or.reduce([wide, *around])[:, 1:-1, 1:-1]
