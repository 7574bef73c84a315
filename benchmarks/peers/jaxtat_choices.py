"""jaxtat told the speed of sound and the body's disk: else its own choices, on the pixels asked."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from peer import Problem

from jaxtat import ImageGrid, Setup
from jaxtat.io import Scan
from jaxtat.scans import choose, setup_of

jax.config.update("jax_enable_x64", True)


def image_of(problem: Problem, make: Callable[..., Any], **given: Any) -> np.ndarray:
    """What ``make(scan, choices, setup)`` gives, zero outside the region that is seen."""
    known = {
        "detectors": problem.detectors,
        "sampling_rate": problem.sampling_rate,
        "sound_speed": problem.sound_speed,
    }
    scan = Scan("pressure", problem.record, known)
    if problem.body is not None:
        given |= {"region_radius": problem.body, "region_center": (0.0, 0.0)}
    choices = choose(scan, **given)
    of_choices = setup_of(scan, choices)
    grid = ImageGrid((problem.pixels,) * 2, (problem.half_width,) * 2, (0.0, 0.0))
    where = of_choices.curve, of_choices.region, grid, of_choices.radii
    setup = Setup(*where, max_frequency=choices.max_frequency)
    image = np.asarray(make(scan, choices, setup))
    return np.where(np.asarray(setup.region.contains(grid.points)), image, 0.0)
