"""The speed of sound at which a scan's image is least negative, where edges are seen once.

Light is absorbed or not: f >= 0. At a wrong speed edges of different directions are displaced by
different lengths; the power of the image hardly changes, but what was a point has a tail, and in an
image without low frequencies, which records lack, less stands out from the negative surroundings.
So with f filtered by |xi| cos(pi |xi| / (2 Lambda)), and w a window about where the body is,

    P(c) = 1 - ∫ w min(f, 0)² dx / ∫ w f² dx

has a peak near the true speed. How near depends on the body and on what else is in the record:
elements of an unknown response change the signs. So it is a guess.
"""

from dataclasses import replace

import jax
import numpy as np
from jaxtyping import Array, Float

from ..base.size_ladder import filled_up
from ..io import Scan
from ..regularization import tikhonov_rule
from .acquisition import FASTEST, SLOWEST, typical_frame
from .all_speeds import about_center, data_by_speed, faded, problem_for_speeds
from .choices import Choices
from .frames import integrals
from .speed_found import peaks, summit

SPEEDS = np.linspace(SLOWEST, FASTEST, 25)
BESIDE = 3  # speeds to each side that belong to a peak
FREQUENCIES = 0.5  # of the image's highest frequency: noise is negative, too
WAVES = 600.0  # kR at most
LEAST_ALPHA = 1e-3
LARGEST, MOVES, WITHIN = 0.5, 0.07, 0.85  # over the detectors' radius: region, at other speeds
WINDOW = 1.1  # radius over the region's
PIXELS = 1.3  # in half the shortest wave


def speed_least_negative(scan: Scan, choices: Choices) -> float | None:
    """The speed over that of the choices at which the image of a typical frame is least negative.

    Args:
        scan, choices: as for `positive_by_speed`.

    Returns:
        None if there is no peak, or images of the formula are not possible.
    """
    shares = positive_by_speed(scan, choices)
    return None if shares is None else highest_peak(shares)


def positive_by_speed(scan: Scan, choices: Choices) -> Float[np.ndarray, " speeds"] | None:
    """P at each of the speeds, of a typical frame.

    A body that is heard at given times is farther off, the faster sound is. The window follows it.

    Args:
        scan, choices: in the plane, of pressure; of detectors on one side.

    Returns:
        None if images of the formula are not possible.
    """
    points = about_center(scan, choices)
    distance = np.hypot(*points.T)
    size = float(np.median(distance))
    body = min(choices.region_radius, LARGEST * size)
    coarse = _coarse(choices, min(body + MOVES * size, WITHIN * size), size)
    problem = problem_for_speeds(scan, coarse)
    setup, radii, sizes = problem.setup, problem.radii, problem.sizes
    if not (setup.complete and sizes.reached):
        return None
    distance = filled_up(distance, (problem.curve.n_detectors,), by="last")
    sounding = jax.device_put(distance[:, None] + body * np.array([-1.0, 1.0]))
    g = problem.data(integrals(scan, coarse, setup, typical_frame(scan)))
    data = data_by_speed(
        g * faded(radii, sounding), radii, jax.device_put(SPEEDS), sizes.frequencies
    )
    basis = problem.basis()
    rule = tikhonov_rule(max(choices.alpha, LEAST_ALPHA), sizes.frequencies.shape[0])
    relative = np.arange(sizes.n_frequencies + 1) / sizes.n_frequencies
    eta = problem.of_frequencies(relative * np.cos(np.pi / 2 * relative))
    fhat, _ = basis.fhat(data, rule)
    mass = jax.device_put(np.zeros((len(SPEEDS), len(distance))))  # eta has none
    images = problem.images(basis.invert(fhat, mass, problem.grid, eta, "fourier"))
    away = -points.mean(axis=0) / np.linalg.norm(points.mean(axis=0))
    middles = size * (SPEEDS[:, None] - 1) * away
    offsets = np.asarray(setup.grid.points) - np.asarray(choices.region_center)
    windows = np.array([_window(offsets - middle, WINDOW * body) for middle in middles])
    return positive_share(images, windows)


def _coarse(choices: Choices, radius: float, size: float) -> Choices:
    highest = min(FREQUENCIES * choices.max_frequency, WAVES / size)
    return replace(
        choices,
        max_frequency=highest,
        region_radius=radius,
        region_cut=radius,
        half_width=radius,
        pixels=2 * int(PIXELS * radius * highest / np.pi) + 1,
    )


def _window(offsets: Float[np.ndarray, "x1 x2 2"], radius: float) -> Float[np.ndarray, "x1 x2"]:
    return np.maximum(1 - np.sum(offsets**2, axis=-1) / radius**2, 0.0) ** 2


def positive_share(
    images: Float[np.ndarray, "speeds x1 x2"] | Array, windows: Float[np.ndarray, "speeds x1 x2"]
) -> Float[np.ndarray, " speeds"]:
    """The share of ∫ w f² where f is positive.

    >>> positive_share(np.array([[[2.0, -1.0]], [[2.0, -4.0]]]), np.ones((2, 1, 2))).tolist()
    [0.8, 0.2]
    """
    squares = windows * np.asarray(images) ** 2
    whole = np.maximum(squares.sum(axis=(1, 2)), 1e-300)
    return np.where(images > 0, squares, 0.0).sum(axis=(1, 2)) / whole


def highest_peak(values: Float[np.ndarray, " speeds"]) -> float | None:
    """Where the highest peak above the straight line through what is beside it is; None if none is.

    >>> round(highest_peak(np.maximum(1 - ((SPEEDS - 1.0125) / 0.02) ** 2, 0.0)), 6)
    1.0125
    """
    heights = {k: values[k] - line for k, line in peaks(values, BESIDE) if values[k] > line}
    if not heights:
        return None
    best = max(heights, key=heights.__getitem__)
    three = slice(best - 1, best + 2)
    return summit(SPEEDS[three], values[three])
