"""Choices with two speeds of sound, where the record itself tells the body, and the water's."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.choice_table import GUESSED, LIKELY, SURE
from ..io import Scan
from ..records import MODELS
from ..records.water import water_speed
from .acoustics import FASTEST_SOUGHT, SLOWEST_SOUGHT, shares_by_speed
from .acquisition import WATER, in_space, nominal_water_speed, typical_frame
from .body_estimate import BodyEstimate, estimate_body, estimate_ellipse
from .choices import Choices
from .frames import setup_of
from .medium import OF_BODY
from .pipeline import IN_SPACE, choices_in_plane, choices_in_space
from .space import units_of_scan
from .start_time import start_and_speed

LARGER = 1.1  # the region than the body
ESTIMATED = ("sound_speed", *(name for name in OF_BODY if name != "water_speed"))
NEAR = 2.0  # standard errors of a start that one speed tells
UNEXPLAINED = 0.5  # share of a record, above which no body is looked for that nobody asked for
_NAMED = {
    "radius": "body_radius",
    "center": "body_center",
    "half_axes": "body_axes",
    "angle": "body_angle",
}
KEPT = ("model", "time_shift")  # as one speed tells them, while two are looked for


def with_water_of(scan: Scan, given: Mapping[str, Any]) -> dict[str, Any]:
    """Options with the speed of sound in water in place of its temperature.

    Args:
        scan: of known units.
        given: options by name.

    Raises:
        ValueError: for a temperature beside a speed, and for unknown units.
    """
    others = dict(given)
    temperature = others.pop("water_temperature", None)
    if temperature is None:
        return others
    if others.get("water_speed") is not None:
        raise ValueError("water_speed and water_temperature are given, expected one of them.")
    nominal = nominal_water_speed(units_of_scan(scan).in_length(others.get("length_unit")))
    if nominal is None:
        raise ValueError(
            "water_temperature gives a speed in m/s, and the units of positions and times are not "
            "known: give water_speed."
        )
    return others | {"water_speed": float(water_speed(temperature)) * nominal / WATER}


def require_one(scan: Scan, given: Mapping[str, Any], shape: str) -> None:
    """Raise ValueError where one speed is asked for beside what is of two, or of integrals."""
    if scan.kind != "pressure":
        raise ValueError("two_speeds is of pressure records: leave it out.")
    beside = [name for name in (*OF_BODY, "water_temperature") if given.get(name) is not None]
    beside += ["body_shape"] if shape != "disk" else []
    if beside:
        raise ValueError(f"one speed is asked for, and {beside[0]} is of two: leave one out.")


def with_one_said(made: Choices) -> Choices:
    """Choices by one speed of sound, where that was asked for."""
    return _said_of_speed(made, "one speed is asked for")


def _said_of_speed(made: Choices, more: str) -> Choices:
    """The same choices, and a word more about the speed of sound."""
    why, error = dict(made.reasons)["sound_speed"], dict(made.standard_errors).get("sound_speed")
    return made.with_reason("sound_speed", f"{why}; {more}", made.grade("sound_speed"), error)


def lacks_second(scan: Scan, given: Mapping[str, Any]) -> bool:
    """Whether the water's speed is known alone, so that the body's is looked for.

    Args:
        scan: in the plane or in space.
        given: options by name; with numbers of the body its speed has to be given too.
    """
    known = scan.kind != "pressure" or "sound_speed" in scan.known
    if known or given.get("water_speed") is None:
        return False
    if any(given.get(name) is not None for name in ESTIMATED):
        return False
    units = units_of_scan(scan).in_length(given.get("length_unit"))
    return nominal_water_speed(units) is not None


def choices_of(scan: Scan, given: Mapping[str, Any]) -> Choices:
    """Choices by what is given, with one speed of sound, or of a body that is given."""
    return (choices_in_space if in_space(scan) else choices_in_plane)(scan, given)


def may_have_two(scan: Scan, given: Mapping[str, Any], made: Choices) -> bool:
    """Whether a body of another speed is looked for that nobody asked for.

    In the plane, where images told the speed, and explain most of the record, but do not tell that
    it starts when the file says: a body looks like another start to first order, and to second
    order like no start at all.

    Args:
        scan: in the plane or in space.
        given: options by name.
        made: choices with one speed.
    """
    told_by_images = "sound_speed" in dict(made.standard_errors) and made.model in MODELS
    if not told_by_images or given.get("radii") is not None:
        return False
    if made.grade("time_shift") == LIKELY and made.time_shift == 0:  # by images
        return False
    return _most_is_explained(scan, made) and not _start_is_told(scan, made)


def _most_is_explained(scan: Scan, made: Choices) -> bool:
    """Asked as the speed was looked for, by programs that are compiled already."""
    nominal = nominal_water_speed(made.units)
    assert nominal is not None  # else no speed is told
    ends = SLOWEST_SOUGHT * nominal, FASTEST_SOUGHT * nominal
    at, frame = np.array([made.sound_speed]), typical_frame(scan)
    shares = shares_by_speed(scan, replace(made, sound_speed=nominal), frame, at, ends)
    return shares is not None and bool(shares[0] <= UNEXPLAINED)


def _start_is_told(scan: Scan, made: Choices) -> bool:
    """Whether images of one speed tell the start of the choices."""
    if made.grade("time_shift") == GUESSED and made.time_shift != 0:
        return False
    start = start_and_speed(scan, made)
    return start is not None and start.even and abs(start.shift) <= NEAR * start.standard_error


def with_clear_body(scan: Scan, given: Mapping[str, Any], made: Choices) -> Choices:
    """Choices through the body that explains clearly more of a typical frame, or by one speed.

    Args:
        scan: of pressure.
        given: options by name.
        made: choices with one speed.
    """
    one, found = _with_body(scan, given, made, asked=False)
    if not found or not found.clear:
        return _not_clear(made, found)
    through = _through_body(scan, given, one, found)
    try:
        setup_of(scan, through)
    except ValueError:  # of a region that was given
        return _said_of_speed(made, f"by two speeds {found}, of a body smaller than the region")
    return through


def _not_clear(made: Choices, found: BodyEstimate | None) -> Choices:
    told = "the record is too short to tell a second one" if found is None else str(found)
    return _said_of_speed(made, f"by two speeds {told}")


def with_two_speeds(scan: Scan, given: Mapping[str, Any], shape: str = "disk") -> Choices:
    """Choices through the body that explains clearly more, or by one speed, with what was seen.

    Args:
        scan: of pressure.
        given: options by name; with a water speed that is taken to be known.
        shape: "disk" or "ellipse".

    Raises:
        ValueError: for numbers of the body beside the wish to estimate them, for data that have no
            speeds, for elements in space that have a size, and an ellipse in space.
    """
    if in_space(scan) and shape != "disk":
        raise ValueError(f"body_shape is {shape!r}, and detectors in space tell a ball.")
    option = "two_speeds" if shape == "disk" else "body_shape"
    beside = [name for name in ESTIMATED if given.get(name) is not None]
    if beside:
        raise ValueError(f"{option} estimates {beside[0]}, which is given: leave one out.")
    made = choices_of(scan, {**given, "water_speed": None})
    if made.model not in (*MODELS, IN_SPACE):
        raise ValueError(f"{option} is of pressure records: leave it out.")
    made, found = _with_body(scan, given, made)
    if shape == "ellipse" and found:
        how = typical_frame(scan), found
        found = estimate_ellipse(scan, made, *how, water_speed=given.get("water_speed"))
    if found and found.clear:
        return _through_body(scan, given, made, found)
    return _not_clear(made, found)


def _with_body(
    scan: Scan,
    given: Mapping[str, Any],
    made: Choices,
    *,
    asked: bool = True,
) -> tuple[Choices, BodyEstimate | None]:
    """The body, and the choices by one speed with the start with which it explains more.

    By one speed images may take a body's for another start: the file's is tried too.
    """
    frame, water = typical_frame(scan), given.get("water_speed")
    found = estimate_body(scan, made, frame, water_speed=water, asked=asked)
    if made.time_shift == 0 or "time_shift" in made.user_set:
        return made, found
    as_filed = choices_of(scan, {**given, "water_speed": None, "time_shift": 0.0})
    other = estimate_body(scan, as_filed, frame, water_speed=water, asked=asked)
    if other is None or not other.clear or (found and found.clear and found.share < other.share):
        return made, found
    as_filed = replace(as_filed, user_set=made.user_set)
    why = "as the file says; by one speed another explained more"
    return as_filed.with_reason("time_shift", why, GUESSED), other


def _through_body(
    scan: Scan, given: Mapping[str, Any], made: Choices, found: BodyEstimate
) -> Choices:
    """All choices with the body that was found; the region is its own, unless it is given."""
    body = found.body
    center = tuple(float(x) for x in body.center)
    numbers: dict[str, Any] = {
        "sound_speed": float(body.sound_speed),
        "water_speed": float(body.water_speed),
        "body_center": center,
    }
    if found.half_axes is None:
        numbers["body_radius"] = float(body.radius)
    else:
        numbers |= {"body_axes": found.half_axes, "body_angle": found.angle}
    region: dict[str, Any] = {"region_radius": LARGER * float(body.radius)}
    if not made.in_space:  # where the body's centre is that of the region
        region["region_center"] = center
    if any(given.get(name) is not None for name in (*region, "region_size")):
        region = {}
    told = {} if made.in_space else {name: getattr(made, name) for name in KEPT}
    known = {name: value for name, value in given.items() if value is not None}
    other = choices_of(scan, told | known | numbers | region)
    errors = {_NAMED.get(name, name): error for name, error in found.standard_errors.items()}
    for name in numbers:
        if name == "water_speed" and given.get(name) is not None:
            other = other.with_reason(name, "given", SURE)
            continue
        why = str(found) if name == "sound_speed" else "with which least is unexplained"
        other = other.with_reason(name, why, found.grade, errors.get(name))
    for name in region:
        other = other.with_reason(name, "that of the body, and a tenth to spare", found.grade)
    return _as_before(other, made)


def _as_before(other: Choices, made: Choices) -> Choices:
    """With the reasons for what was taken over from choices by one speed, and their options."""
    errors = dict(made.standard_errors)
    for name in KEPT:
        why = dict(made.reasons)[name]
        other = other.with_reason(name, why, made.grade(name), errors.get(name))
    return replace(other, user_set=made.user_set)
