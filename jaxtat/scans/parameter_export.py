"""Grades of the choices as JSON, and the choices to check first."""

from typing import Any

from ..base.choice_table import CHOICES, GRADES
from .choices import Choices
from .method import OF_FORMULA

CHOICE_OF = {"use": "channels"}  # which an option of another name decides
LOOKED_AT = (
    "sound_speed",
    "model",
    "time_shift",
    "region_radius",
    "alpha",
    "channels",
    "dead_time",
    "max_frequency",
    "band",
    "low_pass",
)
"""What decides most of an image first; all else follows from these or from the geometry."""


def as_json(choices: Choices) -> dict[str, Any]:
    """``{"choices": {name: {"value", "unit", "reason", "grade", ...}}}``, numbers in SI units.

    A number has its ``standard_error`` where one is known, and no unit where the scan's are not
    known. The entry ``channels`` counts the detectors used and names rows that are left out.
    """
    reasons, errors = dict(choices.reasons), dict(choices.standard_errors)
    found: dict[str, Any] = {}
    if "channels" in reasons:
        found["channels"] = {
            "value": len(choices.channels),
            "unit": None,
            "left_out": list(choices.left_out),
        }
    for choice in CHOICES:
        if choice.name not in reasons:
            continue
        factor, unit = choices.units.in_si(choice.quantity)
        # a cut at or beyond the radius cuts nothing
        whole = choice.name == "region_cut" and choices.region_cut >= choices.region_radius
        value = None if whole else _scaled(getattr(choices, choice.name), factor)
        found[choice.name] = {"value": value, "unit": unit}
        if choice.name in errors:
            found[choice.name]["standard_error"] = factor * errors[choice.name]
    for name, entry in found.items():
        entry |= {"reason": reasons[name], "grade": choices.grade(name)}
    return {"choices": found}


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return [factor * float(x) for x in value]
    return factor * value if isinstance(value, float) else value


def to_look_at(choices: Choices, n: int = 3) -> list[str]:
    """Names of the choices to check first: the least certain with the largest effect.

    Given ones are not among them, and of a fit not those of the formula.
    """
    reasons = dict(choices.reasons)
    fixed = {CHOICE_OF.get(name, name) for name in choices.user_set}
    fixed |= set(OF_FORMULA) if choices.model_based else set()
    open_ones = [name for name in LOOKED_AT if name in reasons and name not in fixed]
    return sorted(open_ones, key=lambda name: -GRADES.index(choices.grade(name)))[:n]
