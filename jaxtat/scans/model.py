"""The acoustic model of a record that does not tell it: the one by which images explain more.

Neither counts nor an offset say that a scanner wrote it, and the tail of two-dimensional waves may
be drift. Of one body the records by both models differ by an eighth of a period. What is seen from
two sides then agrees at no speed, so that by the wrong model the dip of `best_explained` is less
deep. Where every edge is seen once, an image explains either; but by the wrong model edges are
bright on one side and dark on the other, and less of the image is positive.
"""

import warnings
from dataclasses import replace

from ..base.choice_table import GUESSED, LIKELY
from ..io import Scan
from ..steps import AccuracyWarning
from .best_explained import DEEP, dip_of
from .choices import Choices
from .least_negative import positive_by_speed
from .one_side import seen_once

OTHER = {"2d": "in-plane", "in-plane": "2d"}
CLEARLY = 1.2  # depth of the dip by the right model, over that by the other
POSITIVE = 1.02  # share of two-dimensional waves that is positive, over that by the other model
WHAT = {"2d": "two-dimensional waves", "in-plane": "sound in the plane"}


def in_doubt(choices: Choices) -> bool:
    """Whether the record alone did not tell the model."""
    return "model" in choices.to_estimate


def better_model(scan: Scan, choices: Choices, other: Choices) -> Choices:
    """Those choices of two, alike but for the model, by which a typical frame is explained better.

    Args:
        scan: in the plane, of pressure.
        choices: of which the model is `in_doubt`.
        other: with the other model as if it had been given.

    Warns:
        AccuracyWarning: for two-dimensional waves, if that remains a guess.
    """
    by_model = {choices.model: choices, other.model: other}
    if not seen_once(scan, choices):
        told = _by_dips(scan, by_model)
    else:  # signs tell less than a tail that is not there
        told = _by_signs(scan, by_model) if choices.model == "2d" else None
    model, why, grade = told or (choices.model, dict(choices.reasons)["model"], GUESSED)
    if (model, grade) == ("2d", GUESSED):
        warnings.warn(f"{why}; a scanner's record needs model in-plane.", AccuracyWarning, 4)
    better = replace(by_model[model], user_set=choices.user_set, to_estimate=choices.to_estimate)
    return better.with_reason("model", why, grade)


def _by_dips(scan: Scan, by_model: dict[str, Choices]) -> tuple[str, str, str] | None:
    """What is seen from two sides."""
    dips = {model: dip_of(scan, choices) for model, choices in by_model.items()}
    model = max(dips, key=lambda model: dips[model].depth)
    best, other = dips[model], dips[OTHER[model]]
    if best.depth <= 0:
        return None
    why = f"an image explains the record better as {WHAT[model]} than as {WHAT[OTHER[model]]}"
    if not (best.complete and other.complete):
        return model, f"{why}, but the record ends early", GUESSED
    found = best.found.standard_error is not None  # at a speed, as by the right model
    clear = found and best.depth >= max(DEEP, CLEARLY * other.depth)
    return model, why, LIKELY if clear else GUESSED


def _by_signs(scan: Scan, by_model: dict[str, Choices]) -> tuple[str, str, str] | None:
    """What is seen once, but is positive."""
    shares = {model: positive_by_speed(scan, choices) for model, choices in by_model.items()}
    waves, plane = shares["2d"], shares["in-plane"]
    if waves is None or plane is None:
        return None
    model = "2d" if waves.max() > POSITIVE * plane.max() else "in-plane"
    return model, f"as {WHAT[model]} the image is less negative", GUESSED
