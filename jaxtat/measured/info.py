"""What is in a scan file, in words."""

import numpy as np

from ..geometry import visibility
from ..io import Scan
from ..sampling import supported
from .choices import Choices
from .facts import Facts, arc_through, facts_of, in_space
from .space import FactsInSpace, facts_in_space


def describe(scan: Scan, choices: Choices) -> str:
    """Data, detectors, and what would be chosen for a reconstruction, as lines of text."""
    facts = facts_in_space(scan, choices.order) if in_space(scan) else facts_of(scan)
    lines = [f"{key}: {value}" for key, value in scan.about.items()]
    lines.append(
        f"{scan.kind.replace('_', ' ')}: {scan.n_frames} frames of {scan.n_detectors} detectors, "
        f"{scan.n_samples} samples ({scan.data.dtype})"
    )
    if facts.times is not None:
        step = float(facts.times[1] - facts.times[0])
        lines.append(
            f"times: {float(facts.times[0]):.6g} to {float(facts.times[-1]):.6g}, "
            f"{1 / step:.6g} samples per unit"
        )
    if facts.units.length is not None:
        lines.append(f"units: lengths are taken to be in {facts.units.length}, by their size")
    if "wavelengths" in scan.known:
        shown = np.unique(np.asarray(scan.known["wavelengths"]))
        lines.append("wavelengths: " + ", ".join(f"{w:g}" for w in shown))
    more = _of_sphere(facts) if isinstance(facts, FactsInSpace) else _of_curve(facts, choices)
    return "\n".join([*lines, *more, "", "A reconstruction would use", choices.table()])


def _of_sphere(facts: FactsInSpace) -> list[str]:
    center = ", ".join(f"{x:.3g}" for x in np.asarray(facts.detectors.center))
    return [f"detectors: {facts.arrangement}, radius {facts.radius:.6g} about ({center})"]


def _of_curve(facts: Facts, choices: Choices) -> list[str]:
    arc, lines = arc_through(facts.points[list(choices.channels)]), []
    if arc is None:
        lines.append("detectors: not on a circle")
    else:
        x1, x2 = arc.center
        opening = "closed" if arc.closed else f"opens towards {np.degrees(arc.opening):.1f} degrees"
        lines.append(
            f"detectors: arc of {np.degrees(arc.span):.1f} degrees, radius {arc.radius:.6g} about "
            f"({x1:.3g}, {x2:.3g}) to {arc.deviation:.1g}; {opening}"
        )
    curve = choices.curve(facts.points)
    lines.append(f"region of interest: {visibility(curve, choices.region)}")
    if facts.times is not None:
        speed = choices.sound_speed
        lines.append(
            f"sampling: {supported(curve, choices.region, facts.times, sound_speed=speed)}"
        )
    return lines
