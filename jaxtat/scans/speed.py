"""The speed of sound of a scan that does not tell it: that of the sharpest image.

`sound_speed_by_sharpness` finds the same place by derivatives. Here a search by values does, with
images of one compiled program: for a single scan, compiling is what takes time.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Array

from ..geometry import ImageGrid, Region
from ..io import Scan
from ..reconstruction import reconstruct
from ..studies import sharpness
from .choices import Choices
from .choose_in_plane import TO_BE_ESTIMATED
from .facts import FASTEST, SLOWEST, WATER, typical_frame
from .frames import integrals, setup_of

SPEEDS = np.linspace(SLOWEST, FASTEST, 17)
TOLERANCE = 0.25 / WATER
STANDS_OUT = 1.05  # the sharpest image's sharpness over the median one's, at least


def estimate_sound_speed(scan: Scan, choices: Choices) -> Choices:
    """With the speed of sound for which the image of a typical frame is sharpest, if none is known.

    Images are of half the resolution: that is quicker, and sharpness falls off less steeply beside
    its peak, which is easier to find. Radii keep their ratio to the speed. A speed of which the
    sharpness hardly depends, as with smooth objects, is not believed.
    """
    if dict(choices.reasons).get("sound_speed") != TO_BE_ESTIMATED:
        return choices
    coarse = replace(
        choices, pixels=choices.pixels // 4 * 2 + 1, max_frequency=choices.max_frequency / 2
    )
    setup = setup_of(scan, coarse)
    g = integrals(scan, coarse, setup, typical_frame(scan))

    def sharpness_at(stretch: float) -> float:
        # radii that do not cover the region any more are no matter here
        there = eqx.tree_at(lambda tree: tree.radii, setup, setup.radii * stretch)
        image = reconstruct(
            there, g, coarse.alpha, low_pass=coarse.low_pass, inversion=coarse.inversion
        )
        return stretch**2 * float(_sharpness(image, setup.grid, setup.region))

    stretch, why = sharpest(sharpness_at)
    return replace(
        choices,
        sound_speed=choices.sound_speed * stretch,
        first_radius=choices.first_radius * stretch,
        radial_step=choices.radial_step * stretch,
        reasons=tuple((n, why if n == "sound_speed" else old) for n, old in choices.reasons),
    )


def sharpest(sharpness_at: Callable[[float], float]) -> tuple[float, str]:
    """The speed of greatest sharpness, over that of water and within 7 % of it, and why.

    >>> speed, _ = sharpest(lambda speed: 1 / (1 + ((speed - 0.9877) / 0.013) ** 2))
    >>> abs(speed - 0.9877) < 5e-4
    True
    """
    from scipy.optimize import minimize_scalar  # slow to import

    values = np.array([sharpness_at(float(speed)) for speed in SPEEDS])
    best, median = int(np.argmax(values)), float(np.median(values))
    if best in (0, len(values) - 1) or values[best] < STANDS_OUT * median:
        return 1.0, "water's: no other within 7 % gives an image much sharper than all others"
    place = minimize_scalar(
        lambda speed: -sharpness_at(float(speed)) / values[best],
        bounds=(SPEEDS[best - 1], SPEEDS[best + 1]),
        method="bounded",
        options={"xatol": TOLERANCE},
    )
    more = float(-place.fun * values[best] / median - 1)
    return float(place.x), f"the image is sharpest, by {more:.0%}; none in the file"


@eqx.filter_jit
def _sharpness(image: Array, grid: ImageGrid, region: Region) -> Array:
    return sharpness(image, grid, region)
