"""An independent solver of waves in the plane through any map of the speed of sound.

p_tt = c² Δp from p = f and p_t = 0, by the k-space leapfrog of Mast et al. (IEEE Trans. UFFC 48
(2001) 341): with c_0 the largest speed, and F the Fourier transform over a square,

    p(t + dt) = 2 p(t) - p(t - dt) - 4 (c/c_0)² F^-1 [sin²(c_0 |k| dt / 2) F p(t)],

exact in time where c = c_0. No layer absorbs at the edges: the square is so large that what goes
around it comes too late.
"""

import numpy as np
from scipy.fft import fftfreq, irfft2, next_fast_len, rfft2, rfftfreq
from scipy.ndimage import map_coordinates

STEP = 1 / 160  # of the grid; the unit circle holds the detectors
END = 2.3  # of the record
SMOOTH = 0.8 * STEP  # of the rim of a body


def smooth_body(level, inside):
    """Speeds 1 outside and ``inside`` where the level is below zero, a smooth step at its rim."""
    return 1 + (inside - 1) / (1 + np.exp(np.clip(level / SMOOTH, -60, 60)))


def square(reach=0.55):
    """Nodes of a square from which no wave of sources within ``reach`` comes around in time."""
    half = (END * 1.04 + 1 + reach) / 2
    n = next_fast_len(int(np.ceil(2 * half / STEP)), real=True)
    return STEP * (np.arange(n) - n // 2)


def record(image, speed, detectors, axis, every):
    """p at the detectors (detectors, times), and the times, ``every`` apart."""
    fastest = speed.max()
    steps = int(np.ceil(every / (0.3 * STEP / fastest)))
    dt, n = every / steps, len(axis)
    k = 2 * np.pi * np.hypot(fftfreq(n, STEP)[:, None], rfftfreq(n, STEP))
    symbol, ratio = 4 * np.sin(fastest * k * dt / 2) ** 2, (speed / fastest) ** 2

    def change(p):
        return ratio * irfft2(symbol * rfft2(p), s=p.shape)

    where = ((detectors - axis[0]) / STEP).T
    before, now, kept = image, image - change(image) / 2, [np.zeros(len(detectors))]
    times = every * np.arange(int(END / every) + 1)
    for i in range(1, steps * (len(times) - 1) + 1):
        if i % steps == 0:
            kept.append(map_coordinates(now, where, order=5, mode="nearest"))
        before, now = now, 2 * now - before - change(now)
    return np.stack(kept, axis=1), times
