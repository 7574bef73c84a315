"""The choices to check first, each with a command line that changes it."""

import argparse
import shlex
from typing import Any

import numpy as np

from ..base.choice_table import NUMBERS, OF_TWO_SPEEDS, OPTIONS, words_of
from ..geometry import in_plane
from ..io import Scan
from ..scans import Choices, to_look_at
from ..scans.parameter_export import LOOKED_AT
from ..scans.pipeline import NOT_IN_SPACE
from ..scans.region import SHARES
from .inputs import FACTS
from .option_checks import OF_PLANS, wants_plan

_OPTIONS = (*FACTS, *OF_PLANS, *OF_TWO_SPEEDS, *(choice.name for choice in OPTIONS))
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
    unasked = NOT_IN_SPACE if choices.in_space else ()
    unasked = unasked if choices.left_out else (*unasked, "channels")  # all of them are used
    names = [name for name in to_look_at(choices, len(LOOKED_AT)) if name not in unasked][:MOST]
    reasons = dict(choices.reasons)
    if not names:
        return "Nothing is left to check: the file and the options set everything."
    lines = ["Look at these first"]
    for name in names:
        lines.append(f"{name}  {choices.grade(name)}  {reasons[name]}")
        lines.append(f"    {shlex.join(_command(options, scan, choices, name))}")
    return "\n".join(lines)


def _command(options: argparse.Namespace, scan: Scan, choices: Choices, name: str) -> list[str]:
    """The user's command with one choice changed."""
    command = ["jaxtat", "reconstruct", options.file, *_given(options)]
    value = getattr(choices, name, None)
    several = name in NUMBERS and (value or name == "time_shift")
    if several and not (wants_plan(options) or choices.in_space):
        tried = ",".join(f"{x:.4g}" for x in _values(scan, choices, name))
        return [*command, "--try", f"{name}={tried}", "--out", "sheet.png"]
    return [*command, *_otherwise(scan, choices, name, value), "--out", "image.png"]


def _values(scan: Scan, choices: Choices, name: str) -> list[float]:
    """Values around the chosen one, for a start up to 1 us; a region stays off the detectors."""
    value = float(getattr(choices, name))
    if name == "time_shift":
        unit = choices.units.in_si("time")[0]
        return [value + later / unit for later in _LATER]
    tried = [factor * value for factor in _FACTORS.get(name, _ANY)]
    if name != "region_radius":
        return tried
    most = max(SHARES[1] * _nearest(scan, choices), value) * (1 + _ROUNDING)
    return [x for x in tried if x <= most]


def _nearest(scan: Scan, choices: Choices) -> float:
    """Distance from the region's centre to the nearest detector that is used."""
    points = np.asarray(scan.known["detectors"], float)
    points = points if choices.in_space else np.asarray(in_plane(points))
    offsets = points[list(choices.channels)] - np.array(choices.region_center)
    return float(np.linalg.norm(offsets, axis=1).min())


def _otherwise(scan: Scan, choices: Choices, name: str, value: Any) -> list[str]:
    if name == "channels":
        return words_of("use", f"0:{len(choices.order)}")
    if name == "band":
        return words_of("band", "none")
    if isinstance(value, str):
        return words_of(name, _OTHER[value])
    if name == "dead_time" and not value:  # half the time until sound from the region may arrive
        path = max(_nearest(scan, choices) - choices.region_radius, 0.0)
        return words_of(name, float(f"{path / choices.sound_speed / 2:.3g}"))
    if name not in NUMBERS:
        return words_of(name, float(f"{value:.6g}"))
    others = _values(scan, choices, name)
    larger = [x for x in others if x > value * (1 + _ROUNDING)]
    return words_of(name, float(f"{larger[0] if larger else others[-2]:.4g}"))


def _given(options: argparse.Namespace) -> list[str]:
    """The options of `jaxtat info` as options of `jaxtat reconstruct`."""
    return [word for name in _OPTIONS for word in words_of(name, getattr(options, name, None))]
