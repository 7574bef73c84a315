"""Description of a scan file as text."""

import numpy as np

from ..geometry import Disk, visibility
from ..io import Scan
from ..records import ranges, supported
from .choices import Choices
from .facts import Facts, arc_through, blank_frames, facts_of, frame_numbers, in_space
from .model import in_doubt
from .noise import wants_alpha
from .space import FactsInSpace, facts_in_space


def describe(scan: Scan, choices: Choices) -> str:
    """Data, detectors, and what would be chosen for a reconstruction, as lines of text."""
    facts = facts_in_space(scan, choices.channels) if in_space(scan) else facts_of(scan)
    lines = [f"{key}: {value}" for key, value in scan.about.items()]
    blank = blank_frames(scan, choices.channels)
    if blank.any():
        lines.append(f"left out: frames {ranges(frame_numbers(scan)[blank])} hold NaN or infinity")
    lines.append(
        f"{scan.kind.replace('_', ' ')}: {scan.n_frames} frames of {scan.n_detectors} detectors, "
        f"{scan.n_samples} samples ({scan.data.dtype})"
    )
    if facts.times is not None:
        step = float(facts.times[1] - facts.times[0])
        start, end = (facts.units.of_time(float(facts.times[k])) for k in (0, -1))
        unit = facts.units.time or "unit of time"
        lines.append(f"times: {start} to {end}, {1 / step:.6g} samples per {unit}")
    if facts.units.length is not None:
        of_times = f", times in {facts.units.time}" if facts.units.time else ""
        lines.append(
            f"units: lengths are taken to be in {facts.units.length}{of_times}, by their size; "
            "options are given in them"
        )
    if "wavelengths" in scan.known:
        shown = np.unique(np.asarray(scan.known["wavelengths"]))
        lines.append("wavelengths: " + ", ".join(f"{w:g}" for w in shown))
    more = _of_sphere(facts) if isinstance(facts, FactsInSpace) else _of_curve(facts, choices)
    estimated = ", the model by which an image explains more" if in_doubt(choices) else ""
    estimated += ", alpha and filter by cross-validation" if wants_alpha(choices) else ""
    return "\n".join([*lines, *more, "", f"A reconstruction would use{estimated}", choices.table()])


def _of_sphere(facts: FactsInSpace) -> list[str]:
    center = facts.units.of_place(np.asarray(facts.detectors.center), facts.radius, 3)
    radius = facts.units.of_length(facts.radius, 6)
    return [f"detectors: {facts.arrangement}, radius {radius} about {center}"]


def _of_curve(facts: Facts, choices: Choices) -> list[str]:
    arc, lines = arc_through(facts.points[list(choices.channels)]), []
    if arc is None:
        lines.append("detectors: not on a circle")
    else:
        radius, units = arc.radius, facts.units
        towards = round(float(np.degrees(arc.opening)), 1) + 0.0  # no -0.0
        opening = "closed" if arc.closed else f"opens towards {towards:.1f} degrees"
        off = (
            ""
            if arc.deviation < 1e-6 * radius
            else (f", off it by {units.of_length(arc.deviation, 1)}")
        )
        lines.append(
            f"detectors: arc of {np.degrees(arc.span):.1f} degrees, radius "
            f"{units.of_length(radius, 6)} about {units.of_place(arc.center, radius, 3)}{off}; "
            f"{opening}"
        )
    curve, region = choices.curve(facts.points), choices.region
    assert isinstance(region, Disk)
    lines.append(f"region of interest: {visibility(curve, region)}")
    if facts.times is not None:
        speed = choices.sound_speed
        support = supported(curve, region, facts.times, sound_speed=speed)
        lines.append(f"sampling: {support.in_words(facts.units)}")
    return lines
