"""Records of an in-plane scanner, exact but for the noise that is asked for."""

from functools import cache

import numpy as np

from jaxtat import detector_curve, phantoms
from jaxtat.io import Scan
from jaxtat.scans import BodyEstimate

RADIUS, SPEED, RATE, N = 0.04, 1500.0, 4e6, 90
BELLS = {"centers": [[2e-3, 3e-3], [-4e-3, -1e-3], [1e-3, -5e-3]], "radii": [4e-3, 3e-3, 2.5e-3]}
TIMES = np.arange(230) / RATE


def positions(turn=0.0, n=N, span=270.0):
    """An arc in space that opens downwards, then turned [degrees]."""
    theta = np.radians(90.0 + turn + np.linspace(-span / 2, span / 2, n))
    return RADIUS * np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)


def turned(points, turn):
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    return np.asarray(points) @ np.array([[c, s], [-s, c]])


def truth(points, turn=0.0):
    """f of the phantom, turned with the array."""
    bells = phantoms.Bells(turned(BELLS["centers"], turn), BELLS["radii"], [1.0, 0.7, 0.5])
    return np.asarray(bells(points))


@cache
def record(turn=0.0):
    bells = phantoms.Bells(turned(BELLS["centers"], turn), BELLS["radii"], [1.0, 0.7, 0.5])
    found = in_plane(bells, detector_curve(positions(turn)[:, :2]))
    found.flags.writeable = False
    return found


def in_plane(bells, curve):
    """p with g = r ∫_0^r p dr': p = d(g/r)/dr, by differences of exact integrals."""
    radii, h = np.maximum(SPEED * TIMES, 1e-3), 1e-6
    both = np.concatenate([radii - h / 2, radii + h / 2])
    means = np.asarray(bells.circular_integrals(curve, both)) / both
    return (means[:, len(radii) :] - means[:, : len(radii)]) / h


def scan(pressure, turn=0.0, **known):
    facts = {"detectors": positions(turn), "sampling_rate": RATE, "sound_speed": SPEED}
    return Scan("pressure", pressure, facts | known)


def raw_counts(pressure, noise=0.01, seed=0, drift=1.0):
    """As a scanner writes them: an artefact at the start, offsets, drift and noise, whole numbers.

    The artefact is alike in all detectors and 50 times as strong as the sound.
    """
    rng = np.random.default_rng(seed)
    peak = np.abs(pressure).max()
    artefact = 50 * np.cos(2e6 * TIMES) * np.exp(-((TIMES / 0.8e-6) ** 2))
    offset, slope = rng.normal(0, 2, (len(pressure), 1)), rng.normal(0, 1, (len(pressure), 1))
    line = offset + drift * slope * TIMES / TIMES[-1]
    counts = pressure / peak + artefact + line + noise * rng.standard_normal(pressure.shape)
    return (32768 + 500 * counts).clip(0, 65535).astype(np.uint16)


def clear_body(body):
    """What a record tells of a body that explains clearly more than one speed."""
    return BodyEstimate(
        body=body,
        standard_errors={"sound_speed": 2.0, "radius": 1e-4, "center": 2e-4},
        one_speed=1505.0,
        share=0.05,
        share_of_one=0.1,
        gain=0.75,
        gain_error=0.05,
        clear=True,
        grade="likely",
    )
