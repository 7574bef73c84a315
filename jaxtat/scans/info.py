"""Description of a scan file as text."""

import numpy as np

from ..base.cost import available_memory, gigabytes
from ..fitting.fit_memory import memory_of_fit
from ..geometry import VolumeGrid, visibility
from ..geometry.regions import Region
from ..io import Scan
from ..records import ranges, supported
from .acquisition import Facts, arc_through, blank_frames, facts_of, frame_numbers, in_space
from .choices import Choices
from .space import FactsInSpace, facts_in_space

STRAIGHT = 1e-3  # extent across over extent along, of a line


def describe(scan: Scan, choices: Choices) -> str:
    """Data, detectors, and what would be chosen for a reconstruction, as lines of text."""
    if in_space(scan):
        facts = facts_in_space(scan, choices.channels, choices.body_center)
    else:
        facts = facts_of(scan)
    facts = facts._replace(units=choices.units)  # as options say
    lines = _of_data(scan, facts, choices.channels)
    if isinstance(facts, FactsInSpace):
        lines += _of_sphere(facts)
        if choices.model_based:
            lines.append(_of_memory(facts, choices, scan.n_samples))
    else:
        lines += [*_of_curve(facts, list(choices.channels)), *_of_region(facts, choices)]
    return "\n".join([*lines, "", "A reconstruction would use", choices.table()])


def describe_without_region(scan: Scan, length_unit: str | None) -> str:
    """Data and detectors of a scan in the plane for which no region can be chosen."""
    facts = facts_of(scan)
    facts = facts._replace(units=facts.units.in_length(length_unit))
    every = tuple(int(k) for k in facts.order)
    return "\n".join([*_of_data(scan, facts, every), *_of_curve(facts, list(every))])


def _of_data(scan: Scan, facts: Facts | FactsInSpace, channels: tuple[int, ...]) -> list[str]:
    lines = [f"{key}: {value}" for key, value in scan.about.items()]
    blank = blank_frames(scan, channels)
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
            f"units: lengths are taken to be in {facts.units.length}{of_times}; options are given "
            "in them"
        )
    if "wavelengths" in scan.known:
        shown = np.unique(np.asarray(scan.known["wavelengths"]))
        lines.append("wavelengths: " + ", ".join(f"{w:g}" for w in shown))
    return lines


def _of_sphere(facts: FactsInSpace) -> list[str]:
    center = facts.units.of_place(np.asarray(facts.detectors.center), facts.radius, 3)
    radius = facts.units.of_length(facts.radius, 6)
    return [f"detectors: {facts.arrangement}, radius {radius} about {center}"]


def _of_memory(facts: FactsInSpace, choices: Choices, n_samples: int) -> str:
    grid, reach = choices.grid, choices.region_radius
    assert isinstance(grid, VolumeGrid)
    cost = memory_of_fit(facts.detectors, grid, reach, choices.max_frequency, n_samples)
    sides = " x ".join(map(str, grid.shape))
    free = gigabytes(available_memory())
    return f"memory: a fit of {sides} voxels takes about {gigabytes(cost.nbytes)}, {free} are free"


def _of_curve(facts: Facts, channels: list[int]) -> list[str]:
    arc, units = arc_through(facts.points[channels]), facts.units
    if arc is None:
        offset = facts.points[channels] - facts.points[channels].mean(axis=0)
        _, (most, least), axes = np.linalg.svd(offset, full_matrices=False)
        shape = "on a straight line" if least < STRAIGHT * most else "not on a circle"
        return [f"detectors: {shape}, {units.of_length(float(np.ptp(offset @ axes[0])), 3)} long"]
    radius = arc.radius
    towards = round(float(np.degrees(arc.opening)), 1) + 0.0  # no -0.0
    opening = "closed" if arc.closed else f"opens towards {towards:.1f} degrees"
    near = arc.deviation < 1e-6 * radius
    off = "" if near else f", off it by {units.of_length(arc.deviation, 1)}"
    return [
        f"detectors: arc of {np.degrees(arc.span):.1f} degrees, radius "
        f"{units.of_length(radius, 6)} about {units.of_place(arc.center, radius, 3)}{off}; "
        f"{opening}"
    ]


def _of_region(facts: Facts, choices: Choices) -> list[str]:
    curve, region = choices.curve(facts.points), choices.region
    assert isinstance(region, Region)
    lines = [f"region of interest: {visibility(curve, region)}"]
    if facts.times is not None:
        support = supported(curve, region, facts.times, sound_speed=choices.path_speed)
        lines.append(f"sampling: {support.in_words(facts.units)}")
    return lines
