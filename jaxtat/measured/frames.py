"""Where an image is made, and the circular integrals it is made of."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..checks import real_array
from ..geometry import DetectorCurve, ImageGrid, Region
from ..impulse_response import remove_impulse_response
from ..io import Scan
from ..layout import Layout, problem_layout
from ..plan import ReconstructionPlan
from ..pressure import condition_record, pressure_to_circular_integrals
from ..reconstruction import DirectReconstruction, reconstruct_direct
from ..spherical import pressure_to_spherical_integrals
from .choices import IN_SPACE, LOW_PASSES, Choices
from .facts import facts_of, times_of

GROUPS = 2  # of frequencies, at most: for few images, compiling is what takes time


class Where(eqx.Module):
    """Detectors, region, pixels and radii, found once for all frames."""

    curve: DetectorCurve
    region: Region
    grid: ImageGrid
    radii: Float[Array, " radii"]

    @classmethod
    def of(cls, scan: Scan, choices: Choices) -> "Where":
        """Circular integrals keep the radii of their file."""
        own = scan.known.get("radii") if scan.kind == "circular_integrals" else None
        radii = choices.radii if own is None else real_array("radii", own, ("radii",))
        points = facts_of(scan).points
        return cls(choices.curve(points), choices.region, choices.grid, radii)

    @classmethod
    def of_plan(cls, plan: ReconstructionPlan) -> "Where":
        return cls(plan.curve, plan.region, plan.grid, plan.radii)


def integrals(scan: Scan, choices: Choices, radii: Array, frames: np.ndarray) -> Array:
    """Integrals of frames over circles, or spheres, about the detectors that are used."""
    part = real_array(scan.kind, frames[..., list(choices.channels), :], None)
    times = times_of(scan)
    if times is None:
        if part.shape[-1] != radii.shape[0]:
            raise ValueError(
                f"the data have {part.shape[-1]} radii, the geometry has {radii.shape[0]}: name "
                "radii in the file, or choose --region-radius, --pixels and --half-width to match."
            )
        return part
    in_plane = choices.model == "in-plane"  # the slow tail of 2-D waves is signal
    if choices.band is not None or choices.dead_time:
        part = condition_record(
            part, times, dead_time=choices.dead_time, band=choices.band, baseline=in_plane
        )
    if choices.impulse_response:
        response = scan.known["impulse_response"]  # its time 0 is in the middle
        part = remove_impulse_response(part, times, response, origin=len(response) // 2)
    speed = choices.sound_speed
    if choices.model == IN_SPACE:
        return pressure_to_spherical_integrals(part, times, radii, sound_speed=speed)
    return pressure_to_circular_integrals(
        part, times, radii, sound_speed=speed, model=choices.model
    )


def layout_of(choices: Choices, where: Where) -> Layout:
    return problem_layout(
        where.curve,
        where.region,
        where.grid,
        where.radii,
        max_frequency=choices.max_frequency,
        n_groups=GROUPS,
    )


def reconstructed(where: Where, layout: Layout, choices: Choices, g: Array) -> DirectReconstruction:
    """Images of circular integrals, without a plan."""
    return reconstruct_direct(
        where.curve,
        where.region,
        where.grid,
        where.radii,
        g,
        choices.alpha,
        low_pass=LOW_PASSES[choices.low_pass],
        inversion=choices.inversion,
        layout=layout,
    )
