"""jaxtat by its own choices: told the record, positions, its rate, and the pixels asked, no more.

The speed of sound, the start, the region, the method and its parameters are its own to find.
"""

from typing import Any

import jax
import numpy as np
from peer import Problem, run

from jaxtat import __version__
from jaxtat.io import Scan
from jaxtat.scans import choose, reconstruct, with_best_method

jax.config.update("jax_enable_x64", True)


def image_of(problem: Problem, **given: Any) -> np.ndarray:
    """What `jaxtat reconstruct` makes with these options, zero outside of its region."""
    known = {"detectors": problem.detectors, "sampling_rate": problem.sampling_rate}
    given |= {"pixels": problem.pixels, "half_width": problem.half_width}
    if not problem.in_space:  # where the middle of the detectors' sphere is that of the volume
        given["region_center"] = (0.0, 0.0)
    scan = Scan("pressure", problem.record, known)
    found = reconstruct(scan, with_best_method(scan, choose(scan, **given)))
    return np.where(np.asarray(found.region.contains(found.grid.points)), found.image, 0.0)


def told(**given: Any) -> None:
    """Run on a problem with its speed of sound, as others are, and with these options."""
    run(
        "jaxtat",
        lambda problem: image_of(problem, sound_speed=problem.sound_speed, **given),
        version=__version__,
    )


if __name__ == "__main__":
    run("jaxtat", image_of, version=__version__)
