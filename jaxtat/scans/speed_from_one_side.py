"""The speed of sound from detectors on one side, which see most edges once.

By what an image in the region explains; else a guess, by negative values. On such arcs the best
image f >= 0 explains a record nearly as well at a wrong speed (`misfit`): on arcs of 125 degrees
these two are nearer.
"""

import numpy as np

from ..base.choice_table import GUESSED, LIKELY
from ..io import Scan
from .acquisition import facts_of
from .best_explained import speed_best_explained
from .choices import Choices, at_speed
from .least_negative import speed_least_negative
from .one_side import TOLD_APART, span


def with_speed_from_one_side(scan: Scan, choices: Choices) -> Choices:
    """Choices with the speed of sound that a typical frame tells, or with water's.

    Args:
        scan, choices: in the plane, of pressure, at water's speed.
    """
    points = facts_of(scan).points[list(choices.channels)]
    degrees = span(points, np.asarray(choices.region_center))
    explained, doubt = speed_best_explained(scan, choices)
    if explained.standard_error is not None:
        why = f"{explained.why}; {doubt}" if doubt else f"{explained.why}; none in the file"
        error = None if doubt else choices.sound_speed * explained.standard_error
        at = at_speed(choices, explained.stretch)
        return at.with_reason("sound_speed", why, GUESSED if doubt else LIKELY, error)
    why = f"from {degrees:.0f} degrees edges are seen once, and {explained.why}"
    speed = speed_least_negative(scan, choices) if degrees >= TOLD_APART else None
    if speed is None:
        return choices.with_reason("sound_speed", f"water's: {why}", GUESSED)
    why = f"the image is least negative: {why}"
    return at_speed(choices, speed).with_reason("sound_speed", why, GUESSED)
