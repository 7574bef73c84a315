"""The choices to check first, each with a command line that changes it."""

import argparse
import shlex
from typing import Any

import numpy as np

from ..base.choice_table import NUMBERS, OF_TWO_SPEEDS, OPTIONS, words_of
from ..geometry import in_plane
from ..geometry.bodies import BEYOND
from ..io import Scan
from ..scans import Choices, to_look_at
from ..scans.frames import shifted_times
from ..scans.parameter_export import LOOKED_AT
from ..scans.pipeline import NOT_IN_SPACE
from ..scans.region import SHARES
from .inputs import FACTS
from .option_checks import OF_PLANS, wants_plan

_OPTIONS = (
    *FACTS,
    *OF_PLANS,
    *OF_TWO_SPEEDS,
    "length_unit",
    *(choice.name for choice in OPTIONS),
)
_FACTORS = {
    "sound_speed": (0.97, 0.98, 0.99, 1.0, 1.01, 1.02, 1.03),
    "alpha": (0.1, 0.3, 1.0, 3.0, 10.0),
}
_ANY = (0.6, 0.8, 1.0, 1.2, 1.4)
_LATER = (-1e-6, -0.5e-6, 0.0, 0.5e-6, 1e-6)  # s
_ROUNDING = 1e-9  # relative, by which a value may be beyond a bound
MOST = 3  # suggestions
_OTHER = {"2d": "in-plane", "in-plane": "2d", "none": "cosine", "cosine": "none"}


def suggestions(options: argparse.Namespace, scan: Scan, choices: Choices) -> str:
    """Up to three choices, least certain first, and commands that try or set other values."""
    reasons = dict(choices.reasons)
    commands = {name: _command(options, scan, choices, name) for name in _asked(choices)}
    names = [name for name, command in commands.items() if command][:MOST]
    if not names:
        return "Nothing is left to check: the file and the options set everything."
    lines = ["Look at these first"]
    for name in names:
        lines.append(f"{name}  {choices.grade(name)}  {reasons[name]}")
        lines.append(f"    {shlex.join(commands[name])}")
    return "\n".join(lines)


def _asked(choices: Choices) -> list[str]:
    """Choices to look at that an option of the command changes, the least certain first."""
    unasked = (*NOT_IN_SPACE, "channels") if choices.in_space else ()
    return [name for name in to_look_at(choices, len(LOOKED_AT)) if name not in unasked]


def _command(options: argparse.Namespace, scan: Scan, choices: Choices, name: str) -> list[str]:
    """The user's command with one choice changed; nothing where there is no other value."""
    command = ["jaxtat", "reconstruct", options.file, *_given(options)]
    value = getattr(choices, name, None)
    several = name in NUMBERS and (value or name == "time_shift")
    if several and not (wants_plan(options) or choices.in_space):
        tried = ",".join(f"{x:.4g}" for x in _values(scan, choices, name))
        return [*command, "--try", f"{name}={tried}", "--out", "sheet.png"]
    other = _otherwise(scan, choices, name, value)
    return [*command, *other, "--out", "image.png"] if other else []


def _values(scan: Scan, choices: Choices, name: str) -> list[float]:
    """Values around the chosen one, for a start up to 1 us; a region stays off the detectors."""
    value = float(getattr(choices, name))
    if name == "time_shift":
        unit = choices.units.in_si("time")[0]
        return [value + later / unit for later in _LATER]
    tried = [factor * value for factor in _FACTORS.get(name, _ANY)]
    if name != "region_radius":
        return tried
    distances = _distances(scan, choices)
    most = SHARES[1] * distances.min()
    if choices.medium is not None:  # beyond, sound would be counted as from inside the body
        body = choices.medium
        off = np.linalg.norm(np.asarray(body.center) - np.asarray(choices.region_center))
        most = min(most, BEYOND * float(body.radius) - float(off))
    times = shifted_times(scan, choices)
    if choices.in_space and times is not None:  # and no farther than the record reaches
        most = min(most, float(times[-1]) * choices.sound_speed - distances.max())
    return [x for x in tried if x <= max(most, value) * (1 + _ROUNDING)]


def _distances(scan: Scan, choices: Choices) -> np.ndarray:
    """Of the detectors that are used from the region's centre [length]."""
    points = np.asarray(scan.known["detectors"], float)
    points = points if choices.in_space else np.asarray(in_plane(points))
    return np.linalg.norm(points[list(choices.channels)] - np.array(choices.region_center), axis=1)


def _otherwise(scan: Scan, choices: Choices, name: str, value: Any) -> list[str]:
    """Options for another value; none where there is no other."""
    if name == "channels":
        return words_of("use", f"0:{len(choices.order)}") if choices.left_out else []
    if name == "band":
        return words_of("band", "none") if value is not None else []
    if isinstance(value, str):
        return words_of(name, _OTHER[value])
    if name == "dead_time" and not value:
        return _dead_time(scan, choices)
    others = _values(scan, choices, name)
    larger = [x for x in others if x > value + _ROUNDING * abs(value)]
    return words_of(name, float(f"{larger[0] if larger else others[-2]:.4g}"))


def _dead_time(scan: Scan, choices: Choices) -> list[str]:
    """Half-way from the first sample to the first sound from the region."""
    times = shifted_times(scan, choices)
    first = 0.0 if times is None else max(float(times[0]), 0.0)
    path = float(_distances(scan, choices).min()) - choices.region_radius
    ends = (first + path / choices.sound_speed) / 2
    return words_of("dead_time", float(f"{ends:.3g}")) if ends > first else []


def _given(options: argparse.Namespace) -> list[str]:
    """The options of `jaxtat info` as options of `jaxtat reconstruct`."""
    return [word for name in _OPTIONS for word in words_of(name, getattr(options, name, None))]
